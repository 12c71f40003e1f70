"""Two flights in one picture: both helicopters in one scene, their errors in one plot, and B minus A."""

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from controllers.rotations import wrap_angle
from controllers.signals import Array
from heli_twin.recording.log import Log, Times
from heli_twin.viewing.blueprint import COMPUTING, Scales, Tab, blueprint, in_tabs, plot, requirements_tab, scene
from heli_twin.viewing.delivery import Destination, deliver
from heli_twin.viewing.entities import Rows, scalars, tracking
from heli_twin.viewing.live import send, send_rows
from heli_twin.viewing.ranges import ROW_PX, Range, labelled, ranges
from heli_twin.viewing.requirements import Judged, comparable, send_judged, send_table
from heli_twin.viewing.style import (
    AXES,
    FLOWN,
    INPUTS,
    POSITIONS,
    RIVAL,
    RIVAL_WANTED,
    WANTED,
    YAW,
    Look,
    floor_mark,
    lines,
    send_static,
)

LOOKS = (Look("A", "blue", FLOWN, WANTED, FLOWN), Look("B", "pink", RIVAL, RIVAL_WANTED, RIVAL))


GHOST = 0xFF7AC668
"""The body of a flight that was predicted and not flown: translucent."""

FieldDifference = tuple[str, str, str]
"""Dotted path of a field in which two experiments differ, and its values in A and in B, as text."""


class ComparedFlight(NamedTuple):
    """One of the two flights."""

    log: Log
    scales: Scales
    name: str
    """The log file's."""
    is_ghost: bool = False
    """True if it was predicted and not flown."""
    found: Sequence[Judged] = ()
    """The verdicts on its requirements."""


def show_both(
    a: ComparedFlight,
    b: ComparedFlight,
    differences: Sequence[FieldDifference],
    destination: Destination,
    tab: str = "",
) -> None:
    """Show two flights as `/A` and `/B` of one recording.

    Args:
        a: The first flight.
        b: The second.
        differences: What differs between their experiments.
        destination: Where they are shown.
        tab: Name of the plots in front; empty for those of what has changed.

    Raises:
        LogError: No viewer listens or answers, the file cannot be written, or there is no such tab.
    """
    if a.found and b.found:
        both = comparable(a.found, b.found)
        a, b = a._replace(found=both[0]), b._replace(found=both[1])
    flights = [flight._replace(scales=flight.scales.for_log(flight.log)) for flight in (a, b)]
    usual = "inputs" if "resolve" in (a.log.origin, b.log.origin) else "requirements" if a.found else ""
    in_front = tab or usual

    floor = floor_mark(_paths(flights))

    def fill(stream: rr.RecordingStream) -> None:
        stream.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        for flight, named in zip(flights, LOOKS, strict=True):
            look = named._replace(body=GHOST) if flight.is_ghost else named
            send_static(stream, look, flight.scales.source, flight.scales.shape, floor if named is LOOKS[0] else None)
            send(stream, flight.log, flight.scales, look.path(""))
            for entity_rows in _errors(flight.log, look):
                send_rows(stream, entity_rows)
            send_judged(stream, flight.found, look)
        for entity_rows in _difference(a.log, b.log):
            send_rows(stream, entity_rows)
        _send_styles(stream, flights)
        told = [(look.name, flight.found) for look, flight in zip(LOOKS, flights, strict=True) if flight.found]
        if told:
            send_table(stream, told)
        text = rr.TextDocument(document(flights, differences), media_type=rr.MediaType.MARKDOWN)
        stream.log("differences", text, static=True)

    deliver(destination, _layout(flights, differences, in_front), fill)


