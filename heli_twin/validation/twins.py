"""The twins that are compared: parameters of a helicopter, and what they say of noise and gusts."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from controllers.markers import by_name
from controllers.signals import Array
from heli_twin.calibration import noise
from heli_twin.calibration.parameters import NAMES, Lab, lab_of, of_experiment, vector
from heli_twin.experiment import Experiment
from heli_twin.lab.disturbances.gust import Gust

JITTERS = {"attitude_jitter": 0.2, "height_jitter": 0.02, "yaw_jitter": 0.5}
"""Small accelerations that stand for the timing of single commands, where no calibration says them: rad/s^2, m/s^2."""


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
