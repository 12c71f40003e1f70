"""A trajectory and a disturbance of a user's own in one file."""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Gt, Unit, doc

from controllers.flatness import FlatOutput
from controllers.pace import along, smooth_start
from heli_twin.lab.plant import Air


@dataclass(frozen=True, slots=True)
class Helix:
    """A circle that climbs and falls slowly."""

    kind: Literal["helix"] = "helix"
    radius: Annotated[float, Gt(0), Unit("m"), doc("of the circle")] = 0.4

    def flat(self, t: np.ndarray) -> FlatOutput:
        """Flat outputs at the times t."""
        pace = smooth_start(t, 2.0)
        a = pace[0]
        r, c, s = self.radius, np.cos(a), np.sin(a)
        rise, slope, bend = 0.2 * (1 - np.cos(0.3 * a)), 0.06 * np.sin(0.3 * a), 0.018 * np.cos(0.3 * a)
        return along(pace, (r * c, r * s, 1.0 + rise, 0.0), (-r * s, r * c, slope, 0.0), (-r * c, -r * s, bend, 0.0))


class Rising:
    """Air that rises more in the middle of the room."""

    def __init__(self, spec: "Thermal") -> None:
        self.spec = spec

    def air(self, truth: object) -> Air:
        """The push of the next period."""
        x, y, _ = truth.position
        return Air(np.zeros(3), np.array([0.0, 0.0, self.spec.strength * np.exp(-(x * x + y * y))]))


@dataclass(frozen=True, slots=True)
class Thermal:
    """Rising air in the middle of the room."""

    kind: Literal["thermal"] = "thermal"
    strength: Annotated[float, Unit("m/s^2"), doc("greatest push upwards")] = 0.3

    def start(self, rng: np.random.Generator) -> Rising:
        """For one flight; it needs no chance."""
        return Rising(self)
