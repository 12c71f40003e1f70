"""Keyed chance: every component draws from its own generator, so that the draws of one never shift those of another.

Every random number of a flight comes from the generators that `Flight` is given, and from nowhere else. What is drawn
at each instant (a frame of the cameras, a period of the gust) is drawn in blocks ahead of it: the numbers of a block
depend on seed and component alone, neither on the duration nor on what the helicopter does. Pure functions of such
blocks give wind, noise, delay and losses.

To search for rare flights, noise is varied as a whole: `mixed` gives generators whose normal numbers are weighted sums
of those of several seeds. With squared weights that add up to 1 they are as probable as those of any seed.
"""

from collections.abc import Callable, Iterator, Sequence
from itertools import accumulate
from typing import Any, NoReturn, cast
from zlib import crc32

import numpy as np

from controllers.signals import Array
from heli_twin.errors import HeliTwinError

BLOCK = 64
"""Instants in a block. The numbers are the same for every size: a generator gives one sequence however it is asked."""


Chance = Callable[[int, str], np.random.Generator]
"""Gives the generator of a component of the flight with a seed; a name and a seed have always the same numbers."""


def generator(seed: int, component: str) -> np.random.Generator:
    """Return the generator of one component of one flight; the same on every machine."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(crc32(component.encode()),)))


def blocks(draw: Callable[[tuple[int, ...]], Array], *shape: int) -> Iterator[Array]:
    """Yield blocks (BLOCK, *shape) without end.

    Args:
        draw: A method of a generator that takes the shape of its draws, such as `standard_normal`.
        shape: Of the draws of one instant.
    """
    while True:
        yield draw((BLOCK, *shape))


def coloured(before: Array, keep: float, shocks: Array) -> Array:
    """Return x_k = keep x_{k-1} + shock_k for k = 0 .. n - 1: an Ornstein-Uhlenbeck process at equal intervals.

    Args:
        before: (d,) x_{-1}.
        keep: Share that is left after one interval.
        shocks: (n, d) independent normal numbers.

    Returns:
        (n, d), in the order of time.
    """

    def following(x: float, shock: float) -> float:
        return keep * x + shock

    started = np.concatenate([before[None], shocks])
    return np.array([[*accumulate(column, following)] for column in started.T.tolist()]).T[1:]


class Mixed:
    """Draws as a `numpy.random.Generator` does, from the weighted sum of the normal numbers of several.

    Args:
        parts: Generators and their weights.
    """

    def __init__(self, parts: Sequence[tuple[np.random.Generator, float]]) -> None:
        self._parts = parts

    def standard_normal(self, size: Any = None) -> Any:
        """Return normal numbers, of variance 1 if the squared weights add up to 1."""
        return sum(weight * part.standard_normal(size) for part, weight in self._parts)

    def normal(self, loc: float = 0.0, scale: float = 1.0, size: Any = None) -> Any:
        """Return normal numbers of a mean and a standard deviation."""
        return loc + scale * self.standard_normal(size)

    def random(self, size: Any = None) -> Any:
        """Return numbers in [0, 1]; uniform ones if the squared weights add up to 1."""
        # A heavy import, for these flights alone.
        from scipy.special import ndtr

        return ndtr(self.standard_normal(size))

    def uniform(self, low: float = 0.0, high: float = 1.0, size: Any = None) -> Any:
        """Return numbers between two limits."""
        return low + (high - low) * self.random(size)

    def exponential(self, scale: float = 1.0, size: Any = None) -> Any:
        """Return exponential numbers with a mean of `scale`."""
        from scipy.special import log_ndtr

        return -scale * log_ndtr(self.standard_normal(size))

    def integers(self, low: int, high: int | None = None, size: Any = None) -> Any:
        """Return whole numbers from `low` to below `high`, or from 0 to below `low`."""
        first, end = (0, low) if high is None else (low, high)
        return np.minimum(first + np.floor((end - first) * self.random(size)).astype(np.int64), end - 1)

    def __getattr__(self, name: str) -> NoReturn:
        """Refuse other distributions, which have no meaning here.

        Raises:
            HeliTwinError: Names the method and those that there are.
        """
        if name.startswith("__"):
            raise AttributeError(name)
        raise HeliTwinError(
            f"a component draws by `{name}`, which a mixture of noise does not have: use standard_normal, normal,"
            " random, uniform, exponential or integers"
        )


def mixed(noise: Sequence[tuple[int, float]]) -> Chance:
    """Return a source whose normal numbers are the weighted sum of those of several seeds; uniform ones follow them.

    Args:
        noise: Seeds and weights.
    """

    def chance(seed: int, component: str) -> np.random.Generator:
        parts = [(generator(part, component), weight) for part, weight in noise]
        return cast(np.random.Generator, Mixed(parts))

    return chance
