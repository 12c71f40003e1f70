"""Keyed chance: every component draws from a generator of its own, so that one's draws never shift another's."""

from zlib import crc32

import numpy as np


def generator(seed: int, component: str) -> np.random.Generator:
    """The generator of one component of one flight; the same on every machine."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(crc32(component.encode()),)))
