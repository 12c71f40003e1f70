"""What a study wants to know of a flight beyond `heli_twin.metrics.tracking`: pure functions of its log."""

from math import inf
from typing import Any

import numpy as np

from controllers.signals import Array
from heli_twin.metrics.response import overshoot, phase_lag, settling_time
from heli_twin.metrics.tracking import AXES, SETTLING, tracking_error
from heli_twin.recording import Log

HOLD = 1.0
"""s: the time over which an error has to last to count as sustained."""


def measures(log: Log, period: float = 0.02, deadline: float = inf) -> dict[str, Any]:
    """More numbers of a flight, the first `SETTLING` seconds left out.

    Position errors are lengths in space. `sustained` is the root mean square error of the worst `HOLD` seconds: a
    graded measure that a limit cycle cannot hide from by passing through zero. `bias` is the mean error, `spread` its
    standard deviation; `effort` the mean square of the input's deviation from its own mean, `variation`
    the way an input travels in a second, `saturated` the share of time at a limit. `phase_lag` (s), `settling_time` (s
    from the start of the flight) and `overshoot` (a share of the step) are as `studies.response` defines them.

    Args:
        log: The flight.
        period: Of control, s.
        deadline: A control step that computed longer than this (s, measured) was late.
    """
    time, whole, reference = tracking_error(log)
    answered, start = reference + whole, int(np.searchsorted(time, SETTLING))
    error = whole[start:]
    distance = np.linalg.norm(error[:, :3], axis=1)
    lengths = np.column_stack([np.abs(error), distance])
    names = (*AXES, "position")
    nothing = len(error) == 0
    late = 1e-9 * log.timing.control_step_ns > deadline
    return {
        "rmse.position": None if nothing else float(np.sqrt((distance**2).mean())),
        "mse.position": None if nothing else float((distance**2).mean()),
        "max_abs_error.position": None if nothing else float(distance.max()),
        **_each("p95", names, None if nothing else np.percentile(lengths, 95, axis=0)),
        **_each("bias", AXES, None if nothing else error.mean(axis=0)),
        **_each("spread", AXES, None if nothing else error.std(axis=0)),
        **_each("sustained", names, sustained(lengths, round(HOLD / period))),
        **{f"phase_lag.{a}": phase_lag(reference[:, i], answered[:, i], period, start) for i, a in enumerate(AXES)},
        **{f"overshoot.{a}": overshoot(reference[:, i], answered[:, i], period) for i, a in enumerate(AXES)},
        "settling_time": settling_time(time, np.linalg.norm(whole[:, :3], axis=1)),
        **_inputs(log),
        "tilt.max": _tilt(log),
        "qp.iterations": float(log.qp.iterations.mean()) if len(log.qp.iterations) else None,
        "qp.unsolved": int(np.sum(log.qp.status != "solved")),
        "deadline_misses": int(late.sum()),
    }


def sustained(lengths: Array, hold: int) -> Array | None:
    """The greatest root mean square of each column over `hold` samples in a row; None if it is too short."""
    hold = max(1, hold)
    if len(lengths) < hold:
        return None
    total = np.cumsum(np.vstack([np.zeros(lengths.shape[1]), lengths**2]), axis=0)
    return np.sqrt(np.maximum(total[hold:] - total[:-hold], 0.0).max(axis=0) / hold)


def _inputs(log: Log) -> dict[str, Any]:
    """How hard the sticks worked, from `SETTLING` on."""
    sent = log.sent
    u = sent.u[1e-9 * sent.time >= SETTLING]
    seconds = 1e-9 * float(sent.time[-1] - sent.time[0]) - SETTLING if len(sent.time) else 0.0
    if len(u) < 2 or seconds <= 0:
        return {"effort": None, **_each("variation", AXES, None), "saturated": None}
    top, bottom = u.max(axis=0), u.min(axis=0)
    at_limit = ((u == top) | (u == bottom)).mean(axis=0)
    # An input that touches its extreme once has not saturated.
    return {
        "effort": float(u.var(axis=0).sum()),
        **_each("variation", AXES, np.abs(np.diff(u, axis=0)).sum(axis=0) / seconds),
        "saturated": float(np.where(at_limit > 2.5 / len(u), at_limit, 0.0).max()),
    }


def _tilt(log: Log) -> float | None:
    """The greatest angle between mast and vertical, rad."""
    q = log.truth.quat_wxyz
    if not len(q):
        return None
    return float(2 * np.arcsin(np.sqrt(np.clip(q[:, 1] ** 2 + q[:, 2] ** 2, 0, 1)).max()))


def _each(name: str, axes: tuple[str, ...], values: Array | None) -> dict[str, float | None]:
    return {f"{name}.{axis}": None if values is None else float(values[i]) for i, axis in enumerate(axes)}
