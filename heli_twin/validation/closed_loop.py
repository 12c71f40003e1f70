"""In closed loop: the twin flown as the helicopter was flown, with the same plan and the same controller."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.stats import t as student

from controllers.markers import by_name
from controllers.rotations import wrap_angle, yaw_of
from controllers.signals import Array
from heli_twin.experiment import Experiment
from heli_twin.lab.disturbances.bias import Bias
from heli_twin.metrics.tracking import AXES, SETTLING_S
from heli_twin.mission import fly
from heli_twin.recording import Log
from heli_twin.workers.fleet import fleet

FIRST_SEED = 7_000
"""Of the twin's flights: all twins meet the same chance, which is not that of the log."""


class Loop(NamedTuple):
    """Distance from the plan of one axis, root mean square over a flight, m or rad."""

    flown: float
    """In the log."""
    twin: float
    """Mean of the twin's flights."""
    low: float
    """Lower end of where 95 % of the twin's flights lie; NaN for fewer than two."""
    high: float


def tracking_rms(log: Log) -> Array | None:
    """Return the root mean square (4,) of x y z (m) yaw (rad) minus the plan, as the cameras saw it; None without plan.

    The first `SETTLING_S` are left out.
    """
    pose, reference = log.pose, log.reference
    if len(reference.time) < 2 or len(pose.time) < 2:
        return None
    inside = (pose.stamp >= reference.stamp[0] + 1e9 * SETTLING_S) & (pose.stamp <= reference.stamp[-1])
    if not inside.any():
        return None
    seconds, planned = 1e-9 * pose.stamp[inside], 1e-9 * reference.stamp
    plan = reference.x[:, :4].copy()
    plan[:, 3] = np.unwrap(plan[:, 3])
    wanted = np.column_stack([np.interp(seconds, planned, column) for column in plan.T])
    error = np.column_stack([pose.position[inside], yaw_of(pose.quat_wxyz[inside])]) - wanted
    error[:, 3] = wrap_angle(error[:, 3])
    return np.sqrt(np.nanmean(error**2, axis=0))


def as_flown(log: Experiment, twin: Experiment, push: Array | None) -> Experiment:
    """Return the flight of a log with another helicopter in its air.

    Args:
        log: Says plan, controller, estimator and cameras; its faults are left out.
        twin: Says helicopter, radio, compute time and gusts.
        push: (3,) constant acceleration of that day, m/s^2; None for what the twin's lab has.
    """
    air = dict(by_name(twin.disturbances))
    if push is not None:
        air["bias"] = Bias("bias", *push.tolist())
    return replace(
        log, plant=twin.plant, radio=twin.radio, compute=twin.compute, disturbances=tuple(air.values()), faults=()
    )


def closed_loop(
    flown: Array,
    experiments: Sequence[Experiment],
    flights: int,
    *,
    processes: int | None = None,
    progress: Callable[[], None] = lambda: None,
) -> list[dict[str, Loop] | str]:
    """Fly twins with the same chance, and compare their distance from the plan with the log's.

    Args:
        flown: (4,) of `tracking_rms`.
        experiments: One of each twin.
        flights: Of each twin.
        processes: How many; None for one a core.
        progress: Called after every flight.

    Returns:
        For each twin the axes by name, or a sentence if it does not stay in the air.
    """
    each = [replace(e, seed=FIRST_SEED + i) for e in experiments for i in range(flights)]
    rows: list[Array | str] = []
    with fleet(processes) as run:
        for row in run(_rms_of, each):
            rows.append(row)
            progress()
    return [_loops(flown, rows[i * flights : (i + 1) * flights]) for i in range(len(experiments))]


def _rms_of(experiment: Experiment) -> Array | str:
    result = fly(experiment, log_dir=None)
    rms = tracking_rms(result.log)
    return result.outcome.text if result.outcome.kind != "completed" or rms is None else rms


def _loops(flown: Array, rows: Sequence[Array | str]) -> dict[str, Loop] | str:
    failed = [row for row in rows if isinstance(row, str)]
    if failed:
        return f"{len(failed)} of {len(rows)} flights of the twin failed: it {failed[0]}"
    values = np.stack([row for row in rows if not isinstance(row, str)])
    mean, n = values.mean(axis=0), len(values)
    reach = np.full(4, np.nan)
    if n > 1:
        reach = student.ppf(0.975, n - 1) * values.std(axis=0, ddof=1) * np.sqrt(1.0 + 1.0 / n)
    columns = zip(AXES, flown, mean, mean - reach, mean + reach, strict=True)
    return {axis: Loop(*map(float, numbers)) for axis, *numbers in columns}