def difference(a: Log, b: Log) -> tuple[Times, Array]:
    """Truth of B minus truth of A while both were recorded.

    Returns:
        A's times (n,), ns, and x y z (world, m) and yaw (rad, in [-pi, pi)) as (n, 4). B is interpolated linearly.
    """
    (t, of_a), (t_b, of_b) = _poses(a), _poses(b)
    if not len(t_b):
        return t[:0], of_a[:0]
    common = (t >= t_b[0]) & (t <= t_b[-1])
    t, of_a = t[common], of_a[common]
    seconds, seconds_b = 1e-9 * t, 1e-9 * t_b
    minus = np.column_stack([np.interp(seconds, seconds_b, of_b[:, i]) for i in range(4)]) - of_a
    minus[:, 3] = wrap_angle(minus[:, 3])
    return t, minus


def _poses(log: Log) -> tuple[Times, Array]:
    t, first = np.unique(log.truth.time, return_index=True)
    return t, np.column_stack([log.truth.position, log.truth.yaw])[first]


def _errors(log: Log, look: Look) -> Iterator[Rows]:
    t, error = tracking(log)
    yield look.path("tracking/position"), t, scalars(100 * np.linalg.norm(error[:, :3], axis=1))
    yield look.path("tracking/yaw"), t, scalars(np.degrees(error[:, 3]))


def _difference(a: Log, b: Log) -> Iterator[Rows]:
    t, minus = difference(a, b)
    yield "difference/position", t, scalars(100 * minus[:, :3])
    yield "difference/yaw", t, scalars(np.degrees(minus[:, 3]))


def _send_styles(stream: rr.RecordingStream, flights: Sequence[ComparedFlight]) -> None:
    """Name and colour the lines of each plot by the flight, not by the wire."""
    for look, flight in zip(LOOKS, flights, strict=True):
        flown = (f"position/{name}/{flight.scales.source}" for name in POSITIONS)
        for entity in ("tracking/position", "tracking/yaw", *flown):
            stream.log(look.path(entity), lines([look.name], [look.flown]), static=True)
        for name in POSITIONS:
            style = lines([f"{look.name} reference"], [look.wanted], 1.0)
            stream.log(look.path(f"position/{name}/reference"), style, static=True)
        for name in INPUTS:
            stream.log(look.path(f"input/{name}/sent"), lines([look.name], [look.flown], held=True), static=True)
    stream.log("difference/position", lines([*"xyz"], AXES), static=True)
    stream.log("difference/yaw", lines(["yaw"], [YAW]), static=True)


def _paths(flights: Sequence[ComparedFlight]) -> Array | None:
    paths = [flight.scales.path for flight in flights if flight.scales.path is not None]
    return np.concatenate(paths) if paths else None


def _layout(flights: Sequence[ComparedFlight], differences: Sequence[FieldDifference], in_front: str) -> rrb.Blueprint:
    colours = ", ".join(
        f"{look.name} {look.colour}{'' if flight.scales.source == 'truth' else f' by the {flight.scales.source}'}"
        for look, flight in zip(LOOKS, flights, strict=True)
    )
    seen = rrb.Vertical(
        scene(f"{colours}: {_in_short(differences)}", _paths(flights), [f"/{look.name}" for look in LOOKS]),
        rrb.Horizontal(
            rrb.TextDocumentView(name="What differs", origin="/differences"),
            rrb.TextLogView(
                name="Events",
                origin="/",
                contents=_of_both("events/**"),
                columns=rrb.TextLogColumns(text_log_columns=["EntityPath", "LogLevel", "Body"]),
            ),
        ),
        row_shares=[5, 3],
    )
    return blueprint(seen, in_tabs(_tabs(flights), in_front))


