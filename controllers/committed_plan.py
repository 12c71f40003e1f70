"""A plan that a helicopter has committed to: a trajectory that ends at rest, on a grid of times."""

from typing import NamedTuple

import numpy as np

from controllers.flatness import FlatOutput
from controllers.signals import Array
from controllers.splines import quintic, quintic_derivatives


class CommittedPlan(NamedTuple):
    """A planned flight on a grid of times: polynomials of degree five between knots, and at rest after the last."""

    start: int
    """Time of the first knot, ns."""
    step: int
    """Time between two knots, ns."""
    knots: Array
    """(n, 3, 4) at each knot x y z (world, m) and yaw (rad), their velocities and their accelerations."""

    def flat(self, t: Array) -> FlatOutput:
        """Return the flat outputs at the times t (n,), s; before the first knot it is at rest there."""
        return quintic(t, self.times, *np.moveaxis(self.knots, 1, 0))

    @property
    def smoothness(self) -> int:
        """Up to the acceleration."""
        return 2

    def derivatives(self, t: Array, highest: int) -> Array:
        """Return the flat outputs and their time derivatives at the times t (n,), s: (highest + 1, n, 4)."""
        points, velocities, accelerations = np.moveaxis(self.knots, 1, 0)
        return quintic_derivatives(t, highest, self.times, points, (velocities, accelerations))

    @property
    def times(self) -> Array:
        """(n,) times of the knots, s."""
        return 1e-9 * (self.start + self.step * np.arange(len(self.knots), dtype=np.float64))
