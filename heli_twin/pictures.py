"""What a viewer needs to know of an experiment, and where `--rerun` sends its pictures."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from controllers.signals import Array
from heli_twin.errors import HeliTwinError
from heli_twin.experiment import Experiment

if TYPE_CHECKING:
    from heli_twin.recording.layout import Scales
    from heli_twin.recording.rerun_bridge import Sink

VIEWER_PORT = 9876
"""Where Rerun's viewer listens."""
PATH_POINTS = 600
"""Points of the drawn reference path at most."""


def planned_path(experiment: Experiment) -> Array:
    """The path to fly (n, 3), world, m, for the eye."""
    count = min(PATH_POINTS, 1 + round(experiment.duration / experiment.controller.period))
    return experiment.trajectory.flat(np.linspace(0.0, experiment.duration, count)).z[:, :3]


def scales(experiment: Experiment) -> "Scales":
    """Limits and deadline that the plots compare with."""
    from heli_twin.recording.layout import Scales

    controller = experiment.controller
    return Scales(controller.model.u_min, controller.model.u_max, controller.period, planned_path(experiment))


def sink(where: str) -> "Sink":
    """Where pictures go: `spawn` a viewer, `connect` to one, or a Rerun file.

    Raises:
        HeliTwinError: It is none of these.
    """
    from heli_twin.recording.rerun_bridge import Sink

    if where in ("spawn", "connect"):
        return Sink(port=VIEWER_PORT, spawn=where == "spawn")
    if where.endswith(".rrd"):
        return Sink(file=Path(where))
    raise HeliTwinError(f"'{where}' is no place for pictures: give spawn, connect, or a file that ends in .rrd")
