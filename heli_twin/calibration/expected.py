"""Noise and gusts as an experiment has them: what a fit of its flights would find."""

from controllers.markers import by_name
from heli_twin.calibration import noise
from heli_twin.experiment import Experiment
from heli_twin.lab.disturbances.gust import Gust

JITTERS = {"attitude_jitter": 0.25, "height_jitter": 0.02, "yaw_jitter": 0.2}
"""Small accelerations that stand for lost frames and servos, where no calibration says them: rad/s^2, m/s^2, rad/s^2.
Calibrations of pilot twins find 0.06 to 0.08 in `lab_simple` and 0.23 to 0.49 in `lab`; 0.01 to 0.04; 0.1 to 0.35."""


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
