"""Disturbances: what the surroundings do. One file is one disturbance; it is found by its `kind`, without a registry.

All are evaluated at the same fixed times, `PERIOD_NS` apart, so that two controllers meet the same random numbers.
"""

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from heli_twin.lab.plant import Air, Truth

PERIOD_NS = 20_000_000
"""Time between two updates."""


class Disturbance(Protocol):
    """A disturbance in flight."""

    def air(self, truth: Truth) -> Air:
        """Return its contribution to the air of the next `PERIOD_NS`."""
        ...


class DisturbanceSpec(Protocol):
    """A disturbance as a value. A frozen dataclass with a literal `kind`."""

    @property
    def kind(self) -> str:
        """Its name."""
        ...

    def start(self, rng: np.random.Generator) -> Disturbance:
        """A disturbance for one flight."""
        ...


def together(parts: Sequence[Air]) -> Air:
    """Combine all contributions: winds and pushes are added, thrust factors multiplied."""
    wind, push, factor = np.zeros(3), np.zeros(3), 1.0
    for part in parts:
        wind, push, factor = wind + part.wind, push + part.acceleration, factor * part.thrust_factor
    return Air(wind, push, factor)
