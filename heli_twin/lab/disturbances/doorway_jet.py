"""A jet of air from a doorway: it blows where the helicopter flies through it."""

from dataclasses import dataclass
from math import cos, exp, sin
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt, Le, Unit, doc

from heli_twin.lab.plant import Air, Truth

SPREAD = 0.1
"""Growth of a turbulent jet's width per distance."""


@dataclass(frozen=True, slots=True)
class DoorwayJet:
    """A level jet that leaves the middle of a doorway at (x, y, z) and spreads.

        wind = speed (width / w) exp(-(r / w)^2),   w = width + 0.1 s

    s is the distance from the doorway along the jet, r that from its axis; behind the doorway the air is still.

    Source: a turbulent jet spreads by about 0.1 and keeps its momentum: Pope, Turbulent Flows, section 5.1.
    """

    kind: Literal["doorway_jet"] = "doorway_jet"
    x: Annotated[float, Ge(-10), Le(10), Unit("m"), doc("of the doorway, north")] = -2.5
    y: Annotated[float, Ge(-10), Le(10), Unit("m"), doc("of the doorway, west")] = 0.0
    z: Annotated[float, Ge(-10), Le(10), Unit("m"), doc("of the doorway, above the floor")] = 1.0
    direction: Annotated[float, Ge(-3.2), Le(3.2), Unit("rad"), doc("where it blows to: 0 north, pi/2 west")] = 0.0
    speed: Annotated[float, Ge(0), Le(10), Unit("m/s"), doc("in the middle of the doorway")] = 0.5
    width: Annotated[float, Gt(0), Le(10), Unit("m"), doc("from its axis to where it blows at 37 %")] = 0.3

    def start(self, rng: np.random.Generator) -> "DoorwayJet":
        """Return itself: it depends only on where the helicopter is."""
        return self

    def air(self, truth: Truth) -> Air:
        """Return the wind where the helicopter is."""
        along = np.array([cos(self.direction), sin(self.direction), 0.0])
        offset = truth.position - np.array([self.x, self.y, self.z])
        s = float(offset @ along)
        if s < 0.0:
            return Air(np.zeros(3), np.zeros(3))
        width = self.width + SPREAD * s
        r_squared = float(offset @ offset) - s * s
        return Air(self.speed * self.width / width * exp(-r_squared / width**2) * along, np.zeros(3))
