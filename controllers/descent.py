"""A straight descent to the floor: brisk, then slow before the skids touch."""

from math import sqrt
from typing import NamedTuple

import numpy as np

from controllers.model import GRAVITY, Model
from controllers.signals import Array, Reference


class Descent(NamedTuple):
    """Speeds of a descent."""

    sink_speed: float
    """m/s."""
    touch_speed: float
    """m/s."""
    slow_below: float
    """Height above the floor at which it has slowed down to `touch_speed`, m."""
    acceleration: float
    """m/s^2."""
    bottom: float
    """Height where it ends, m: below that of a helicopter that stands, so that it touches the floor for certain."""
    floor: float
    """Height of the centre of gravity when the helicopter stands, m."""
    heave_damping: float = 0.0
    """Deceleration per vertical speed, 1/s; the believed model has none."""

    def step(self, height: float, speed: float, dt: float) -> tuple[float, float]:
        """Height (m) and vertical speed (m/s, positive upwards) `dt` seconds later."""
        if height <= self.bottom:
            return height, 0.0
        above = max(height - self.floor - self.slow_below, 0.0)
        wanted = -min(self.sink_speed, sqrt(self.touch_speed**2 + 2.0 * self.acceleration * above))
        change = self.acceleration * dt
        speed = min(max(wanted, speed - change), speed + change)
        return max(height + dt * speed, self.bottom), speed


def hold(model: Model, stamp: int, steps: int, place: Array) -> Reference:
    """The reference (N = steps) of a helicopter that hovers.

    Args:
        model: The believed helicopter.
        stamp: Time of the first row, ns.
        steps: Control periods of it.
        place: (4,) x y z (m) and yaw (rad).
    """
    x = np.zeros((steps + 1, 8))
    x[:, :4] = place
    return Reference(stamp, x, np.tile(np.array(model.u_hover), (steps, 1)))


def descend(reference: Reference, model: Model, descent: Descent, speed: float, dt: float) -> Reference:
    """The same reference (see `hold`), descending from its height with a vertical speed (m/s) at its start."""
    x, u = reference.x.copy(), reference.u.copy()
    height = float(x[0, 2])
    x[0, 6] = speed
    for i in range(len(u)):
        height, next_speed = descent.step(height, speed, dt)
        # At the bottom the floor stops it, not the thrust.
        change = (next_speed - speed) / dt if height > descent.bottom else 0.0
        change += descent.heave_damping * next_speed
        u[i, 2] = min(max((GRAVITY + change) / model.b_z, model.u_z_min), model.u_z_max)
        speed = next_speed
        x[i + 1, 2], x[i + 1, 6] = height, speed
    return Reference(reference.stamp, x, u)
