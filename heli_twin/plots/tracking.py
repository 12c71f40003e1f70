"""Flown, reference and error of x, y, z and yaw over time."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from heli_twin.metrics.motion import errors, in_seconds, motion
from heli_twin.metrics.tracking import SETTLING_S
from heli_twin.plots.axes import AXES, ERROR_UNITS, NARROW_INCHES, REFERENCE, UNITS, legend, time_axis
from heli_twin.plots.marks import mark
from heli_twin.plots.requirements import mark_tightest
from heli_twin.plots.runs import Run

BESIDE = False


def lacks(shown: Sequence[Run]) -> str:
    """A sentence if there is nothing to draw, else empty."""
    empty = next((run for run in shown if not len(motion(run.log).time)), None)
    return f"{empty.name or 'the log'} has neither truth nor poses: there is no motion to draw" if empty else ""


def _planned(shown: Sequence[Run]) -> bool:
    """Whether there is an error to draw: an imported recording may have no reference."""
    return any(len(run.log.reference.time) for run in shown)


def height(shown: Sequence[Run], width: float) -> float:
    """Inches."""
    return 5.2 if width >= NARROW_INCHES or not _planned(shown) else 8.0


def draw(part: Any, shown: Sequence[Run], width: float) -> None:
    """Draw it into a part of a figure."""
    wide, planned = width >= NARROW_INCHES, _planned(shown)
    places = part.subplots(*((4, 2) if wide and planned else (8, 1) if planned else (4, 1)), squeeze=False, sharex=True)
    positions = places[:, 0] if wide or not planned else places[::2, 0]
    mistakes = places[:, 1] if wide and planned else places[1::2, 0] if planned else []
    for i, name in enumerate(AXES):
        unit = ("m", "cm") if i < 3 else ("deg", "deg")
        positions[i].set_ylabel(f"{name}, {unit[0]}")
        _position(positions[i], shown, i)
        if planned:
            mistakes[i].set_ylabel(f"{name} error, {unit[1]}" if wide else f"error, {unit[1]}")
            _error(mistakes[i], shown, i)
    bottom = list(places[-1])
    for axes in places.ravel():
        time_axis(axes, shown, labelled=axes in bottom)
        for run in shown:
            mark(axes, run, alone=len(shown) == 1, named=len(shown) == 1 and axes is places[0, 0])
            mark_tightest(axes, run, alone=len(shown) == 1, numbered=axes is places[0, 0])
    part.align_ylabels()
    legend(part, width)


def _position(axes: Any, shown: Sequence[Run], i: int) -> None:
    alone, references = len(shown) == 1, [run.log.reference.x[:, i] for run in shown]
    longest = max(shown, key=lambda run: len(run.log.reference.time))
    same = all(np.array_equal(a[: len(b)], b[: len(a)]) for a in references for b in references)
    for run, planned in zip(shown, references, strict=True):
        moved = motion(run.log)
        kept = run.shown(moved.time)
        name = ("by the cameras" if moved.by_cameras else "flown") if alone else run.name
        axes.plot(moved.time[kept], UNITS[i] * moved.state[kept, i], color=run.color, label=name, zorder=2)
        time = in_seconds(run.log.reference.stamp)
        kept = run.shown(time)
        if len(time) and (not same or run is longest):
            style = REFERENCE if same else REFERENCE | {"color": run.color}
            axes.plot(time[kept], UNITS[i] * planned[kept], label="reference" if same else None, **style)


def _error(axes: Any, shown: Sequence[Run], i: int) -> None:
    for run in shown:
        time, error = errors(run.log)
        kept = run.shown(time)
        axes.plot(time[kept], ERROR_UNITS[i] * error[kept, i], color=run.color, zorder=2)
        settled = error[kept][time[kept] >= SETTLING_S, i]
        if len(shown) == 1 and len(settled):
            rms, most = ERROR_UNITS[i] * np.sqrt((settled**2).mean()), ERROR_UNITS[i] * np.abs(settled).max()
            text = f"from {max(SETTLING_S, run.start):g} s: RMS {rms:.3g}, largest {most:.3g}"
            style = {"ha": "right", "va": "bottom", "fontsize": 6, "color": "#444444"}
            axes.text(1.0, 1.02, text, transform=axes.transAxes, **style)
    axes.axhline(0.0, color="#aaaaaa", linewidth=0.6, zorder=1)
