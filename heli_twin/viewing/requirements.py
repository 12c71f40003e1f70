"""Requirements in Rerun: what decides about each over the flight, and the moment when it is tightest.

The signal with its limit in a plot, a mark where the helicopter was, an event, and a table.
"""

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
import rerun as rr

from controllers.signals import Array
from heli_twin.recording import Log
from heli_twin.requirements import Decisive, Requirement, Verdict, decisive, judge
from heli_twin.terminal_text import clean
from heli_twin.viewing.blueprint import MOST_REQUIREMENT_PLOTS, TIMELINE
from heli_twin.viewing.entities import Rows, scalars
from heli_twin.viewing.style import AXES, LIMIT, Look, lines, rgba

MARK_HEIGHT_M, MARK_STEP_M = 0.1, 0.06
"""Height of the first name over its place, and of each further one over the one before, so that they can be read."""
UP = np.array([0.0, 0.0, 1.0])
KEPT, BROKEN = AXES[1], AXES[0]
FOUND = 0xFFD166FF
"""The tightest moment in a plot."""
NAME_LIMIT = 40
"""Characters of a requirement's name."""


class Judged(NamedTuple):
    """A verdict, and what it rests on."""

    verdict: Verdict
    signals: Decisive | None
    """None if there was nothing to look at, or if it has no plot."""
    position: Array | None
    """(3,) of the helicopter at the tightest moment, world, m."""

    @property
    def name(self) -> str:
        """Its name, short and printable."""
        return clean(self.verdict.requirement.name, NAME_LIMIT)


def judged(requirements: Iterable[Requirement], log: Log) -> list[Judged]:
    """Judge a flight for a picture.

    Args:
        requirements: What it must do.
        log: The flight as it was read.

    Raises:
        HeliTwinError: The log does not hold a signal.
    """
    found: list[Judged] = []
    for number, verdict in enumerate(judge(requirements, log).values()):
        at, place = verdict.tightest_at, None
        moved = log.truth if len(log.truth.time) else log.pose
        if at is not None:
            stamp, first = np.unique(moved.stamp, return_index=True)
            place = np.array([np.interp(1e9 * at, stamp, moved.position[first, i]) for i in range(3)])
        signals = decisive(verdict, log) if number < MOST_REQUIREMENT_PLOTS else None
        found.append(Judged(verdict, signals, place))
    return found


def send_judged(stream: rr.RecordingStream, found: Sequence[Judged], look: Look) -> None:
    """Send the verdicts on a flight; its signals have its colours if it is one of two."""
    for number, each in enumerate(found, 1):
        entity = look.path(f"requirements/{number}")
        if each.signals is not None:
            names = [f"{look.name} {name}".strip() for name in each.signals.signals]
            colours = [look.flown, look.wanted][: len(names)]
            stream.log(f"{entity}/signal", lines(names, colours), static=True)
            stream.log(f"{entity}/limit", lines(["limit"], [LIMIT], 1.0), static=True)
            colour = look.flown if look.name else FOUND
            point = rr.SeriesPoints(colors=rgba([colour]), markers=["diamond"], marker_sizes=[5.0], names=["tightest"])
            stream.log(f"{entity}/tightest", point, static=True)
        if each.position is not None:
            _send_mark_style(stream, look.path(f"world/requirements/{number}"), each, look)
    for entity, times, columns in _rows(found):
        stream.send_columns(look.path(entity), [rr.TimeColumn(TIMELINE, duration=times.astype("m8[ns]"))], columns)


def send_table(stream: rr.RecordingStream, flights: Sequence[tuple[str, Sequence[Judged]]]) -> None:
    """Send the table of all verdicts, a column a flight."""
    text = rr.TextDocument(table(flights), media_type=rr.MediaType.MARKDOWN)
    stream.log("requirements/told", text, static=True)


