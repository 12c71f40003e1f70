"""The metrics of a flight for studies, beyond those of `heli_twin.metrics.tracking`."""

from typing import Any

import numpy as np

from controllers.laws import ControlLaw
from controllers.signals import Array
from heli_twin.metrics.response import overshoot, phase_lag, settling_time
from heli_twin.metrics.tracking import AXES, SETTLING_S, tracking_error
from heli_twin.recording import Log

SUSTAINED_S = 1.0
"""Length of the window over which `sustained` averages."""
PERIOD_S = 0.02
"""Control period if the controller is not known."""
AT_LIMIT = 1e-6
"""Fraction of full stick: an input this near to a limit is at it. Controllers clip to the limits exactly."""


def measures(log: Log, controller: ControlLaw | None = None) -> dict[str, Any]:
    """The metrics of a flight for studies, as plain values for JSON; the first `SETTLING_S` are left out.

    Position errors are distances in space. `sustained` is the root mean square error of the worst `SUSTAINED_S`, which
    also catches a limit cycle that passes through zero. `bias` is the mean error, `spread` its standard deviation.
    `effort` is the variance of the inputs, summed; `variation` the total change of an input per second; `saturated` the
    share of time at a limit of the believed model, of the input that is there longest. `tilt.max` (rad) is over the
    whole flight. `metrics.response` defines `phase_lag` (s), `settling_time` (s from the start of the flight) and
    `overshoot` (share of the step). `deadline_misses` counts control steps that took longer than the period.

    Args:
        log: The flight.
        controller: The controller that flew. Without it, `saturated` and `deadline_misses` are None.

    Returns:
        Values by name; None where the flight has no data for one.
    """
    period = controller.period if controller else PERIOD_S
    time, whole, reference = tracking_error(log)
    answered, start = reference + whole, int(np.searchsorted(time, SETTLING_S))
    error = whole[start:]
    distance = np.linalg.norm(error[:, :3], axis=1)
    lengths = np.column_stack([np.abs(error), distance])
    names = (*AXES, "position")
    nothing = len(error) == 0
    unsolved, took = log.qp.status != "solved", 1e-9 * log.timing.control_step_ns
    return {
        "rmse.position": None if nothing else float(np.sqrt((distance**2).mean())),
        "mse.position": None if nothing else float((distance**2).mean()),
        "max_abs_error.position": None if nothing else float(distance.max()),
        **_each("p95", names, None if nothing else np.percentile(lengths, 95, axis=0)),
        **_each("bias", AXES, None if nothing else error.mean(axis=0)),
        **_each("spread", AXES, None if nothing else error.std(axis=0)),
        **_each("sustained", names, sustained(lengths, round(SUSTAINED_S / period))),
        **{f"phase_lag.{a}": phase_lag(reference[:, i], answered[:, i], period, start) for i, a in enumerate(AXES)},
        **{f"overshoot.{a}": overshoot(reference[:, i], answered[:, i], period) for i, a in enumerate(AXES)},
        "settling_time": settling_time(time, np.linalg.norm(whole[:, :3], axis=1)),
        **_inputs(log, controller),
        "tilt.max": _tilt(log),
        "qp.iterations": float(log.qp.iterations.mean()) if len(log.qp.iterations) else None,
        "qp.unsolved": int(unsolved.sum()) if len(unsolved) else None,
        "deadline_misses": int((took > controller.period).sum()) if controller and len(took) else None,
    }


def sustained(lengths: Array, hold: int) -> Array | None:
    """The greatest root mean square of each column over `hold` consecutive samples; None for fewer samples."""
    hold = max(1, hold)
    if len(lengths) < hold:
        return None
    total = np.cumsum(np.vstack([np.zeros(lengths.shape[1]), lengths**2]), axis=0)
    return np.sqrt(np.maximum(total[hold:] - total[:-hold], 0.0).max(axis=0) / hold)


def _inputs(log: Log, controller: ControlLaw | None) -> dict[str, Any]:
    """Metrics of the inputs sent from `SETTLING_S` on."""
    kept = 1e-9 * log.sent.time >= SETTLING_S
    u, time = log.sent.u[kept], log.sent.time[kept]
    seconds = 1e-9 * float(time[-1] - time[0]) if len(time) else 0.0
    if seconds <= 0:
        return {"effort": None, **_each("variation", AXES, None), "saturated": None}
    saturated = None
    if controller:
        low, high = np.array(controller.model.u_min), np.array(controller.model.u_max)
        saturated = float(((u <= low + AT_LIMIT) | (u >= high - AT_LIMIT)).mean(axis=0).max())
    return {
        "effort": float(u.var(axis=0).sum()),
        **_each("variation", AXES, np.abs(np.diff(u, axis=0)).sum(axis=0) / seconds),
        "saturated": saturated,
    }


def _tilt(log: Log) -> float | None:
    """The greatest angle between mast and vertical, rad."""
    q = log.truth.quat_wxyz
    if not len(q):
        return None
    return float(2 * np.arcsin(np.sqrt(np.clip(q[:, 1] ** 2 + q[:, 2] ** 2, 0, 1)).max()))


def _each(name: str, axes: tuple[str, ...], values: Array | None) -> dict[str, float | None]:
    return {f"{name}.{axis}": None if values is None else float(values[i]) for i, axis in enumerate(axes)}
