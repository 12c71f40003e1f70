"""How several helicopters in one room flew: how near they came to each other, and whether they reached their goals.

Distances are between the centres of gravity. Between two samples both move in a straight line at constant speed, which
gives the least distance between the samples too.
"""

import json
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from controllers.coordinations import CommittedPlan
from controllers.signals import Array
from controllers.trajectories import Trajectory, fitted
from heli_twin.experiment import Experiment
from heli_twin.metrics.flat import flat
from heli_twin.metrics.measures import measures
from heli_twin.metrics.motion import in_seconds, motion
from heli_twin.metrics.tracking import metrics, milliseconds
from heli_twin.recording import Log

ARRIVED_M = 0.15
"""Who stays within this distance of its goal has arrived: gusts push a hovering helicopter as far."""
STANDING_M_S = 0.02
"""A plan that moves slower than this stands."""
PLAN_GRID_S = 0.02
"""Step at which plans are compared."""


USUAL_DISTANCE_M = 0.3
"""Width of the cylinders where the coordination keeps no distance of its own."""
CYLINDER_HEIGHT_M = 0.3


class Nearest(NamedTuple):
    """Where two helicopters were nearest to each other."""

    distance: float
    """m."""
    time: float
    """s."""
    ships: tuple[str, str]


def nearest(paths: Mapping[str, tuple[Array, Array]], axes: int = 3) -> Nearest | None:
    """Return the least distance of any two, None for a single one.

    Args:
        paths: Of each by its name: times (n,), s, ascending, and positions (n, 3), world, m.
        axes: 3 for distances in space, 2 for those in the plane.
    """
    found = [Nearest(*least, (a, b)) for a, b in combinations(paths, 2) if (least := _least(paths[a], paths[b], axes))]
    return min(found, default=None)


def _least(a: tuple[Array, Array], b: tuple[Array, Array], axes: int) -> tuple[float, float] | None:
    """Return the least distance, m, of two that move in straight lines between samples, and its time, s."""
    time, apart = apart_over_time(a, b)
    if not len(time):
        return None
    start, move = apart[:-1, :axes], np.diff(apart[:, :axes], axis=0)
    if not len(start):
        return float(np.linalg.norm(apart[0, :axes])), float(time[0])
    square = np.einsum("ij,ij->i", move, move)
    share = np.clip(-np.einsum("ij,ij->i", start, move) / np.maximum(square, 1e-15), 0.0, 1.0)
    distance = np.linalg.norm(start + share[:, None] * move, axis=1)
    i = int(np.argmin(distance))
    return float(distance[i]), float(time[i] + share[i] * (time[i + 1] - time[i]))


