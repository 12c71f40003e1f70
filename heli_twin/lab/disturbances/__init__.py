"""Disturbances: what the surroundings do. One file is one disturbance; it is found by its `kind`, without a registry.

All are evaluated at the same fixed times, `PERIOD_NS` apart, so that two controllers meet the same random numbers. A
disturbance that depends on other helicopters in the room, such as their downwash, takes `others` as a second argument.
"""

import inspect
from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np

from controllers.signals import Array
from heli_twin.lab.plant import Air, Truth

PERIOD_NS = 20_000_000
"""Time between two updates."""


class Disturbance(Protocol):
    """A disturbance in flight."""

    def air(self, truth: Truth) -> Air:
        """Return its contribution to the air of the next `PERIOD_NS`."""
        ...


class SocialDisturbance(Protocol):
    """A disturbance in flight that depends on other helicopters."""

    def air(self, truth: Truth, others: Array) -> Air:
        """Return its contribution to the air of the next `PERIOD_NS`.

        Args:
            truth: The helicopter.
            others: (n, 3) positions of the other helicopters, world, m; without rows where it flies alone.
        """
        ...


ALONE: Array = np.zeros((0, 3))
"""The others of a helicopter that flies alone."""
STILL: Array = np.zeros(3)
"""No wind, or no push."""
STILL.setflags(write=False)


def air_of(disturbance: Disturbance | SocialDisturbance) -> Callable[[Truth, Array], Air]:
    """Return a function of the helicopter and the others (n, 3) for any disturbance."""
    air: Callable[..., Air] = disturbance.air
    if "others" in inspect.signature(air).parameters:
        return lambda truth, others: air(truth, others=others)
    return lambda truth, others: air(truth)


class DisturbanceSpec(Protocol):
    """A disturbance as a value. A frozen dataclass with a literal `kind`."""

    @property
    def kind(self) -> str:
        """Its name."""
        ...

    def start(self, rng: np.random.Generator) -> Disturbance | SocialDisturbance:
        """A disturbance for one flight."""
        ...


def together(parts: Sequence[Air]) -> Air:
    """Combine all contributions: winds, pushes and moments are added, thrust factors multiplied."""
    wind, push, factor, moment = STILL, STILL, 1.0, None
    for part in parts:
        wind, push, factor = wind + part.wind, push + part.acceleration, factor * part.thrust_factor
        if part.moment is not None:
            moment = part.moment if moment is None else moment + part.moment
    return Air(wind, push, factor, moment)
