"""Two flights in one picture: both helicopters in one scene, their errors in one plot, and B minus A."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from controllers.rotations import wrap_angle
from controllers.signals import Array
from heli_twin.recording.log import Log, Times
from heli_twin.viewing.blueprint import Scales, blueprint, plot, scene
from heli_twin.viewing.delivery import Destination, deliver
from heli_twin.viewing.entities import Rows, scalars, tracking
from heli_twin.viewing.live import send, send_rows
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
    lines,
    send_static,
)

LOOKS = (Look("A", "blue", FLOWN, WANTED, FLOWN), Look("B", "pink", RIVAL, RIVAL_WANTED, RIVAL))


FieldDifference = tuple[str, str, str]
"""Dotted path of a field in which two experiments differ, and its values in A and in B, as text."""


class ComparedFlight(NamedTuple):
    """One of the two flights."""

    log: Log
    scales: Scales
    name: str
    """The log file's."""


def show_both(
    a: ComparedFlight, b: ComparedFlight, differences: Sequence[FieldDifference], destination: Destination
) -> None:
    """Show two flights as `/A` and `/B` of one recording.

    Raises:
        LogError: No viewer listens or answers, or the file cannot be written.
    """
    flights = [flight._replace(scales=flight.scales.for_log(flight.log)) for flight in (a, b)]

    def fill(stream: rr.RecordingStream) -> None:
        stream.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        for flight, look in zip(flights, LOOKS, strict=True):
            send_static(stream, look, flight.scales.source, flight.scales.shape)
            send(stream, flight.log, flight.scales, look.path(""))
            for entity_rows in _errors(flight.log, look):
                send_rows(stream, entity_rows)
        for entity_rows in _difference(a.log, b.log):
            send_rows(stream, entity_rows)
        _send_styles(stream, flights)
        text = rr.TextDocument(document(flights, differences), media_type=rr.MediaType.MARKDOWN)
        stream.log("differences", text, static=True)

    deliver(destination, _layout(flights, differences), fill)


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


def _layout(flights: Sequence[ComparedFlight], differences: Sequence[FieldDifference]) -> rrb.Blueprint:
    paths = [flight.scales.path for flight in flights if flight.scales.path is not None]
    colours = ", ".join(
        f"{look.name} {look.colour}{'' if flight.scales.source == 'truth' else f' by the {flight.scales.source}'}"
        for look, flight in zip(LOOKS, flights, strict=True)
    )
    named = f"{colours}, plans orange: {_in_short(differences)}"
    seen = rrb.Vertical(
        scene(named, np.concatenate(paths) if paths else None, [f"/{look.name}" for look in LOOKS]),
        rrb.Horizontal(
            rrb.TextDocumentView(name="What differs", origin="/differences"),
            rrb.TextLogView(
                name="Events",
                origin="/",
                contents=_of_both("events"),
                columns=rrb.TextLogColumns(text_log_columns=["EntityPath", "LogLevel", "Body"]),
            ),
        ),
        row_shares=[5, 2],
    )
    plots = rrb.Tabs(
        rrb.Vertical(
            _plot_both("Distance from the reference [cm]: A blue, B pink", "tracking/position"),
            _plot_both("Yaw error [deg]: A blue, B pink", "tracking/yaw"),
            plot("Position of B minus A [cm]", "/difference/position"),
            plot("Yaw of B minus A [deg]", "/difference/yaw"),
            name="Errors and difference",
            row_shares=[3, 2, 3, 2],
        ),
        rrb.Vertical(
            *(
                _plot_both(
                    f"{name} [{'deg' if name == 'yaw' else 'm'}]",
                    f"position/{name}/reference",
                    f"position/{name}/truth",
                    f"position/{name}/cameras",
                )
                for name in POSITIONS
            ),
            name="Position",
        ),
        rrb.Vertical(
            *(_plot_both(f"{name} sent [of full stick]", f"input/{name}/sent") for name in INPUTS), name="Inputs"
        ),
        rrb.Vertical(
            rrb.StateTimelineView(name="Controller, supervisor and contact", origin="/", contents=_of_both("state/**")),
            *(plot(f"Computing of {look.name} [ms]", f"/{look.name}/computing") for look in LOOKS),
            name="Controller",
        ),
        active_tab=0,
    )
    return blueprint(seen, plots)


def _plot_both(name: str, *entities: str) -> rrb.TimeSeriesView:
    return plot(name, "/", contents=[content for entity in entities for content in _of_both(entity)])


def _of_both(entity: str) -> list[str]:
    return [f"+ /{look.path(entity)}" for look in LOOKS]


def _in_short(differences: Sequence[FieldDifference]) -> str:
    """The first differences, short enough for a title."""
    first = ", ".join(f"{field} {a} / {b}" for field, a, b in differences[:2])
    more = f" and {len(differences) - 2} more" if len(differences) > 2 else ""
    return (first or "the same experiment") + more


def document(flights: Sequence[ComparedFlight], differences: Sequence[FieldDifference]) -> str:
    """A Markdown table: the two flights, and what differs between them."""
    rows = [
        ("file", *(flight.name for flight in flights)),
        ("outcome", *(flight.log.outcome for flight in flights)),
        ("positions by", *(flight.scales.source for flight in flights)),
        *differences,
        *(() if differences else [("experiment", "the same", "the same")]),
    ]
    cells = [" | ".join(cell.replace("|", "/").replace("\n", " ") for cell in row) for row in rows]
    return "\n".join(["| | A (blue) | B (pink) |", "|---|---|---|", *(f"| {row} |" for row in cells)])