def apart_over_time(a: tuple[Array, Array], b: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return the times (n,), s, at which either has a sample and both were recorded, and b minus a then, (n, 3), m."""
    (time_a, of_a), (time_b, of_b) = a, b
    if not len(time_a) or not len(time_b):
        return np.zeros(0), np.zeros((0, 3))
    first, last = max(time_a[0], time_b[0]), min(time_a[-1], time_b[-1])
    time = np.union1d(time_a, time_b)
    time = time[(time >= first) & (time <= last)]

    def at(own: Array, position: Array) -> Array:
        return np.column_stack([np.interp(time, own, position[:, i]) for i in range(3)])

    return time, at(time_b, of_b) - at(time_a, of_a)


def flown_paths(logs: Mapping[str, Log]) -> dict[str, tuple[Array, Array]]:
    """Return times (n,), s, and positions (n, 3), m, of each; one whose flight is over stays where it was."""
    ends = [1e-9 * log.ending.time for log in logs.values()]
    paths: dict[str, tuple[Array, Array]] = {}
    for name, log in logs.items():
        moved = motion(log)
        time, position = moved.time, moved.state[:, :3]
        if len(time) and time[-1] < max(ends):
            time, position = np.append(time, max(ends)), np.vstack([position, position[-1:]])
        paths[name] = time, position
    return paths


def planned_paths(logs: Mapping[str, Log], wishes: Mapping[str, Trajectory]) -> dict[str, tuple[Array, Array]]:
    """Return times (n,), s, and positions (n, 3), m, of what each was committed to at each time."""
    return {name: committed_path(log, wishes[name]) for name, log in logs.items()}


def committed_path(log: Log, wish: Trajectory) -> tuple[Array, Array]:
    """Return times (n,), s, and positions (n, 3), m, of what a helicopter was committed to at each time."""
    end = 1e-9 * log.ending.time
    time: Array = PLAN_GRID_S * np.arange(round(end / PLAN_GRID_S) + 1, dtype=np.float64)
    position = np.zeros((len(time), 3))
    starts = np.array([1e-9 * committed.time for committed in log.committed])
    which = np.searchsorted(starts, time + 1e-9, side="right") - 1
    for i in range(len(starts)):
        rows = which == i
        plan: CommittedPlan | Trajectory = log.committed[i].plan or wish
        position[rows] = plan.flat(time[rows]).z[:, :3]
    kept = which >= 0
    return time[kept], position[kept]


class Arrival(NamedTuple):
    """Whether one helicopter reached its goal."""

    arrived: bool
    time: float | None
    """When it was there for good, s; None for one that did not arrive, and for a wish that goes on."""
    stuck: float
    """How long its plan stood away from the goal, s."""


def arrival(log: Log, wish: Trajectory) -> Arrival:
    """Return whether a helicopter reached the end of its wish and stayed; of a wish that goes on, whether it flies it.

    Args:
        log: Of the helicopter.
        wish: What it wanted to fly.
    """
    moved = motion(log)
    if not len(moved.time):
        return Arrival(arrived=False, time=None, stuck=0.0)
    last = wish.flat(np.array([LONG_S]))
    goes_on = bool(np.linalg.norm(last.dz[0, :3]) > STANDING_M_S)
    goal = wish.flat(moved.time[-1:]).z[0, :3] if goes_on else last.z[0, :3]
    away = np.linalg.norm(moved.state[:, :3] - goal, axis=1) > ARRIVED_M
    there = log.outcome in ("completed", "landed") and not away[-1]
    when = float(moved.time[np.flatnonzero(away)[-1] + 1 if away.any() else 0]) if there and not goes_on else None
    return Arrival(there, when, 0.0 if goes_on else _stuck(log, goal))


LONG_S = 36_000.0
"""A wish that moves then goes on for ever."""


def _stuck(log: Log, goal: Array) -> float:
    """Return how long the plan stood away from the goal, s."""
    planned = log.reference
    if len(planned.time) < 2:
        return 0.0
    stands = np.linalg.norm(planned.velocity, axis=1) < STANDING_M_S
    away = np.linalg.norm(planned.position - goal, axis=1) > ARRIVED_M
    steps = np.diff(in_seconds(planned.time))
    # Every wish stands at its beginning.
    begun = np.maximum.accumulate(~stands)
    return float(steps[(stands & away & begun)[:-1]].sum())


def several_metrics(log: Log, wishes: Mapping[str, Trajectory]) -> dict[str, Any]:
    """The metrics of a flight of several helicopters as plain values for JSON.

    `least_distance` (m, in space) and `least_distance_in_plane` are between the centres of any two; `least_planned` is
    in the plane, between what they were committed to at the same time. `nearest` says who and when. `arrived` counts
    who stayed at its goal, `missing` who did not; `time_to_goal` (s) is that of the last of them, None if one did not
    arrive. `stuck` (s) is how long plans stood away from their goals, summed. `refused_plans` counts turns of planners
    in which a new plan was refused; `planning_ms` are measured times of turns.

    Args:
        log: Of all.
        wishes: What each wanted to fly, by name.
    """
    logs = {name: log.ship(name) for name in log.ships}
    flown, planned = flown_paths(logs), planned_paths(logs, wishes)
    arrivals = {name: arrival(ship, wishes[name]) for name, ship in logs.items()}
    space, plane, plans = nearest(flown), nearest(flown, axes=2), nearest(planned, axes=2)
    times = [each.time for each in arrivals.values()]
    turns = [turn for ship in logs.values() for turn in ship.planning]
    return {
        "outcome": log.outcome,
        "duration": 1e-9 * log.ending.time,
        "ships": len(logs),
        "least_distance": space.distance if space else None,
        "least_distance_in_plane": plane.distance if plane else None,
        "nearest": {"ships": list(plane.ships), "time": plane.time} if plane else None,
        "least_planned": plans.distance if plans else None,
        "nearest_planned": {"ships": list(plans.ships), "time": plans.time} if plans else None,
        "arrived": sum(each.arrived for each in arrivals.values()),
        "missing": sum(not each.arrived for each in arrivals.values()),
        "time_to_goal": _greatest(times) if all(each.arrived for each in arrivals.values()) else None,
        "stuck": sum(each.stuck for each in arrivals.values()),
        "turns": len(turns),
        "refused_plans": sum(turn.outcome == "refused" for turn in turns),
        "messages": sum(turn.sent for turn in turns),
        "planning_ms": milliseconds(
            np.concatenate([np.zeros(0, np.int64), *(ship.planning_ns for ship in logs.values())])
        ),
    }


def pooled_metrics(log: Log, fleet: Mapping[str, Experiment]) -> dict[str, Any]:
    """The metrics of all helicopters as one table: those of the room, and of each that one flight has the largest.

    Args:
        log: Of all.
        fleet: What each flew, by name.
    """
    each = [
        flat(metrics(log.ship(name))) | flat(measures(log.ship(name), fleet[name].controller))
        for name in log.ships
        if name in fleet
    ]
    row: dict[str, Any] = {}
    for key in dict.fromkeys(key for of_one in each for key in of_one):
        values = [value for of_one in each if isinstance(value := of_one.get(key), int | float)]
        row[key] = max(values) if len(values) == len(each) else None
    wishes = {name: fitted(e.trajectory, e.controller.model) for name, e in fleet.items()}
    together = flat(several_metrics(log, wishes))
    return row | {key: " ".join(value) if isinstance(value, list) else value for key, value in together.items()}


def _greatest(times: Sequence[float | None]) -> float | None:
    return max((time for time in times if time is not None), default=None)


def least_over_time(paths: Mapping[str, tuple[Array, Array]], axes: int = 2) -> tuple[Array, Array]:
    """Return times (n,), s, and the least distance of any two then, m; in the plane, or in space for 3 axes."""
    if len(paths) < 2:
        return np.zeros(0), np.zeros(0)
    time = np.unique(np.concatenate([time for time, _ in paths.values()]))
    at = {
        name: np.column_stack([np.interp(time, own, position[:, i]) for i in range(axes)])
        for name, (own, position) in paths.items()
        if len(own)
    }
    apart = [np.linalg.norm(at[a] - at[b], axis=1) for a, b in combinations(at, 2)]
    return time, np.min(apart, axis=0) if apart else np.full(len(time), np.inf)


def promised_distance(log: Log) -> float:
    """Return the distance that the coordination of a log keeps between plans, m; `USUAL_DISTANCE_M` if it has none."""
    try:
        distance = json.loads(log.experiment)["coordination"]["distance"]
    except (ValueError, KeyError, TypeError, RecursionError):
        return USUAL_DISTANCE_M
    return float(distance) if isinstance(distance, int | float) and 0.0 < distance < 10.0 else USUAL_DISTANCE_M
