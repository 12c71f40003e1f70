"""What a flight reaches, as planned and as flown, to be held against the envelope of a calibration."""

import numpy as np

from heli_twin.experiment import Experiment
from heli_twin.experiment.envelope import Envelope
from heli_twin.recording import Log

RARE = (0.001, 0.999)
"""Quantiles of a stick between which it counts."""
IN_THE_AIR_M = 0.2
"""Height from which on a flight counts."""
PLAN_STEP_S = 0.02


def planned_reach(experiment: Experiment) -> Envelope:
    """Return what a plan reaches; tilt and sticks are not known before the flight."""
    flat = experiment.trajectory.flat(np.arange(0.0, experiment.duration, PLAN_STEP_S))
    height = flat.z[:, 2]
    return Envelope(
        speed=float(np.hypot(flat.dz[:, 0], flat.dz[:, 1]).max()),
        climb=float(np.abs(flat.dz[:, 2]).max()),
        yaw_rate=float(np.abs(flat.dz[:, 3]).max()),
        height=(max(float(height.min()), IN_THE_AIR_M), float(height.max())),
        duration=experiment.duration,
    )


def flown_reach(log: Log) -> Envelope:
    """Return what a flight of the twin reached while it was in the air."""
    truth, sent = log.truth, log.sent
    flies = truth.position[:, 2] > IN_THE_AIR_M
    if not flies.any() or not len(sent.time):
        return Envelope()
    velocity, quat = truth.velocity[flies], truth.quat_wxyz[flies]
    upright = 1.0 - 2.0 * (quat[:, 1] ** 2 + quat[:, 2] ** 2)
    low, high = (tuple(map(float, row)) for row in np.quantile(sent.u, RARE, axis=0))
    height = truth.position[flies, 2]
    return Envelope(
        speed=float(np.hypot(velocity[:, 0], velocity[:, 1]).max()),
        climb=float(np.abs(velocity[:, 2]).max()),
        yaw_rate=float(np.abs(truth.yaw_rate[flies]).max()),
        tilt=float(np.arccos(np.maximum(upright, -1.0)).max()),
        height=(float(height.min()), float(height.max())),
        stick_low=low,  # pyright: ignore[reportArgumentType]
        stick_high=high,  # pyright: ignore[reportArgumentType]
        duration=1e-9 * float(truth.time[-1]),
    )
