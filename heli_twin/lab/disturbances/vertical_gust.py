"""Gusts up and down."""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt, Le, Unit, doc

from heli_twin.lab.disturbances.gust import OrnsteinUhlenbeck
from heli_twin.lab.plant import Air, Truth


@dataclass(frozen=True, slots=True)
class VerticalGust:
    """Vertical wind as an Ornstein-Uhlenbeck process; it acts through the heave damping, `plant.drag_z`."""

    kind: Literal["vertical_gust"] = "vertical_gust"
    strength: Annotated[float, Ge(0), Le(10), Unit("m/s"), doc("standard deviation of the wind")] = 0.1
    time: Annotated[float, Gt(0), Le(1000), Unit("s"), doc("time in which the wind changes")] = 0.5

    def start(self, rng: np.random.Generator) -> "VerticalGustInFlight":
        """Start the wind of one flight."""
        return VerticalGustInFlight(OrnsteinUhlenbeck(self.strength, self.time, 1, rng))


class VerticalGustInFlight:
    """The vertical wind of one flight."""

    def __init__(self, process: OrnsteinUhlenbeck) -> None:
        self._process = process

    def air(self, truth: Truth) -> Air:
        """Return the wind of the next period."""
        return Air(np.array([0.0, 0.0, *self._process.next()]), np.zeros(3))
