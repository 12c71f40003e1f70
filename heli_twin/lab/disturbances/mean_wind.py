"""A steady wind: a fan, an open window, an updraught over a heater."""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Le, Unit, doc

from heli_twin.lab.disturbances import STILL
from heli_twin.lab.plant import Air, Truth


@dataclass(frozen=True, slots=True)
class MeanWind:
    """The same wind everywhere and at all times. Its vertical part acts through the heave damping, `plant.drag_z`."""

    kind: Literal["mean_wind"] = "mean_wind"
    x: Annotated[float, Ge(-10), Le(10), Unit("m/s"), doc("to the north")] = 0.2
    y: Annotated[float, Ge(-10), Le(10), Unit("m/s"), doc("to the west")] = 0.0
    z: Annotated[float, Ge(-10), Le(10), Unit("m/s"), doc("upwards")] = 0.0

    def start(self, rng: np.random.Generator) -> "MeanWind":
        """Return itself: a constant has no state."""
        return self

    def air(self, truth: Truth) -> Air:
        """Return the same wind at all times."""
        return Air(np.array([self.x, self.y, self.z]), STILL)
