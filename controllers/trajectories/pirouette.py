"""Turn on the spot."""

from dataclasses import dataclass
from typing import Annotated, Literal

from annotated_types import Ge, Gt, Unit, doc

from controllers.flatness import FlatOutput
from controllers.jets import Jet, flat_derivatives
from controllers.pace import along, smooth_start, start_clock
from controllers.signals import Array
from controllers.trajectories import ALL_DERIVATIVES


@dataclass(frozen=True, slots=True)
class Pirouette:
    """Turn at a constant rate above one point."""

    kind: Literal["pirouette"] = "pirouette"
    x: Annotated[float, Unit("m"), doc("where to turn, north")] = 0.0
    y: Annotated[float, Unit("m"), doc("where to turn, west")] = 0.0
    height: Annotated[float, Gt(0), Unit("m"), doc("height of the centre of gravity above the floor")] = 1.0
    rate: Annotated[float, Unit("rad/s"), doc("yaw rate, positive to port")] = 1.5
    ramp: Annotated[float, Ge(0), Unit("s"), doc("time to gather speed from a standing start; 0 starts in motion")] = (
        2.0
    )

    def flat(self, t: Array) -> FlatOutput:
        """Return the fixed point and the heading after a smooth start."""
        pace = smooth_start(t, self.ramp)
        point = (self.x, self.y, self.height, self.rate * pace[0])
        return along(pace, point, (0.0, 0.0, 0.0, self.rate), (0.0, 0.0, 0.0, 0.0))

    @property
    def smoothness(self) -> int:
        """Up to the acceleration; without a ramp, every derivative."""
        return 2 if self.ramp > 0.0 else ALL_DERIVATIVES

    def derivatives(self, t: Array, highest: int) -> Array:
        """Return the flat outputs and their time derivatives."""
        clock = start_clock(Jet.variable(t, 1.0, highest), self.ramp)
        return flat_derivatives(0.0 * clock + self.x, self.y, self.height, self.rate * clock)
