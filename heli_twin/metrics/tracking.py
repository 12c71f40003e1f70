"""What a flight was worth: pure functions of its recorded wires, the same live and from a file."""

from collections import Counter
from typing import Any, NamedTuple

import numpy as np

from controllers.signals import Array
from heli_twin.recording import Log
from heli_twin.recording.log import Times

SETTLING = 2.0
"""Errors of the first seconds are left out: the start is not what is measured."""
AXES = ("x", "y", "z", "yaw")


class TrackingError(NamedTuple):
    """Truth minus reference over a flight."""

    time: Array
    """(n,) s."""
    error: Array
    """(n, 4) x y z (world, m), yaw (rad, in [-pi, pi))."""
    reference: Array
    """(n, 4) what the error is of: x y z (world, m), yaw (rad)."""


def tracking_error(log: Log, after: float = 0.0) -> TrackingError:
    """Where the helicopter was, minus where it should have been, at every control step from `after` (s) on."""
    truth, reference = log.truth, log.reference
    stamp, planned, flown = truth.stamp, reference.x[:, :4], np.column_stack([truth.position, truth.yaw])
    if not np.array_equal(stamp, reference.stamp):
        # Of a log with gaps.
        stamp, of_truth, of_reference = np.intersect1d(stamp, reference.stamp, return_indices=True)
        planned, flown = planned[of_reference], flown[of_truth]
    error = flown - planned
    error[:, 3] = (error[:, 3] + np.pi) % (2 * np.pi) - np.pi
    time = np.asarray(1e-9 * stamp, dtype=np.float64)
    kept = time >= after
    return TrackingError(time[kept], error[kept], planned[kept])


def metrics(log: Log) -> dict[str, Any]:
    """The numbers of a flight, ready for JSON.

    `max_abs_error`, `rmse` and `mse` (the paper's average squared error) each hold x y z (m, m^2) and yaw (rad,
    rad^2) against the truth, the first `SETTLING` seconds left out; null where the flight was over before.
    `control_step_ms` and `solve_ms` are measured times.
    """
    error = tracking_error(log, SETTLING).error
    magnitude = np.abs(error)
    return {
        "outcome": log.outcome,
        "duration": 1e-9 * int(log.ending.get("time", 0)),
        "settling": SETTLING,
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
    """Median, 99th percentile and maximum in ms; null where there is nothing."""
    if not len(ns):
        return {"p50": None, "p99": None, "max": None}
    p50, p99, greatest = (1e-6 * np.percentile(ns, [50, 99, 100])).tolist()
    return {"p50": p50, "p99": p99, "max": greatest}
