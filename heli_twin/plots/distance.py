"""The least distance of several helicopters in one room over time, flown and planned."""

from collections.abc import Sequence
from typing import Any

from heli_twin.lab.plant.size import RADIUS_M
from heli_twin.metrics.several import flown_paths, least_over_time, planned_paths
from heli_twin.plots.axes import LIMIT, legend, time_axis
from heli_twin.plots.runs import Run
from heli_twin.recording.log import SHIP_KEY

BESIDE = False
PLANNED: dict[str, Any] = {"color": "#E69F00", "linestyle": "--", "zorder": 2}


def lacks(shown: Sequence[Run]) -> str:
    """A sentence if there is nothing to draw, else empty."""
    alone = next((run for run in shown if SHIP_KEY not in run.log.metadata), None)
    if alone is not None:
        return f"{alone.name or 'the log'} is of one helicopter: a distance is between two in one room"
    if len(shown) < 2 or len({run.log.digest for run in shown}) > 1:
        return "a distance is between helicopters in one room: give the log of one flight of several"
    return ""


def height(shown: Sequence[Run], width: float) -> float:
    """Inches."""
    return 2.4


def draw(part: Any, shown: Sequence[Run], width: float) -> None:
    """Draw it into a part of a figure."""
    axes = part.subplots(1, 1)
    logs = {run.log.metadata[SHIP_KEY]: run.log for run in shown}
    time, least = least_over_time(flown_paths(logs))
    kept = shown[0].shown(time)
    axes.plot(time[kept], least[kept], color="#0072B2", label="flown", zorder=3)
    wishes = {run.log.metadata[SHIP_KEY]: run.experiment.trajectory for run in shown if run.experiment}
    if len(wishes) == len(logs):
        time, least = least_over_time(planned_paths(logs, wishes))
        kept = shown[0].shown(time)
        axes.plot(time[kept], least[kept], label="planned", **PLANNED)
    axes.axhline(2 * RADIUS_M, label="rotors touch", **LIMIT)
    axes.set_ylim(bottom=0.0)
    axes.set_ylabel("least distance, m")
    time_axis(axes, shown)
    legend(part, width)
