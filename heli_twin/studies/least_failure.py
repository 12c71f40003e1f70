"""The least change from nominal that fails: an upper limit of it, found near the mean of the failures of a search.

The mean is scaled until it just fails: of axes and noise together, of the noise alone and of the axes alone. From
there, the slope of the score along the means of failures that descend from one flight tells a nearer direction, which
is scaled in the same way. As many random changes of the same size tell whether the direction matters.

The size of a change counts 1 for axes as far from the middle, and 1 for noise as strong, as in a usual flight.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf, isfinite
from typing import Literal

import numpy as np

from heli_twin.lab.chance import generator
from heli_twin.studies.subset_simulation import State, combined, fresh, mean_state, scaled, size

TRIED = 8
"""Flights at a time, twice, to find how little is enough."""
RANDOM = 20
"""Flights as far from nominal in random directions."""
MOST_FAILURES = 100
"""Failures that are averaged."""
MOST_PARTS = 16
"""Directions along which the slope of the score is measured."""
STEP = 0.15
"""Size of the changes by which it is measured."""
RIDGE = 0.01
"""Share of the usual variance by which directions that depend on each other are kept apart."""
MOST_CHANGES = 3
FARTHEST_NOISE, FARTHEST_AXES = 1.0, 4.0
"""How far from nominal a change is tried: share of the usual noise, and standard deviations of the axes. Where flights
fail in many ways, their mean is small and has to be scaled up to fail."""
Change = Literal["all", "noise", "axes"]


@dataclass(frozen=True)
class Narrowing:
    """A change from nominal, and the factors between which it begins to fail."""

    change: Change
    state: State
    low: float = 0.0
    high: float = 0.0
    score: float = -inf
    """At `high`."""

    @property
    def states(self) -> list[State]:
        """Its states at the next factors to fly."""
        return [scaled(self.state, factor) for factor in self._factors]

    @property
    def least(self) -> State:
        """Its state at `high`."""
        return scaled(self.state, self.high)

    @property
    def _factors(self) -> list[float]:
        return [self.low + (self.high - self.low) * (i + 1) / TRIED for i in range(TRIED)]

    def learn(self, scores: Sequence[float], limit: float) -> "Narrowing | None":
        """Return the narrower one, from the scores of its states; None if it is not known to fail."""
        first = next((i for i in range(TRIED) if scores[i] >= limit), None)
        if first is None:
            # The upper end may have failed before, with another last digit.
            return self if self.score >= limit else None
        factors = self._factors
        return replace(self, low=factors[first - 1] if first else self.low, high=factors[first], score=scores[first])


def narrowings(mean: State) -> list[Narrowing]:
    """Return the changes to look at, from the mean of the failures; without axes there is one."""
    parts: dict[Change, State] = {"all": mean}
    if mean.place:
        parts |= {"noise": State((0.0,) * len(mean.place), mean.noise), "axes": State(mean.place, ((0, 0.0),))}
    return [Narrowing(change, state, high=_farthest(change, state)) for change, state in parts.items()]


def _farthest(change: Change, state: State) -> float:
    axes, noise = size(state)
    return FARTHEST_AXES / max(axes, 1e-9) if change == "axes" else max(1.25, FARTHEST_NOISE / max(noise, 1e-9))


def length(axes: float, noise: float, number: int) -> float:
    """Return the size of a change.

    Args:
        axes: Standard deviations from the middle.
        noise: Share of the usual.
        number: Of axes.
    """
    return float(np.hypot(axes / max(number, 1) ** 0.5, noise))


def some_of(failures: Sequence[State]) -> Sequence[State]:
    """Return failures evenly spread over all: a flight with the noise of thousands of seeds would take minutes."""
    return failures[:: -(-len(failures) // MOST_FAILURES)]


def parts_of(failures: Sequence[State]) -> list[State]:
    """Return changes of size 1: the means of the failures that descend from one flight, of most descendants first."""
    families: dict[int, list[State]] = {}
    for state in failures:
        families.setdefault(state.noise[0][0], []).append(state)
    means = [mean_state(family) for family in sorted(families.values(), key=len, reverse=True)[:MOST_PARTS]]
    return [scaled(mean, 1.0 / max(_length(mean), 1e-9)) for mean in means]


def stepped(least: State, part: State) -> State:
    """Return the least failure a step further along a part."""
    return combined([least, part], [1.0, STEP])


def steepest(parts: Sequence[State], gains: Sequence[float]) -> State | None:
    """Return the direction, of size 1, in which the score grows most.

    Args:
        parts: Changes of size 1.
        gains: By how much the score grew with a step along each.

    Returns:
        None if a step crashed, or if the score grows in no direction.
    """
    if not parts or not all(map(isfinite, gains)):
        return None
    products = np.array([[_product(a, b) for b in parts] for a in parts])
    weights = np.linalg.solve(products + RIDGE * np.eye(len(parts)), np.array(gains))
    direction = combined(parts, weights.tolist())
    return scaled(direction, 1.0 / _length(direction)) if _length(direction) > 1e-9 else None


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
        norm = float(np.linalg.norm(direction)) or 1.0
        states.append(State(tuple((axes / norm * direction).tolist()), ((each, noise),)))
    return states


def first_random_seed(seed: int) -> int:
    """Return a seed above all that a search of this seed draws from."""
    return int(generator(seed, "random directions").integers(500_000_000_000, 900_000_000_000))


def _length(state: State) -> float:
    return length(*size(state), len(state.place))


def _product(a: State, b: State) -> float:
    weights = dict(b.noise)
    noise = sum(weight * weights.get(seed, 0.0) for seed, weight in a.noise)
    return noise + float(np.dot(a.place, b.place)) / max(len(a.place), 1)
