"""Wind that grows with height."""

from dataclasses import dataclass
from math import cos, sin
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Le, Unit, doc

from heli_twin.lab.plant import Air, Truth


@dataclass(frozen=True, slots=True)
class WindShear:
    """A level wind in proportion to the height above the floor: wind = gradient z, none below the floor."""

    kind: Literal["wind_shear"] = "wind_shear"
    gradient: Annotated[float, Ge(-10), Le(10), Unit("1/s"), doc("wind per height")] = 0.3
    direction: Annotated[float, Ge(-3.2), Le(3.2), Unit("rad"), doc("where it blows to: 0 north, pi/2 west")] = 0.0

    def start(self, rng: np.random.Generator) -> "WindShear":
        """Return itself: it depends only on where the helicopter is."""
        return self

    def air(self, truth: Truth) -> Air:
        """Return the wind at the helicopter's height."""
        speed = self.gradient * max(float(truth.position[2]), 0.0)
        return Air(speed * np.array([cos(self.direction), sin(self.direction), 0.0]), np.zeros(3))
