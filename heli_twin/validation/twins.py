"""The twins that are compared: parameters of a helicopter, and what they say of noise and gusts."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from controllers.signals import Array
from heli_twin.calibration import noise
from heli_twin.calibration.expected import expected_noise
from heli_twin.calibration.parameters import NAMES, Lab, lab_of, of_experiment, vector
from heli_twin.experiment import Experiment
from heli_twin.experiment.toml_file import table_in
from heli_twin.experiment.tree import ExperimentError
from heli_twin.terminal_text import clean


class Twin(NamedTuple):
    """A helicopter as one believes it to be."""

    name: str
    experiment: Experiment
    theta: Array
    """(n,) the vector of `heli_twin.calibration.parameters`."""
    eta: Array
    """(9,) logarithms of `noise.COMPONENTS`."""
    lab: Lab


def twin_of(name: str, experiment: Experiment, expected: Mapping[str, float]) -> Twin:
    """Return the twin of an experiment.

    Args:
        name: In tables.
        experiment: With the helicopter.
        expected: Noise by the names of `noise.COMPONENTS`.
    """
    believed = of_experiment(experiment)
    theta = vector(np.array([believed[parameter] for parameter in NAMES]))
    eta = np.log([max(expected[component], 1e-9) for component in noise.COMPONENTS])
    return Twin(name, experiment, theta, np.asarray(eta, np.float64), lab_of(experiment))


def noise_in(source: str | None, experiment: Experiment) -> dict[str, float]:
    """Return noise and gusts as a calibration says them, else as its experiment has them.

    Args:
        source: The file of the experiment, or a preset.
        experiment: It, with all changes.

    Raises:
        ExperimentError: The file's table `noise` is none; the message names the entry.
    """
    known = expected_noise(experiment)
    for name, value in (table_in(source, "noise") if source else {}).items():
        path = f"{clean(source, 200)}: noise.{clean(name, 40)}"
        if name not in known:
            raise ExperimentError(f"{path} is unknown. Available: {', '.join(known)}")
        if type(value) not in (int, float) or not 0.0 < value < np.inf:
            raise ExperimentError(f"{path} = {clean(value, 40)}: write a standard deviation above 0")
        known[name] = float(value)
    return known
