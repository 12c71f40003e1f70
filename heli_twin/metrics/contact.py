"""Whether two helicopters touch, and how near they are.

A helicopter is an upright cylinder: as wide as its rotors, from the skids to the bar above them. Its tail is longer
than the disc by 4 cm, and is left out.
"""

import numpy as np

from controllers.signals import Array
from heli_twin.lab.plant.size import ABOVE_M, BELOW_M, RADIUS_M


def touching(positions: Array) -> list[tuple[int, int]]:
    """Return the pairs that touch of helicopters whose centres of gravity are at `positions`, (n, 3), world, m."""
    apart = positions[:, None] - positions
    near = (np.hypot(apart[..., 0], apart[..., 1]) < 2.0 * RADIUS_M) & (np.abs(apart[..., 2]) < BELOW_M + ABOVE_M)
    return [(i, j) for i, j in np.argwhere(near).tolist() if i < j]
