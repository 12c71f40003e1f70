"""Where the helicopter was and how far from its reference, by the truth or, where nobody knows it, by the cameras."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from controllers.rotations import wrap_angle, yaw_of
from controllers.signals import Array
from heli_twin.metrics.tracking import AXES, SETTLING_S, tracking_error
from heli_twin.recording import Log
from heli_twin.recording.log import Times


def in_seconds(ns: Times) -> Array:
    """Times (n,) in s."""
    return np.asarray(1e-9 * ns, np.float64)


class Motion(NamedTuple):
    """Where the helicopter was."""

    time: Array
    """(n,) s, ascending."""
    state: Array
    """(n, 4) x y z (world, m), yaw (rad, unwrapped)."""
    by_cameras: bool
    """True if nobody knows the truth, as of an imported recording."""


def motion(log: Log) -> Motion:
    """Where the helicopter was: by the truth, or by the cameras if the log has no truth."""
    truth, pose = log.truth, log.pose
    if len(truth.time) or not len(pose.time):
        return Motion(in_seconds(truth.stamp), np.column_stack([truth.position, truth.yaw]), by_cameras=False)
    stamp, first = np.unique(pose.stamp, return_index=True)
    yaw = np.unwrap(yaw_of(pose.quat_wxyz[first]))
    return Motion(in_seconds(stamp), np.column_stack([pose.position[first], yaw]), by_cameras=True)


def errors(log: Log) -> tuple[Array, Array]:
    """Position and yaw minus reference.

    Returns:
        Times (n,), s, and errors (n, 4): x y z (world, m), yaw (rad, in [-pi, pi)). No rows without a reference.
    """
    if len(log.truth.time):
        found = tracking_error(log)
        return found.time, found.error
    moved, planned = motion(log), log.reference
    time = in_seconds(planned.stamp)
    if not len(moved.time):
        return np.zeros(0), np.zeros((0, 4))
    kept = (time >= moved.time[0]) & (time <= moved.time[-1])
    there = np.column_stack([np.interp(time[kept], moved.time, moved.state[:, i]) for i in range(4)])
    error = there - planned.x[kept, :4]
    error[:, 3] = wrap_angle(error[:, 3])
    return time[kept], error


class Span(NamedTuple):
    """A time in which something was the case, s."""

    start: float
    end: float
    name: str


GAP_S = 0.08
"""A gap between poses of at least this length is an outage."""


def outages(log: Log) -> list[Span]:
    """The times without poses, s."""
    stamps = 1e-9 * np.unique(log.pose.stamp)
    if not len(stamps):
        return []
    usual = float(np.median(np.diff(stamps))) if len(stamps) > 1 else 0.0
    at = np.append(stamps, 1e-9 * log.ending.time)
    return [Span(a, b, "no poses") for a, b in pairwise(at) if b - a > max(GAP_S, 4 * usual)]


def statistics(log: Log, start: float = SETTLING_S, end: float | None = None) -> dict[str, dict[str, float]] | None:
    """Statistics of the magnitude of the error, named as evo names them.

    `sse` is the sum of the squared errors at the control steps, `std` the standard deviation of the magnitude.

    Args:
        log: The flight.
        start: First moment, s.
        end: Last moment, s; None for the end of the flight.

    Returns:
        Of `position` (the distance from the reference, m), `x`, `y`, `z` (m) and `yaw` (rad): rmse, mean, median, std,
        min, max, and sse (m^2, rad^2); None if no error was recorded in that time.

    Source: M. Grupp, evo, metrics.py: StatisticsType.
    """
    time, error = errors(log)
    kept = error[(time >= start) & (time <= (np.inf if end is None else end))]
    if not len(kept):
        return None
    magnitudes = {"position": np.linalg.norm(kept[:, :3], axis=1)}
    magnitudes |= {axis: np.abs(kept[:, i]) for i, axis in enumerate(AXES)}
    return {name: _statistics(values) for name, values in magnitudes.items()}


def _statistics(values: Array) -> dict[str, float]:
    sse = float((values**2).sum())
    return {
        "rmse": float(np.sqrt(sse / len(values))),
        "mean": float(values.mean()),
        "median": float(np.median(values)),
        "std": float(values.std()),
        "min": float(values.min()),
        "max": float(values.max()),
        "sse": sse,
    }
