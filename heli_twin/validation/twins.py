"""The twins that are compared: parameters of a helicopter, and what they say of noise and gusts."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from controllers.markers import by_name
from controllers.signals import Array
from heli_twin.calibration import noise
from heli_twin.calibration.parameters import NAMES, Lab, lab_of, of_experiment, vector
from heli_twin.experiment import Experiment
from heli_twin.experiment.toml_file import table_in
from heli_twin.experiment.tree import ExperimentError
from heli_twin.lab.disturbances.gust import Gust
from heli_twin.terminal_text import clean

JITTERS = {"attitude_jitter": 1.0, "height_jitter": 0.05, "yaw_jitter": 1.1}
"""Small accelerations that stand for the timing of single commands, where no calibration says them: rad/s^2, m/s^2,
rad/s^2. Calibrations of twins in `lab_simple` and `lab` find 0.5 to 1.7, 0.05 and 0.9 to 1.3."""


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


def expected_noise(experiment: Experiment) -> dict[str, float]:
    """Return noise and gusts as an experiment has them, by the names of `noise.COMPONENTS`."""
    gusts = [d for d in by_name(experiment.disturbances).values() if isinstance(d, Gust)]
    known = dict(zip(noise.COMPONENTS, noise.PRIOR.tolist(), strict=True)) | JITTERS
    cameras = {"position_noise": "position_noise", "slow_position_noise": "bias"}
    cameras |= {"orientation_noise": "orientation_noise"}
    known |= {ours: getattr(experiment.mocap, theirs, 0.0) or known[ours] for ours, theirs in cameras.items()}
    known["yaw_noise"] = known["orientation_noise"]
    if gusts:
        known |= {"gust_strength": max(gusts[0].strength, 1e-3), "gust_time": gusts[0].time}
    return known
