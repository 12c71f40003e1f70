"""Keyed chance: every component draws from its own generator, so that the draws of one never shift those of another.

Every random number of a flight comes from the generators that `Flight` is given, and from nowhere else. What is drawn
at each instant (a frame of the cameras, a period of the gust) is drawn in blocks ahead of it: the numbers of a block
depend on seed and component alone, neither on the duration nor on what the helicopter does. Pure functions of such
blocks give wind, noise, delay and losses. To search for rare flights, give `Flight` generators with other numbers.
"""

from collections.abc import Callable, Iterator
from itertools import accumulate
from zlib import crc32

import numpy as np

from controllers.signals import Array

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
    started = np.concatenate([before[None], shocks])
    columns = [[*accumulate(column, lambda x, shock: keep * x + shock)] for column in started.T.tolist()]
    return np.array(columns).T[1:]
