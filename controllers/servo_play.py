"""The play between the cyclic servos and the swashplate: where the plate stands, and how to move it in spite of it."""

import numpy as np

from controllers.signals import Array

_SURE = 0.01
"""Change of the wanted input, full stick, for which the whole play is crossed; for a smaller one a part of it. Without
this, noise of the plan would throw the servos to and fro."""


class ServoPlay:
    """The swashplate of one flight, which stands still while its servo is within half of the play.

    Args:
        width: The play of pitch and roll, end to end, full stick.
    """

    def __init__(self, width: float) -> None:
        self._half, self._plate = 0.5 * width, np.zeros(2)

    def follow(self, u: Array) -> Array:
        """Return the input (4,) that acts when u (4,) is sent: the plate is dragged along."""
        acting = u.copy()
        acting[:2] = self._plate = np.minimum(np.maximum(self._plate, u[:2] - self._half), u[:2] + self._half)
        return acting

    def ahead(self, wanted: Array) -> Array:
        """Return the input (4,) to send so that `wanted` (4,) acts: ahead of it by half of the play where it moves."""
        sent, move = wanted.copy(), (wanted[:2] - self._plate) / _SURE
        sent[:2] += self._half * np.minimum(np.maximum(move, -1.0), 1.0)
        self.follow(sent)
        return sent
