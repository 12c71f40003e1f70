"""The path, from above and from the side, at one scale."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from heli_twin.metrics.motion import in_seconds, motion, outages
from heli_twin.plots.axes import NARROW_INCHES, REFERENCE, legend
from heli_twin.plots.marks import OUTAGE_COLOR
from heli_twin.plots.requirements import place_tightest
from heli_twin.plots.runs import Run
from heli_twin.plots.tracking import lacks as lacks

BESIDE = False
VIEWS = ((1, 0, "from above"), (1, 2, "from the south"))
"""Axes across and upwards: y points west, so that across is turned round, as on a map with north up."""


def height(shown: Sequence[Run], width: float) -> float:
    """Inches."""
    return 0.5 * width + 0.3 if width >= NARROW_INCHES else 2 * width + 0.2


def draw(part: Any, shown: Sequence[Run], width: float) -> None:
    """Draw it into a part of a figure."""
    wide = width >= NARROW_INCHES
    places = part.subplots(1 if wide else 2, 2 if wide else 1, squeeze=False).ravel()
    for axes, (across, up, title) in zip(places, VIEWS, strict=True):
        _view(axes, shown, across, up)
        axes.set_title(title, loc="left")
        axes.set_xlabel(("x", "y", "z")[across] + ", m")
        axes.set_ylabel(("x", "y", "z")[up] + ", m")
        axes.set_aspect("equal", adjustable="datalim")
        axes.invert_xaxis()
    legend(part, width)


def _view(axes: Any, shown: Sequence[Run], across: int, up: int) -> None:
    alone = len(shown) == 1
    drawn: list[Any] = []
    for run in shown:
        planned = run.log.reference.x[run.shown(in_seconds(run.log.reference.stamp)), :3]
        points = planned[:, [across, up]]
        if len(points) and not any(_same(points, other) for other in drawn):
            # A hover's reference is one point, which no line shows.
            marker = "+" if np.ptp(points, axis=0).max() < 1e-3 else ""
            axes.plot(points[:, 0], points[:, 1], marker=marker, label="reference", markersize=8, **REFERENCE)
            drawn.append(points)
        moved = motion(run.log)
        kept = run.shown(moved.time)
        flown, time = moved.state[kept][:, [across, up]], moved.time[kept]
        name = ("by the cameras" if moved.by_cameras else "flown") if alone else run.name
        axes.plot(flown[:, 0], flown[:, 1], color=run.color, label=name, zorder=2)
        for span in outages(run.log):
            lost = (time >= span.start) & (time <= span.end)
            axes.plot(flown[lost, 0], flown[lost, 1], color=OUTAGE_COLOR, linewidth=5, zorder=1, label="no poses")
        if len(flown):
            style = {"color": run.color, "markersize": 4, "linestyle": "none", "zorder": 4}
            axes.plot(*flown[0], marker="o", markerfacecolor="white", label="start" if alone else None, **style)
            axes.plot(*flown[-1], marker="s", label="end" if alone else None, **style)
        place_tightest(axes, run, across, up, alone=alone)


def _same(a: Any, b: Any) -> bool:
    n = min(len(a), len(b))
    return bool(np.array_equal(a[:n], b[:n]))
