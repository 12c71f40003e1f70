"""The estimator's error with two of its standard deviations; flights side by side."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from controllers.rotations import wrap_angle, yaw_of
from controllers.signals import Array
from heli_twin.metrics.motion import in_seconds, motion
from heli_twin.plots.axes import AXES, ERROR_UNITS, legend, time_axis
from heli_twin.plots.marks import mark
from heli_twin.plots.requirements import mark_tightest
from heli_twin.plots.runs import Run

BESIDE = True
POSE_COLOR = "#CC79A7"


def lacks(shown: Sequence[Run]) -> str:
    """A sentence if there is nothing to draw, else empty."""
    for run in shown:
        name = run.name or "the log"
        if not len(run.log.truth.time):
            return f"{name} has no truth, so the error of its estimate is not known: take what = tracking"
        if not len(run.log.estimate.time):
            return f"{name} has no estimate: take what = tracking"
    return ""


def height(shown: Sequence[Run], width: float) -> float:
    """Inches."""
    return 5.2


def draw(part: Any, shown: Sequence[Run], width: float) -> None:
    """Draw it into a part of a figure."""
    places = part.subplots(4, len(shown), squeeze=False, sharex=True, sharey="row")
    scales = np.zeros((4, len(shown)))
    for column, run in enumerate(shown):
        for i, name in enumerate(AXES):
            axes = places[i, column]
            scales[i, column] = _error(axes, run, i)
            if column == 0:
                axes.set_ylabel(f"{name} error, {'cm' if i < 3 else 'deg'}")
            time_axis(axes, shown, labelled=i == 3)
            mark(axes, run, alone=True, named=i == 0 and len(shown) == 1)
            mark_tightest(axes, run, alone=len(shown) == 1, numbered=i == 0)
        if len(shown) > 1:
            places[0, column].set_title(run.name, fontsize=7, loc="left")
    for row, scale in zip(places, scales.max(axis=1), strict=True):
        row[0].set_ylim(-scale, scale)
    part.align_ylabels()
    legend(part, width)


def _error(axes: Any, run: Run, i: int) -> float:
    """Draw one axis; returns the scale on which nearly all of it is seen."""
    found, moved = run.log.estimate, motion(run.log)
    stamp = in_seconds(found.stamp)
    kept = run.shown(stamp)
    error = ERROR_UNITS[i] * _minus(found.x[kept, i], stamp[kept], moved, i)
    deviation = 2 * ERROR_UNITS[i] * np.sqrt(np.maximum(found.variance[kept, i, 0], 0.0))
    pose = run.log.pose
    seen = in_seconds(pose.stamp)
    there = (seen >= run.start) & (seen <= run.end)
    measured = yaw_of(pose.quat_wxyz[there]) if i == 3 else pose.position[there, i]
    noise = ERROR_UNITS[i] * _minus(measured, seen[there], moved, i)
    axes.plot(
        seen[there], noise, ".", color=POSE_COLOR, markersize=1, alpha=0.5, zorder=1.2, label="poses", rasterized=True
    )
    axes.fill_between(
        stamp[kept],
        -deviation,
        deviation,
        color="#bbbbbb",
        alpha=0.6,
        linewidth=0,
        zorder=1.4,
        label="two standard deviations",
    )
    axes.plot(stamp[kept], error, color=run.color, zorder=2, label="estimate minus truth")
    # A pose that is far off, or an estimator that knows nothing at first, would hide what is of interest.
    seldom = [np.percentile(np.abs(values), most) for values, most in ((error, 99.5), (noise, 99)) if len(values)]
    return 1.4 * max(*seldom, 1e-3)


def _minus(values: Array, time: Array, moved: Any, i: int) -> Array:
    truth = np.interp(time, moved.time, moved.state[:, i])
    return wrap_angle(values - truth) if i == 3 else values - truth
