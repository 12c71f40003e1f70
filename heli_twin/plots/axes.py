"""What the axes of all figures of flights share."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from controllers.signals import Array
from heli_twin.plots.runs import Run

AXES = ("x", "y", "z", "yaw")
UNITS = np.array([1.0, 1.0, 1.0, 180 / np.pi])
"""Factors with which states are shown: m and deg."""
ERROR_UNITS = np.array([100.0, 100.0, 100.0, 180 / np.pi])
"""Factors with which errors are shown: cm and deg."""
NARROW_INCHES = 5.0
"""Below this width, what would stand side by side stands in one column."""
REFERENCE: dict[str, Any] = {"color": "black", "linestyle": "--", "linewidth": 0.8, "zorder": 3}
LIMIT: dict[str, Any] = {"color": "#CC3311", "linestyle": "-", "linewidth": 0.7, "zorder": 1.5}


def time_axis(axes: Any, shown: Sequence[Run], *, labelled: bool = True) -> None:
    """Let the axis of time hold what is shown and no more."""
    axes.set_xlim(shown[0].start, max(run.end for run in shown))
    if labelled:
        axes.set_xlabel("time, s")
    else:
        axes.tick_params(labelbottom=False)


def legend(part: Any, width: float) -> None:
    """One legend below a figure of this width, inches; each name once."""
    entries: dict[str, Any] = {}
    for axes in part.axes:
        for handle, name in zip(*axes.get_legend_handles_labels(), strict=True):
            entries.setdefault(name, handle)
    if entries:
        columns = int(width / (0.45 + 0.055 * max(map(len, entries))))
        part.legend(
            entries.values(), entries.keys(), loc="outside lower center", ncols=max(1, min(columns, len(entries)))
        )


def held(time: Array, values: Array, end: float) -> tuple[Array, Array]:
    """Steps that last to the end of what is shown."""
    return np.append(time, end), np.append(values, values[-1:], axis=0)
