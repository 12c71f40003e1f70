"""Keyed chance: every component draws from its own generator, so that the draws of one never shift those of another."""

from zlib import crc32

import numpy as np


def generator(seed: int, component: str) -> np.random.Generator:
    """Return the generator of one component of one flight; the same on every machine."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(crc32(component.encode()),)))
