"""Fly round a vertical circle."""

from dataclasses import dataclass
from math import cos, sin
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt, Unit, doc

from controllers.flatness import FlatOutput
from controllers.jets import Jet, flat_derivatives, sine_cosine
from controllers.pace import along, smooth_start, start_clock
from controllers.signals import Array
from controllers.trajectories import ALL_DERIVATIVES


@dataclass(frozen=True, slots=True)
class FerrisWheel:
    """A vertical circle with its axle above the origin, flown from its lowest point at a constant heading."""

    kind: Literal["ferris_wheel"] = "ferris_wheel"
    radius: Annotated[float, Gt(0), Unit("m"), doc("radius of the wheel")] = 0.5
    rate: Annotated[float, Unit("rad/s"), doc("angular rate, positive sets off along `direction`")] = 1.0
    height: Annotated[float, Gt(0), Unit("m"), doc("height of the axle above the floor")] = 1.0
    direction: Annotated[float, Unit("rad"), doc("where the lowest point moves to, 0 is north, positive to west")] = 0.0
    yaw: Annotated[float, Unit("rad"), doc("heading, 0 is north, positive to port")] = 0.0
    ramp: Annotated[float, Ge(0), Unit("s"), doc("time to gather speed from a standing start; 0 starts in motion")] = (
        2.0
    )

    def flat(self, t: Array) -> FlatOutput:
        """Return the point on the wheel at the angle of a smooth start."""
        pace = smooth_start(t, self.ramp)
        angle, r, w = self.rate * pace[0], self.radius, self.rate
        c, s = r * np.cos(angle), r * np.sin(angle)
        north, west = cos(self.direction), sin(self.direction)
        return along(
            pace,
            (north * s, west * s, self.height - c, self.yaw),
            (north * w * c, west * w * c, w * s, 0.0),
            (-north * w * w * s, -west * w * w * s, w * w * c, 0.0),
        )

    @property
    def smoothness(self) -> int:
        """Up to the acceleration; without a ramp, every derivative."""
        return 2 if self.ramp > 0.0 else ALL_DERIVATIVES

    def derivatives(self, t: Array, highest: int) -> Array:
        """Return the flat outputs and their time derivatives."""
        s, c = sine_cosine(self.rate * start_clock(Jet.variable(t, 1.0, highest), self.ramp))
        north, west = self.radius * cos(self.direction), self.radius * sin(self.direction)
        return flat_derivatives(north * s, west * s, self.height - self.radius * c, self.yaw)
