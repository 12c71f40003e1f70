"""Stay in one place."""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Gt, Unit, doc

from controllers.flatness import FlatOutput
from controllers.signals import Array
from controllers.trajectories import ALL_DERIVATIVES


@dataclass(frozen=True, slots=True)
class Hover:
    """Hold position and heading (the flight of Fig. 4)."""

    kind: Literal["hover"] = "hover"
    x: Annotated[float, Unit("m"), doc("where to hover, north")] = 0.0
    y: Annotated[float, Unit("m"), doc("where to hover, west")] = 0.0
    height: Annotated[float, Gt(0), Unit("m"), doc("height of the centre of gravity above the floor")] = 1.0
    yaw: Annotated[float, Unit("rad"), doc("heading, 0 is north, positive to port")] = 0.0

    def flat(self, t: Array) -> FlatOutput:
        """Return the same point at all times."""
        rest = np.zeros((len(t), 4))
        return FlatOutput(rest + np.array([self.x, self.y, self.height, self.yaw]), rest, rest)

    @property
    def smoothness(self) -> int:
        """Every derivative."""
        return ALL_DERIVATIVES

    def derivatives(self, t: Array, highest: int) -> Array:
        """Return the flat outputs and their time derivatives, which are 0."""
        rest = np.zeros((highest + 1, len(t), 4))
        rest[0] = self.x, self.y, self.height, self.yaw
        return rest
