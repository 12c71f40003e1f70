"""Measured times of the control step and of the solver: over the flight, and their distribution."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from heli_twin.metrics.motion import in_seconds
from heli_twin.plots.axes import LIMIT, NARROW_INCHES, legend, time_axis
from heli_twin.plots.requirements import mark_tightest
from heli_twin.plots.runs import Run

BESIDE = False
ROWS = (("control_step_ns", "control step"), ("solve_ns", "solver"))


def lacks(shown: Sequence[Run]) -> str:
    """A sentence if there is nothing to draw, else empty."""
    empty = next((run for run in shown if not len(run.log.timing.time)), None)
    return f"{empty.name or 'the log'} has no measured times" if empty else ""


def _rows(shown: Sequence[Run]) -> list[tuple[str, str]]:
    """What was measured: a law without a solver has no time of one."""
    return [row for row in ROWS if any((getattr(run.log.timing, row[0]) > 0).any() for run in shown)] or [ROWS[0]]


def height(shown: Sequence[Run], width: float) -> float:
    """Inches."""
    return (1.8 if width >= NARROW_INCHES else 3.2) * len(_rows(shown)) + 0.2


def draw(part: Any, shown: Sequence[Run], width: float) -> None:
    """Draw it into a part of a figure."""
    wide = width >= NARROW_INCHES
    rows = _rows(shown)
    places = part.subplots(*((len(rows), 2) if wide else (2 * len(rows), 1)), squeeze=False).reshape(-1, 2)
    for (field, name), (over_time, shares) in zip(rows, places, strict=True):
        for run in shown:
            time = in_seconds(run.log.timing.time)
            kept = run.shown(time)
            took = 1e-6 * np.asarray(getattr(run.log.timing, field)[kept], float)
            # Steps without a solver took none.
            positive = took > 0
            over_time.plot(
                time[kept][positive], took[positive], ".", color=run.color, markersize=1.5, alpha=0.7, rasterized=True
            )
            if positive.any():
                slowest = np.sort(took[positive])
                share = np.arange(1, len(slowest) + 1) / len(slowest)
                shares.step(
                    slowest, 100 * share, where="post", color=run.color, label=run.name if len(shown) > 1 else None
                )
                if len(shown) == 1:
                    half, most = np.percentile(slowest, [50, 99])
                    text = f"median {half:.3g} ms, 99 %: {most:.3g} ms"
                    shares.text(1.0, 1.02, text, transform=shares.transAxes, ha="right", va="bottom", fontsize=6)
        for run in shown:
            mark_tightest(over_time, run, alone=len(shown) == 1, numbered=field == rows[0][0])
        over_time.set_ylabel(f"{name}, ms")
        over_time.set_yscale("log")
        _numbers(over_time.yaxis)
        time_axis(over_time, shown)
        shares.set_xlabel(f"{name}, ms")
        shares.set_ylabel("steps, %")
        shares.set_xscale("log")
        _numbers(shares.xaxis)
        shares.set_ylim(0, 102)
        if field == "control_step_ns":
            _deadline(over_time, shares, shown)
    legend(part, width)


def _deadline(over_time: Any, shares: Any, shown: Sequence[Run]) -> None:
    periods = {run.experiment.controller.period for run in shown if run.experiment}
    for period in sorted(periods):
        over_time.axhline(1e3 * period, label="control period", **LIMIT)
        shares.axvline(1e3 * period, **LIMIT)


def _numbers(axis: Any) -> None:
    from matplotlib.ticker import LogLocator, NullFormatter

    axis.set_major_locator(LogLocator(subs=(1.0, 3.0)))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())
