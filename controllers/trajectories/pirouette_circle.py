"""Fly round a circle while turning about the vertical axis."""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt, Unit, doc

from controllers.flatness import FlatOutput
from controllers.jets import Jet, flat_derivatives, sine_cosine
from controllers.pace import along, smooth_start, start_clock
from controllers.signals import Array
from controllers.trajectories import ALL_DERIVATIVES


@dataclass(frozen=True, slots=True)
class PirouetteCircle:
    """A level circle about the origin with a heading that turns at another rate."""

    kind: Literal["pirouette_circle"] = "pirouette_circle"
    radius: Annotated[float, Gt(0), Unit("m"), doc("radius of the circle")] = 0.5
    rate: Annotated[float, Unit("rad/s"), doc("angular rate on the circle, positive counter-clockwise from above")] = (
        0.8
    )
    yaw_rate: Annotated[float, Unit("rad/s"), doc("rate of the heading, positive to port")] = 1.6
    height: Annotated[float, Gt(0), Unit("m"), doc("height of the centre of gravity above the floor")] = 1.0
    ramp: Annotated[float, Ge(0), Unit("s"), doc("time to gather speed from a standing start; 0 starts in motion")] = (
        2.0
    )

    def flat(self, t: Array) -> FlatOutput:
        """Return the point on the circle and the heading after a smooth start from heading north."""
        pace = smooth_start(t, self.ramp)
        angle, w = self.rate * pace[0], self.rate
        c, s = self.radius * np.cos(angle), self.radius * np.sin(angle)
        return along(
            pace,
            (c, s, self.height, self.yaw_rate * pace[0]),
            (-w * s, w * c, 0.0, self.yaw_rate),
            (-w * w * c, -w * w * s, 0.0, 0.0),
        )

    @property
    def smoothness(self) -> int:
        """Up to the acceleration; without a ramp, every derivative."""
        return 2 if self.ramp > 0.0 else ALL_DERIVATIVES

    def derivatives(self, t: Array, highest: int) -> Array:
        """Return the flat outputs and their time derivatives."""
        clock = start_clock(Jet.variable(t, 1.0, highest), self.ramp)
        s, c = sine_cosine(self.rate * clock)
        return flat_derivatives(self.radius * c, self.radius * s, self.height, self.yaw_rate * clock)
