"""Gusts up and down."""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt, Le, Unit, doc

from heli_twin.lab.disturbances.gust import GustInFlight, gusts


@dataclass(frozen=True, slots=True)
class VerticalGust:
    """Vertical wind as an Ornstein-Uhlenbeck process; it acts through the heave damping, `plant.drag_z`."""

    kind: Literal["vertical_gust"] = "vertical_gust"
    strength: Annotated[float, Ge(0), Le(10), Unit("m/s"), doc("standard deviation of the wind")] = 0.1
    time: Annotated[float, Gt(0), Le(1000), Unit("s"), doc("time in which the wind changes")] = 0.5

    def start(self, rng: np.random.Generator) -> GustInFlight:
        """Start the wind of one flight."""
        return GustInFlight(gusts(self.strength, self.time, (2,), rng))