def _tabs(flights: Sequence[ComparedFlight]) -> list[Tab]:
    """The tabs of two flights; those of errors need a reference of both."""
    first, second = flights
    minus = difference(first.log, second.log)[1]
    r = ranges([flight.log for flight in flights])
    errors = Tab(
        "Errors",
        [
            _plot_both("Distance from the reference [cm]: A blue, B pink", ["tracking/position"], r),
            _plot_both("Yaw error [deg]: A blue, B pink", ["tracking/yaw"], r),
        ],
        [3, 2],
    )
    apart = Tab(
        "Difference",
        [
            plot(
                "Position of B minus A [cm]: x red, y green, z blue", "/difference/position", _range(100 * minus[:, :3])
            ),
            plot("Yaw of B minus A [deg]", "/difference/yaw", _range(np.degrees(minus[:, 3]))),
        ],
        [3, 2],
    )
    position = Tab(
        "Position",
        [
            _plot_both(
                f"{name} [{'deg' if name == 'yaw' else 'm'}]: A blue, B pink",
                [f"position/{name}/{what}" for what in ("reference", "truth", "cameras")],
                r,
            )
            for name in POSITIONS
        ],
    )
    inputs = Tab("Inputs", [_plot_both(f"{name} sent: A blue, B pink", [f"input/{name}/sent"], r) for name in INPUTS])
    state = rrb.StateTimelineView(name="States", origin="/", contents=_of_both("state/**"))
    computing = [plot(f"{look.name}, {COMPUTING}", f"/{look.name}/computing") for look in LOOKS]
    controller = Tab("Controller", [state, *computing], [1, 1, 1])
    is_planned = any(len(flight.log.reference.time) for flight in flights)
    required = [each.verdict.requirement for each in first.found]
    judged = [requirements_tab(required, [f"/{look.name}" for look in LOOKS])] if required else []
    return [*([errors] if is_planned else []), apart, position, inputs, controller, *judged]


def _range(values: Array) -> tuple[float, float] | None:
    finite = values[np.isfinite(values)]
    return labelled(float(finite.min()), float(finite.max()), ROW_PX) if len(finite) else None


def _plot_both(name: str, entities: Sequence[str], r: Mapping[str, Range]) -> rrb.TimeSeriesView:
    y = r.get(f"/{entities[0].removesuffix('/reference')}")
    return plot(name, "/", y, [content for entity in entities for content in _of_both(entity)])


def _of_both(entity: str) -> list[str]:
    return [f"+ /{look.path(entity)}" for look in LOOKS]


def _in_short(differences: Sequence[FieldDifference]) -> str:
    """The first differences, short enough for a title."""
    first = ", ".join(f"{field} {a} / {b}" for field, a, b in differences[:2])
    more = f" and {len(differences) - 2} more" if len(differences) > 2 else ""
    return (first or "the same experiment") + more


def document(flights: Sequence[ComparedFlight], differences: Sequence[FieldDifference]) -> str:
    """The two flights in words, and a Markdown table of what differs between them, narrow enough to be seen whole."""
    sources = tuple(flight.scales.source for flight in flights)
    outcomes = tuple(flight.log.outcome for flight in flights)
    rows = [
        *differences,
        *(() if differences else [("experiment", "the same", "the same")]),
        *([("outcome", *outcomes)] if len(set(outcomes)) > 1 else []),
        *([("positions by", *sources)] if len(set(sources)) > 1 else []),
    ]
    cells = [" | ".join(_plain(cell, LONGEST_CELL) for cell in row) for row in rows]
    table = ["| | A (blue) | B (pink) |", "|---|---|---|", *(f"| {row} |" for row in cells)]
    names = [
        f"{look.name} ({look.colour}): {_plain(flight.name)}, {flight.log.outcome}"
        for look, flight in zip(LOOKS, flights, strict=True)
    ]
    return "\n\n".join(["\n".join(table), *names])


LONGEST_CELL = 22
"""Characters of a cell: three of them fit into the view of a window of 1200 pixels."""


def _plain(text: str, most: int = 200) -> str:
    """Text that is no Markdown; of a longer one its ends, since a path differs at its end."""
    text = text.replace("|", "/").replace("\n", " ")
    return text if len(text) <= most else f"{text[: most // 3]}\u2026{text[-(most - most // 3 - 1) :]}"
