"""Fly a figure of eight."""

from dataclasses import dataclass
from math import pi
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt, Unit, doc

from controllers.flatness import FlatOutput
from controllers.jets import Jet, arctan2, flat_derivatives, sine_cosine
from controllers.pace import Coordinates, along, smooth_start, start_clock
from controllers.signals import Array
from controllers.trajectories import ALL_DERIVATIVES


@dataclass(frozen=True, slots=True)
class Lemniscate:
    """A level figure of eight about the origin, its lobes to the north and the south (Gerono's lemniscate)."""

    kind: Literal["lemniscate"] = "lemniscate"
    length: Annotated[float, Gt(0), Unit("m"), doc("from the north end to the south end")] = 1.4
    width: Annotated[float, Gt(0), Unit("m"), doc("of a lobe")] = 0.7
    rate: Annotated[float, Unit("rad/s"), doc("angular rate, a whole figure is 2 pi; negative flies it backwards")] = (
        0.8
    )
    height: Annotated[float, Gt(0), Unit("m"), doc("height of the centre of gravity above the floor")] = 1.0
    heading: Annotated[Literal["path", "fixed"], doc("nose along the path, or always north")] = "path"
    ramp: Annotated[float, Ge(0), Unit("s"), doc("time to gather speed from a standing start; 0 starts in motion")] = (
        2.0
    )

    def flat(self, t: Array) -> FlatOutput:
        """Return the point on the figure at the angle of a smooth start from its middle."""
        pace = smooth_start(t, self.ramp)
        angle, w, a, b = self.rate * pace[0], self.rate, 0.5 * self.length, 0.5 * self.width
        s, c, s2, c2 = np.sin(angle), np.cos(angle), np.sin(2.0 * angle), np.cos(2.0 * angle)
        yaw, turn, bend = self._heading(angle)
        point: Coordinates = (a * s, b * s2, self.height, yaw)
        slope: Coordinates = (w * a * c, 2.0 * w * b * c2, 0.0, w * turn)
        return along(pace, point, slope, (-w * w * a * s, -4.0 * w * w * b * s2, 0.0, w * w * bend))

    def _heading(self, angle: Array) -> tuple[Array | float, Array | float, Array | float]:
        """Heading along the figure and its first two derivatives with respect to the angle."""
        if self.heading == "fixed":
            return 0.0, 0.0, 0.0
        a, b = 0.5 * self.length, 0.5 * self.width
        dx, ddx, dddx = a * np.cos(angle), -a * np.sin(angle), -a * np.cos(angle)
        dy, ddy, dddy = 2 * b * np.cos(2 * angle), -4 * b * np.sin(2 * angle), -8 * b * np.cos(2 * angle)
        square, cross = dx * dx + dy * dy, dx * ddy - dy * ddx
        turn = cross / square
        bend = (dx * dddy - dy * dddx - 2.0 * turn * (dx * ddx + dy * ddy)) / square
        return self._middle + np.arctan2(dx, -dy), turn, bend

    @property
    def _middle(self) -> float:
        """Middle of the range of headings, west or east.

        One lobe turns right by as much as the other turns left. Relative to the middle, the direction stays within
        +-(pi / 2 + atan(2 b / a)), so that the arc tangent never wraps.
        """
        return -0.5 * pi if self.rate >= 0.0 else 0.5 * pi

    @property
    def smoothness(self) -> int:
        """Up to the acceleration; without a ramp, every derivative."""
        return 2 if self.ramp > 0.0 else ALL_DERIVATIVES

    def derivatives(self, t: Array, highest: int) -> Array:
        """Return the flat outputs and their time derivatives."""
        angle = self.rate * start_clock(Jet.variable(t, 1.0, highest), self.ramp)
        a, b = 0.5 * self.length, 0.5 * self.width
        (s, c), (s2, c2) = sine_cosine(angle), sine_cosine(2.0 * angle)
        yaw = arctan2(a * c, -2.0 * b * c2) + self._middle if self.heading == "path" else 0.0
        return flat_derivatives(a * s, b * s2, self.height, yaw)
