"""Tracking errors and timing of a recorded flight."""

from collections import Counter
from typing import Any, NamedTuple

import numpy as np

from controllers.rotations import wrap_angle
from controllers.signals import Array
from heli_twin.recording import Log
from heli_twin.recording.log import Times

SETTLING_S = 2.0
"""The first seconds of a flight, whose errors are left out: metrics do not judge the start."""
AXES = ("x", "y", "z", "yaw")


class TrackingError(NamedTuple):
    """Truth minus reference over a flight."""

    time: Array
    """(n,) s."""
    error: Array
    """(n, 4) x y z (world, m), yaw (rad, in [-pi, pi))."""
    reference: Array
    """(n, 4) the planned x y z (world, m), yaw (rad)."""


def tracking_error(log: Log, after: float = 0.0) -> TrackingError:
    """Truth minus reference at every control step from `after` (s) on."""
    truth, reference = log.truth, log.reference
    stamp, planned, flown = truth.stamp, reference.x[:, :4], np.column_stack([truth.position, truth.yaw])
    if not np.array_equal(stamp, reference.stamp):
        # A log with gaps.
        stamp, of_truth, of_reference = np.intersect1d(stamp, reference.stamp, return_indices=True)
        planned, flown = planned[of_reference], flown[of_truth]
    error = flown - planned
    error[:, 3] = wrap_angle(error[:, 3])
    time = np.asarray(1e-9 * stamp, dtype=np.float64)
    kept = time >= after
    return TrackingError(time[kept], error[kept], planned[kept])


def metrics(log: Log) -> dict[str, Any]:
    """The metrics of a flight as plain values for JSON.

    `max_abs_error`, `rmse` and `mse` (the paper's average squared error) each hold x y z (m, m^2) and yaw (rad,
    rad^2) against the truth, the first `SETTLING_S` left out; None where the flight was shorter.
    `control_step_ms` and `solve_ms` are measured times.
    """
    error = tracking_error(log, SETTLING_S).error
    magnitude = np.abs(error)
    return {
        "outcome": log.outcome,
        "duration": 1e-9 * log.ending.time,
        "settling": SETTLING_S,
        "max_abs_error": _by_axis(magnitude.max(axis=0) if len(error) else None),
        "rmse": _by_axis(np.sqrt((error**2).mean(axis=0)) if len(error) else None),
        "mse": _by_axis((error**2).mean(axis=0) if len(error) else None),
        "control_step_ms": milliseconds(log.timing.control_step_ns),
        "solve_ms": milliseconds(log.timing.solve_ns),
        "qp_status": dict(sorted(Counter(log.qp.status.tolist()).items())),
    }


def _by_axis(values: Array | None) -> dict[str, float | None]:
    return dict(zip(AXES, values.tolist() if values is not None else [None] * 4, strict=True))


def milliseconds(ns: Times) -> dict[str, float | None]:
    """Median, 99th percentile and maximum in ms; None for no samples."""
    if not len(ns):
        return {"p50": None, "p99": None, "max": None}
    p50, p99, greatest = (1e-6 * np.percentile(ns, [50, 99, 100])).tolist()
    return {"p50": p50, "p99": p99, "max": greatest}
