"""Several helicopters in one scene: each with its plans and its safety cylinder, and how near they come."""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from controllers.signals import Array
from heli_twin.experiment import Experiment
from heli_twin.lab.plant.size import RADIUS_M
from heli_twin.metrics.several import CYLINDER_HEIGHT_M, flown_paths, least_over_time, planned_paths, promised_distance
from heli_twin.recording.log import Log
from heli_twin.reporting.figure import color
from heli_twin.viewing.blueprint import Scales, Tab, blueprint, in_tabs, plot, scene
from heli_twin.viewing.delivery import Destination, deliver
from heli_twin.viewing.entities import Rows, scalars, tracking
from heli_twin.viewing.live import send, send_rows
from heli_twin.viewing.style import (
    BELIEVED,
    FLOWN,
    LIMIT,
    PLANNED,
    WANTED,
    YAW,
    Look,
    floor_mark,
    lines,
    rgba,
    send_static,
)

PLAN_POINTS = 40
BLACK = "#000000"
TURN_COLOURS = {"committed": BELIEVED, "kept": YAW, "refused": LIMIT}
"""By what a planner did in its turn."""


class Seen(NamedTuple):
    """One of several helicopters as it is shown."""

    log: Log
    experiment: Experiment
    scales: Scales
    look: Look


def show_ships(log: Log, ships: Mapping[str, tuple[Experiment, Scales]], where: Destination, tab: str = "") -> None:
    """Show several helicopters, each under its name.

    Args:
        log: Of all.
        ships: What each flew, and what its plots compare with, by name.
        where: Where they are shown.
        tab: Name of the plots in front; empty for those of the distances.

    Raises:
        LogError: No viewer listens or answers, the file cannot be written, or there is no such tab.
    """
    seen = [
        Seen(log.ship(name), experiment, scales.for_log(log.ship(name)), _look(name, i))
        for i, (name, (experiment, scales)) in enumerate(ships.items())
    ]
    paths = [each.scales.path for each in seen if each.scales.path is not None]
    path = np.concatenate(paths) if paths else None
    promised = promised_distance(log)

    def fill(stream: rr.RecordingStream) -> None:
        stream.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        for i, each in enumerate(seen):
            send_static(stream, each.look, each.scales.source, each.scales.shape, None if i else floor_mark(path))
            _send_safety(stream, each, promised)
            send(stream, each.log, each.scales, each.look.path(""))
            for entity_rows in _of_one(each):
                send_rows(stream, entity_rows)
        _send_distances(stream, seen, promised)

    deliver(where, _layout(seen, path, tab), fill)


def _look(name: str, number: int) -> Look:
    # Black is not seen before the dark room.
    shade = YAW if color(number) == BLACK else int(color(number)[1:], 16) << 8 | 0xFF
    return Look(name, color(number), shade, WANTED, shade)


def _send_safety(stream: rr.RecordingStream, each: Seen, promised: float) -> None:
    """Send what does not change: the cylinder about the helicopter, and the looks of its plan and its plots."""
    cylinder = rr.Cylinders3D(
        radii=[0.5 * promised],
        lengths=[CYLINDER_HEIGHT_M],
        colors=rgba([each.look.flown & 0xFFFFFF00 | 0x50]),
        line_radii=[0.0015],
    )
    stream.log(each.look.path("world/safety"), cylinder, static=True)
    committed = rr.LineStrips3D.from_fields(radii=0.008, colors=rgba([each.look.flown & 0xFFFFFF00 | 0xA0]))
    stream.log(each.look.path("world/committed"), committed, static=True)
    stream.log(each.look.path("tracking/position"), lines([each.look.name], [each.look.flown]), static=True)
    style = rr.StateConfiguration(values=[*TURN_COLOURS], colors=rgba(TURN_COLOURS.values()))
    stream.log(each.look.path("planner"), style, static=True)


def _of_one(each: Seen) -> Iterator[Rows]:
    """Yield what one of several helicopters has beyond a flight alone."""
    truth, look = each.log.truth, each.look
    yield look.path("world/safety"), truth.time, rr.Transform3D.columns(translation=truth.position)
    committed = each.log.committed
    times = np.array([time for time, _ in committed], np.int64)
    strips = [_ahead(each, time) for time in times.tolist()]
    if strips:
        yield look.path("world/committed"), times, rr.LineStrips3D.columns(strips=np.array(strips, np.float32))
    t, error = tracking(each.log)
    yield look.path("tracking/position"), t, scalars(100 * np.linalg.norm(error[:, :3], axis=1))
    turns = np.array([turn.time for turn in each.log.planning], np.int64)
    if len(turns):
        outcomes = [turn.outcome for turn in each.log.planning]
        yield look.path("planner"), turns, rr.StateChange.columns(state=outcomes)


def _ahead(each: Seen, time: int) -> Array:
    """Return points (k, 3) of the plan that is committed to at a time, ns: to its end, or two seconds of the wish."""
    plan = next(committed.plan for committed in each.log.committed if committed.time == time)
    end = 1e-9 * time + 2.0 if plan is None else max(1e-9 * time, float(plan.times[-1]))
    t = np.linspace(1e-9 * time, end, PLAN_POINTS)
    return (plan or each.experiment.trajectory).flat(t).z[:, :3]


def _send_distances(stream: rr.RecordingStream, seen: list[Seen], promised: float) -> None:
    logs = {each.look.name: each.log for each in seen}
    wishes = {each.look.name: each.experiment.trajectory for each in seen}
    for name, colour, paths in (
        ("flown", FLOWN, flown_paths(logs)),
        ("planned", PLANNED, planned_paths(logs, wishes)),
    ):
        time, least = least_over_time(paths)
        stream.log(f"distance/{name}", lines([name], [colour]), static=True)
        send_rows(stream, (f"distance/{name}", np.rint(1e9 * time).astype(np.int64), scalars(least)))
    end = max((each.log.ending.time for each in seen), default=0)
    for name, level in (("promised", promised), ("touching", 2 * RADIUS_M)):
        stream.log(f"distance/{name}", lines([name], [LIMIT if name == "touching" else YAW], 1.0), static=True)
        send_rows(stream, (f"distance/{name}", np.array([0, end]), scalars(np.array([level, level]))))


def _layout(seen: list[Seen], path: Array | None, tab: str) -> rrb.Blueprint:
    names = [f"/{each.look.name}" for each in seen]
    planners = any(each.log.planning for each in seen)
    events = rrb.TextLogView(
        name="Events",
        origin="/",
        contents=[f"+ {name}/events" for name in names],
        columns=rrb.TextLogColumns(text_log_columns=["EntityPath", "LogLevel", "Body"]),
    )
    left = rrb.Vertical(
        scene(f"{len(seen)} helicopters; cylinders that touch are as near as plans may be", path, names, distance=0.75),
        events,
        row_shares=[4, 1],
    )
    distances = Tab(
        "Distance",
        [
            plot("Least distance in the plane [m]: flown blue, planned orange, promised yellow", "/distance"),
            plot(
                "Distance from the plan [cm], by the colour of the helicopter",
                "/",
                contents=[f"+ {name}/tracking/position" for name in names],
            ),
            *(
                [rrb.StateTimelineView(name="Planners", origin="/", contents=[f"+ {name}/planner" for name in names])]
                if planners
                else []
            ),
        ],
        [3, 3, 2][: 2 + planners],
    )
    states = Tab(
        "States",
        [rrb.StateTimelineView(name="States", origin="/", contents=[f"+ {name}/state/**" for name in names])],
        [1],
    )
    return blueprint(left, in_tabs([distances, states], tab))
