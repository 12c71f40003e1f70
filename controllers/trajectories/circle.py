"""Fly round a level circle."""

from dataclasses import dataclass
from math import pi
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt, Unit, doc

from controllers.flatness import FlatOutput
from controllers.jets import Jet, flat_derivatives, sine_cosine
from controllers.pace import smooth_start, start_clock
from controllers.signals import Array
from controllers.trajectories import ALL_DERIVATIVES


@dataclass(frozen=True, slots=True)
class Circle:
    """A level circle (the flight of Figs. 3 and 5)."""

    kind: Literal["circle"] = "circle"
    radius: Annotated[float, Gt(0), Unit("m"), doc("radius of the circle")] = 0.5
    rate: Annotated[float, Unit("rad/s"), doc("angular rate, positive counter-clockwise from above")] = 1.0
    height: Annotated[float, Gt(0), Unit("m"), doc("height of the centre of gravity above the floor")] = 1.0
    heading: Annotated[Literal["path", "fixed"], doc("nose along the path, or always north")] = "path"
    ramp: Annotated[float, Ge(0), Unit("s"), doc("time to gather speed from a standing start; 0 starts in motion")] = (
        2.0
    )
    x: Annotated[float, Unit("m"), doc("centre, north")] = 0.0
    y: Annotated[float, Unit("m"), doc("centre, west")] = 0.0
    phase: Annotated[float, Unit("rad"), doc("where it starts: 0 north of the centre, positive counter-clockwise")] = (
        0.0
    )

    def flat(self, t: Array) -> FlatOutput:
        """Return the point on the circle at the angle of a smooth start."""
        turned, rate, acceleration = (self.rate * s for s in smooth_start(t, self.ramp))
        angle = turned + self.phase
        c, s, r = np.cos(angle), np.sin(angle), self.radius
        zero = np.zeros_like(angle)
        turns = self.heading == "path"
        side = pi / 2 if self.rate >= 0 else -pi / 2
        yaw = (angle + side, rate, acceleration) if turns else (zero, zero, zero)
        return FlatOutput(
            np.stack([r * c + self.x, r * s + self.y, zero + self.height, yaw[0]], axis=-1),
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

    @property
    def smoothness(self) -> int:
        """Up to the acceleration; without a ramp, every derivative."""
        return 2 if self.ramp > 0.0 else ALL_DERIVATIVES

    def derivatives(self, t: Array, highest: int) -> Array:
        """Return the flat outputs and their time derivatives."""
        angle = self.rate * start_clock(Jet.variable(t, 1.0, highest), self.ramp) + self.phase
        s, c = sine_cosine(angle)
        side = pi / 2 if self.rate >= 0 else -pi / 2
        yaw = angle + side if self.heading == "path" else 0.0
        return flat_derivatives(self.radius * c + self.x, self.radius * s + self.y, self.height, yaw)
