"""The least change from nominal that fails: the mean of the failures of a search, scaled until it just fails.

It is looked for three times: of axes and noise together, of the noise alone and of the axes alone. As many random
changes of the same size tell whether its direction matters.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from heli_twin.lab.chance import generator
from heli_twin.studies.subset_simulation import State, fresh, scaled, size

TRIED = 8
"""Flights at a time, twice, to find how little is enough."""
RANDOM = 20
"""Flights as far from nominal in random directions."""
Change = Literal["all", "noise", "axes"]
MOST_CHANGES = 3
FARTHEST_NOISE, FARTHEST_AXES = 1.0, 4.0
"""How far from nominal a change is tried: share of the usual noise, and standard deviations of the axes. Where flights
fail in many ways, their mean is small and has to be scaled up to fail."""


@dataclass(frozen=True)
class Narrowing:
    """A change from nominal, and the factors between which it begins to fail."""

    change: Change
    state: State
    low: float = 0.0
    high: float = 0.0
    fails: bool = False
    """True if it fails at `high`."""

    @property
    def factors(self) -> list[float]:
        """The next factors to fly."""
        return [self.low + (self.high - self.low) * (i + 1) / TRIED for i in range(TRIED)]

    @property
    def states(self) -> list[State]:
        """Its states at these factors."""
        return [scaled(self.state, factor) for factor in self.factors]

    def learn(self, failed: Mapping[int, bool]) -> "Narrowing | None":
        """Return the narrower one, from whether each factor failed; None if none did."""
        first = next((i for i in range(TRIED) if failed[i]), None)
        if first is None:
            # The upper end of what is left has failed before.
            return self if self.fails else None
        factors = self.factors
        return replace(self, low=factors[first - 1] if first else self.low, high=factors[first], fails=True)


def narrowings(mean: State) -> list[Narrowing]:
    """Return the changes to look at, from the mean of the failures; without axes there is one."""
    parts: dict[Change, State] = {"all": mean}
    if mean.place:
        parts |= {"noise": State((0.0,) * len(mean.place), mean.noise), "axes": State(mean.place, ((0, 0.0),))}
    return [Narrowing(change, state, high=_farthest(change, state)) for change, state in parts.items()]


def _farthest(change: Change, state: State) -> float:
    axes, noise = size(state)
    return FARTHEST_AXES / max(axes, 1e-9) if change == "axes" else max(1.25, FARTHEST_NOISE / max(noise, 1e-9))


def random_states(least: State, seed: int) -> list[State]:
    """Return states as far from nominal as the least failure, axes and noise each, in random directions.

    Args:
        least: The least failure.
        seed: The first of `RANDOM` seeds, which nothing else draws from.
    """
    axes, noise = size(least)
    states: list[State] = []
    for each in range(seed, seed + RANDOM):
        direction = np.array(fresh(each, len(least.place)).place)
        length = float(np.linalg.norm(direction)) or 1.0
        states.append(State(tuple((axes / length * direction).tolist()), ((each, noise),)))
    return states


def first_random_seed(seed: int) -> int:
    """Return a seed above all that a search of this seed draws from."""
    return int(generator(seed, "random directions").integers(500_000_000_000, 900_000_000_000))
