"""What the surroundings do. One file here is one disturbance; it is found by its `kind` and needs no registry.

All are asked at the same fixed times, `PERIOD` apart, whatever the controller does: shared random numbers.
"""

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from heli_twin.lab.plant import Air, Truth

PERIOD = 20_000_000
"""Time between two updates, ns."""


class Disturbance(Protocol):
    """A disturbance in flight."""

    def air(self, truth: Truth) -> Air:
        """Its share of the next `PERIOD`."""
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


def together(shares: Sequence[Air]) -> Air:
    """All shares at once: winds and pushes add up, thrust factors multiply."""
    wind, push, factor = np.zeros(3), np.zeros(3), 1.0
    for share in shares:
        wind, push, factor = wind + share.wind, push + share.acceleration, factor * share.thrust_factor
    return Air(wind, push, factor)
