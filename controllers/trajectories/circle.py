"""Fly round a level circle."""

from dataclasses import dataclass
from math import pi
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt, Unit, doc

from controllers.flatness import FlatOutput
from controllers.signals import Array


@dataclass(frozen=True, slots=True)
class Circle:
    """A level circle about the origin (the flight of Figs. 3 and 5)."""

    kind: Literal["circle"] = "circle"
    radius: Annotated[float, Gt(0), Unit("m"), doc("radius of the circle")] = 0.5
    rate: Annotated[float, Unit("rad/s"), doc("angular rate, positive counter-clockwise from above")] = 1.0
    height: Annotated[float, Gt(0), Unit("m"), doc("height of the centre of gravity above the floor")] = 1.0
    heading: Annotated[Literal["path", "fixed"], doc("nose along the path, or always north")] = "path"
    ramp: Annotated[float, Ge(0), Unit("s"), doc("time to gather speed from a standing start; 0 starts in motion")] = (
        2.0
    )

    def flat(self, t: Array) -> FlatOutput:
        """The point on the circle at the angle that a smooth start has reached."""
        angle, rate, acceleration = (self.rate * s for s in smooth_start(t, self.ramp))
        c, s, r = np.cos(angle), np.sin(angle), self.radius
        zero = np.zeros_like(angle)
        turns = self.heading == "path"
        side = pi / 2 if self.rate >= 0 else -pi / 2
        yaw = (angle + side, rate, acceleration) if turns else (zero, zero, zero)
        return FlatOutput(
            np.stack([r * c, r * s, zero + self.height, yaw[0]], axis=-1),
            np.stack([-r * s * rate, r * c * rate, zero, yaw[1]], axis=-1),
            np.stack(
                [
                    -r * (c * rate**2 + s * acceleration),
                    r * (c * acceleration - s * rate**2),
                    zero,
                    yaw[2],
                ],
                axis=-1,
            ),
        )


def smooth_start(t: Array, ramp: float) -> tuple[Array, Array, Array]:
    """A clock that starts at rest and runs at full speed after `ramp` seconds.

    Its speed is the smoothstep 3 q^2 - 2 q^3 of q = t / ramp, so that position, speed and acceleration of
    whatever follows it are continuous.

    Args:
        t: (n,) time, s.
        ramp: Duration of the start, s; 0 for none.

    Returns:
        Its reading (s), speed (1) and acceleration (1/s), each (n,).
    """
    if ramp <= 0.0:
        return t, np.ones_like(t), np.zeros_like(t)
    q = np.clip(t / ramp, 0.0, 1.0)
    return (
        ramp * (q**3 - 0.5 * q**4) + np.maximum(t - ramp, 0.0),
        q * q * (3.0 - 2.0 * q),
        6.0 * q * (1.0 - q) / ramp,
    )
