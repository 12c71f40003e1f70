"""Two flights in one picture: both helicopters in one scene, their errors in one plot, and B minus A."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from controllers.signals import Array
from heli_twin.recording.log import Log, Times
from heli_twin.viewing.blueprint import Scales, blueprint, plot, scene
from heli_twin.viewing.entities import Rows, scalars, tracking, turned
from heli_twin.viewing.live import send, send_rows
from heli_twin.viewing.sinks import Sink, deliver
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

LOOKS = (Look("A", FLOWN, WANTED, FLOWN), Look("B", RIVAL, RIVAL_WANTED, RIVAL))


class Run(NamedTuple):
    """One of the two flights."""

    log: Log
    scales: Scales
    name: str
    """Of its file."""


class Difference(NamedTuple):
    """A field in which two experiments differ, as text."""

    field: str
    """Dotted path."""
    a: str
    b: str


def show_both(a: Run, b: Run, differences: Sequence[Difference], sink: Sink) -> None:
    """Show two flights as `/A` and `/B` of one recording.

    Raises:
        LogError: No viewer listens or answers, or the file cannot be written.
    """
    runs = [run._replace(scales=run.scales.seeing(run.log)) for run in (a, b)]

    def fill(stream: rr.RecordingStream) -> None:
        stream.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        for run, look in zip(runs, LOOKS, strict=True):
            send_static(stream, look)
            send(stream, run.log, run.scales, look.path(""))
            for some in _errors(run.log, look):
                send_rows(stream, some)
        for some in _difference(a.log, b.log):
            send_rows(stream, some)
        _send_styles(stream)
        text = rr.TextDocument(document(runs, differences), media_type=rr.MediaType.MARKDOWN)
        stream.log("differences", text, static=True)

    deliver(sink, _layout(runs, differences), fill)


def difference(a: Log, b: Log) -> tuple[Times, Array]:
    """Truth of B minus truth of A at A's times (n,) that B was in the air too: x y z (world, m), yaw (rad) as (n, 4).

    B stands between its own times on a straight line; the yaw is in [-pi, pi).
    """
    (t, of_a), (t_b, of_b) = _poses(a), _poses(b)
    if not len(t_b):
        return t[:0], of_a[:0]
    common = (t >= t_b[0]) & (t <= t_b[-1])
    t, of_a = t[common], of_a[common]
    seconds, seconds_b = 1e-9 * t, 1e-9 * t_b
    minus = np.column_stack([np.interp(seconds, seconds_b, of_b[:, i]) for i in range(4)]) - of_a
    minus[:, 3] = turned(minus[:, 3])
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


def _send_styles(stream: rr.RecordingStream) -> None:
    """Lines of one plot are told apart by the flight, not by the wire."""
    for look in LOOKS:
        for entity in ("tracking/position", "tracking/yaw", *(f"position/{name}/truth" for name in POSITIONS)):
            stream.log(look.path(entity), lines([look.name], [look.flown]), static=True)
        for name in POSITIONS:
            style = lines([f"{look.name} reference"], [look.wanted], 1.0)
            stream.log(look.path(f"position/{name}/reference"), style, static=True)
        for name in INPUTS:
            stream.log(look.path(f"input/{name}/sent"), lines([look.name], [look.flown], held=True), static=True)
    stream.log("difference/position", lines([*"xyz"], AXES), static=True)
    stream.log("difference/yaw", lines(["yaw"], [YAW]), static=True)


def _layout(runs: Sequence[Run], differences: Sequence[Difference]) -> rrb.Blueprint:
    paths = [run.scales.path for run in runs if run.scales.path is not None]
    named = f"A blue, B pink, plans orange: {_in_short(differences)}"
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
                )
                for name in POSITIONS
            ),
            name="Position",
        ),
        rrb.Vertical(
            *(_plot_both(f"{name} sent [of full stick]", f"input/{name}/sent") for name in INPUTS), name="Inputs"
        ),
        rrb.Vertical(
            rrb.StateTimelineView(name="Controller and contact", origin="/", contents=_of_both("state/**")),
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


def _in_short(differences: Sequence[Difference]) -> str:
    """What fits into a title."""
    first = ", ".join(f"{d.field} {d.a} / {d.b}" for d in differences[:2])
    more = f" and {len(differences) - 2} more" if len(differences) > 2 else ""
    return (first or "the same experiment") + more


def document(runs: Sequence[Run], differences: Sequence[Difference]) -> str:
    """A Markdown table: the two flights, and what differs between them."""
    rows = [
        ("file", *(run.name for run in runs)),
        ("outcome", *(run.log.outcome for run in runs)),
        *differences,
        *(() if differences else [("experiment", "the same", "the same")]),
    ]
    cells = [" | ".join(cell.replace("|", "/").replace("\n", " ") for cell in row) for row in rows]
    return "\n".join(["| | A (blue) | B (pink) |", "|---|---|---|", *(f"| {row} |" for row in cells)])
