"""Whether two helicopters touch, and how near they are.

A helicopter is an upright cylinder: as wide as its rotors, from the skids to the bar above them. Its tail is longer
than the disc by 4 cm, and is left out.
"""

import numpy as np

from controllers.signals import Array

RADIUS_M = 0.095
"""Of the rotor disc of the mCX2."""
BELOW_M, ABOVE_M = 0.047, 0.076
"""From the centre of gravity down to the skids and up to the bar, upright."""


def touching(a: Array, b: Array) -> bool:
    """Return whether two helicopters touch whose centres of gravity are at a and b, (3,) world, m."""
    across, above = a[:2] - b[:2], abs(float(a[2] - b[2]))
    return bool(np.hypot(*across) < 2.0 * RADIUS_M and above < BELOW_M + ABOVE_M)
