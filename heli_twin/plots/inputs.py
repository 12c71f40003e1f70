"""The inputs, sent and acting, with the limits that the controller believes; flights side by side."""

from collections.abc import Sequence
from typing import Any

from heli_twin.metrics.motion import in_seconds
from heli_twin.plots.axes import LIMIT, held, legend, time_axis
from heli_twin.plots.marks import mark
from heli_twin.plots.requirements import mark_tightest
from heli_twin.plots.runs import Run

BESIDE = True
INPUTS = ("pitch", "roll", "thrust", "yaw")
ACTING, PLANNED = "#999999", "black"


def lacks(shown: Sequence[Run]) -> str:
    """A sentence if there is nothing to draw, else empty."""
    empty = next((run for run in shown if not len(run.log.sent.time)), None)
    return f"{empty.name or 'the log'} has no commands: there are no inputs to draw" if empty else ""


def height(shown: Sequence[Run], width: float) -> float:
    """Inches."""
    return 5.2


def draw(part: Any, shown: Sequence[Run], width: float) -> None:
    """Draw it into a part of a figure."""
    places = part.subplots(4, len(shown), squeeze=False, sharex=True, sharey="row")
    for column, run in enumerate(shown):
        for i, name in enumerate(INPUTS):
            axes = places[i, column]
            _input(axes, run, i)
            if column == 0:
                axes.set_ylabel(f"{name}, of full stick" if width > 5 else name)
            time_axis(axes, shown, labelled=i == 3)
            mark(axes, run, alone=True, named=i == 0 and len(shown) == 1)
            mark_tightest(axes, run, alone=len(shown) == 1, numbered=i == 0)
        if len(shown) > 1:
            places[0, column].set_title(run.name, fontsize=7, loc="left")
    part.align_ylabels()
    legend(part, width)


def _input(axes: Any, run: Run, i: int) -> None:
    acting, sent, planned = run.log.acting, run.log.sent, run.log.reference
    for wire, color, label, style in (
        (acting, ACTING, "acting", {"linewidth": 1.4, "zorder": 1.8}),
        (sent, run.color, "sent", {"linewidth": 0.8, "zorder": 2}),
    ):
        time = in_seconds(wire.time)
        kept = run.shown(time)
        if len(time[kept]):
            at, value = held(time[kept], wire.u[kept, i], min(run.end, 1e-9 * run.log.ending.time))
            axes.step(at, value, where="post", color=color, label=label, **style)
    time = in_seconds(planned.stamp)
    kept = run.shown(time)
    if len(time[kept]):
        axes.plot(
            time[kept], planned.u[kept, i], color=PLANNED, linestyle="--", linewidth=0.7, label="feed-forward", zorder=3
        )
    _limits(axes, run, i)


def _limits(axes: Any, run: Run, i: int) -> None:
    """Draw the limits that the law believes, where they are near what was sent: a far one would flatten the curve."""
    if run.experiment is None:
        return
    model = run.experiment.controller.model
    low, high = axes.dataLim.y0, axes.dataLim.y1
    room = max(high - low, 0.02)
    for limit in (model.u_min[i], model.u_max[i]):
        if low - 0.5 * room <= limit <= high + 0.5 * room:
            axes.axhline(limit, label="limit", **LIMIT)