def table(flights: Sequence[tuple[str, Sequence[Judged]]]) -> str:
    """Return the verdicts as a Markdown table.

    Args:
        flights: Name of each flight, empty for one alone, and the verdicts on it; all of the same requirements.
    """
    alone = len(flights) == 1
    heads = ["verdict", "tightest at", "then"] if alone else [name for name, _ in flights]
    rows = ["| | " + " | ".join(heads) + " |", "|---" * (1 + len(heads)) + "|"]
    for number, same in enumerate(zip(*(found for _, found in flights), strict=True), 1):
        cells = [f"{number} {same[0].name}"]
        for each in same:
            at = "" if each.verdict.tightest_at is None else f"{each.verdict.tightest_at:.2f} s"
            told = each.verdict.told if each.verdict.holds else f"**{each.verdict.told}**"
            cells += [told, at, clean(each.verdict.reason, 80)] if alone else [f"{told}, {at}".removesuffix(", ")]
        rows.append("| " + " | ".join(cell.replace("|", "/") for cell in cells) + " |")
    return "\n".join(rows)


def comparable(a: Sequence[Judged], b: Sequence[Judged]) -> tuple[list[Judged], list[Judged]]:
    """Return the verdicts on two flights; where other parts of a formula decide, only the tighter one has a plot."""
    kept: tuple[list[Judged], list[Judged]] = ([], [])
    for first, second in zip(a, b, strict=True):
        same = first.verdict.decides == second.verdict.decides
        tighter = _room(first.verdict) <= _room(second.verdict)
        kept[0].append(first if same or tighter else first._replace(signals=None))
        kept[1].append(second if same or not tighter else second._replace(signals=None))
    return kept


def _room(verdict: Verdict) -> float:
    if verdict.normalised is not None:
        return verdict.normalised
    return np.inf if verdict.holds else -np.inf


def _send_mark_style(stream: rr.RecordingStream, entity: str, each: Judged, look: Look) -> None:
    colours = rgba([look.flown if look.name else KEPT if each.verdict.holds else BROKEN])
    points = rr.Points3D.from_fields(radii=[0.012, 0.001], colors=colours, show_labels=True)
    stream.log(f"{entity}/place", points, static=True)
    stream.log(f"{entity}/line", rr.LineStrips3D.from_fields(radii=0.001, colors=colours), static=True)


def _mark(entity: str, number: int, each: Judged) -> Iterator[Rows]:
    """Where the helicopter was, and the name above it, from the tightest moment on."""
    if each.position is None or each.verdict.tightest_at is None:
        return
    top = each.position + (MARK_HEIGHT_M + MARK_STEP_M * (number - 1)) * UP
    times = np.array([round(1e9 * each.verdict.tightest_at)], np.int64)
    both, labels = np.array([each.position, top], np.float32), ["", f"{number} {each.name}: {each.verdict.told}"]
    yield f"{entity}/place", times, rr.Points3D.columns(positions=both, labels=labels).partition([2])
    yield f"{entity}/line", times, rr.LineStrips3D.columns(strips=both[None])


def _rows(found: Sequence[Judged]) -> Iterator[Rows]:
    for number, each in enumerate(found, 1):
        yield from _mark(f"world/requirements/{number}", number, each)
        signals = each.signals
        if signals is not None and each.verdict.tightest_at is not None:
            entity, times = f"requirements/{number}", np.rint(1e9 * signals.time).astype(np.int64)
            values = np.stack(list(signals.signals.values()), axis=1)
            yield f"{entity}/signal", times, scalars(values)
            if signals.limit is not None:
                yield f"{entity}/limit", times[[0, -1]], scalars(np.full(2, signals.limit))
            at = int(np.argmin(np.abs(signals.time - each.verdict.tightest_at)))
            yield f"{entity}/tightest", times[[at]], scalars(values[at, :1])
    told = [each for each in found if each.verdict.tightest_at is not None]
    if told:
        times = np.array([round(1e9 * (each.verdict.tightest_at or 0.0)) for each in told], np.int64)
        text = [f"requirement {each.name}: {each.verdict.told}, {clean(each.verdict.reason, 120)}" for each in told]
        level = ["INFO" if each.verdict.holds else "ERROR" for each in told]
        yield "events/requirements", times, rr.TextLog.columns(text=text, level=level)
