"""A quadrotor in an MJCF file, as a user's own airframe, and what its text says of it."""

from pathlib import Path

import numpy as np

from controllers.model import GRAVITY, Model
from heli_twin.lab.plant import STILL_AIR
from heli_twin.lab.plant.airframe import Airframe

FOLDER = Path(__file__).parent / "lab/plant/airframes"
QUADROTOR = FOLDER / "quadrotor.xml"
TEXT = QUADROTOR.read_text()
# Torque, thrust, mass and inertia of the file: sin(tilt) = 0.0049 / (0.32 * 0.05) at full stick.
B_X, B_Z, B_YAW = GRAVITY * 0.0049 / 0.016, 1.2 / 0.060, 0.0021 / 7e-5
BELIEVED = Model(b_x=B_X, k_x=-0.2, b_y=B_X, k_y=-0.2, b_z=B_Z, b_yaw=B_YAW, k_yaw=-5.9)
UP = np.array([0.2, -0.1, 50.0, 0.6, 0.0, 0.0, 0.0, 0.0])
SECOND = 1_000_000_000


def changed(*pairs: tuple[str, str]) -> str:
    """The quadrotor with pieces of its text replaced."""
    text = TEXT
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new)
    return text


def held(u, seconds, spec=None, x=UP, air=STILL_AIR):
    """The truth after holding the trim plus `u`."""
    spec = spec or Airframe(model=TEXT)
    plant = spec.start(x)
    plant.advance(round(seconds * SECOND), plant.truth().actuators + u, air)
    return plant.truth()
