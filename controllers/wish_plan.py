"""Plans of knots that follow a wish exactly, with a stop behind it, and ways to the wish and to rest."""

from typing import Literal, NamedTuple

import numpy as np

from controllers.pace import paced, smooth_start
from controllers.signals import Array
from controllers.splines import quintic
from controllers.trajectories import Trajectory

WISH_STEPS = 4
"""Steps of the wish before the stop: the laws look 0.4 s ahead, and must not see a stop that is put off again."""
JOIN_STEPS = 10
"""Steps in which a plan goes over into the wish: in fewer, it needs a jerk that shakes the helicopter."""
JOIN_LONGER = 4
"""Steps by which such a plan is longer than the others: it must stop from the wish too."""
FREE, JOINS = "", "back to its wish"
"""Reasons in the note of a turn in which the wish is clear."""


class WishPlan(NamedTuple):
    """Knots of one helicopter; those of a plan are on the grid of all, `h` apart."""

    wish: Trajectory
    h: float
    """Duration of a step, s."""
    steps: int
    """Steps of a plan, N."""

    @property
    def longest(self) -> int:
        """Steps of the longest plan, L."""
        return self.steps + JOIN_LONGER

    def wished(self, first: int, count: int, steps: int = WISH_STEPS) -> Array:
        """Return knots (count, 3, 4): the wish for some steps; then its clock slows down and stands at the last knot.

        Args:
            first: Index of the first knot on the grid.
            count: Number of knots.
            steps: Before the clock slows down.
        """
        since = self.h * (np.arange(count, dtype=np.float64) - steps)
        stop = self.h * (count - 1 - steps)
        reading, speed, acceleration = smooth_start(np.clip(stop - since, 0.0, stop), stop)
        slowed = since > 0.0
        clock = np.where(slowed, 0.5 * stop - reading, since)
        pace = clock, np.where(slowed, speed, 1.0), np.where(slowed, -acceleration, 0.0)
        return np.stack(paced(self.wish.flat(self.h * (first + steps) + clock), pace), axis=1)

    def towards_the_wish(self, old: Array, first: int) -> tuple[Literal["", "back to its wish"], Array]:
        """Return what it is, and knots (k, 3, 4): what is left of the way to the wish, the wish and a stop.

        Args:
            old: (n, 3, 4) knots of the committed plan from the index `first` on.
            first: Index of the first knot.
        """
        N = self.steps
        wish = np.stack(self.wish.flat(self.h * (first + np.arange(JOIN_STEPS + 1, dtype=np.float64))), axis=1)
        met = np.abs(wish - old[: JOIN_STEPS + 1]).max(axis=(1, 2)) < 1e-9
        if met[0]:
            return FREE, self.wished(first, N + 1)
        if met.any():
            steps = max(int(met.argmax()), WISH_STEPS)
            way = old[: met.argmax()]
        else:
            steps, t = JOIN_STEPS, self.h * np.arange(JOIN_STEPS, dtype=np.float64)
            ends = np.stack([old[0], wish[JOIN_STEPS]])
            joins = quintic(t, self.h * np.array([0.0, JOIN_STEPS]), *np.moveaxis(ends, 1, 0))
            # The first knot as it is, to the last digit.
            way = np.concatenate([old[:1], np.stack(joins, axis=1)[1:]])
        wished = self.wished(first, min(steps + N - WISH_STEPS, self.longest) + 1, steps)
        return JOINS, np.concatenate([way, wished[len(way) :]])

    def stop(self, state: Array, acceleration: float) -> Array:
        """Return knots (L + 2, 3, 4) of a straight way from a state (3, 4) to rest, at up to 1.5 accelerations."""
        length = max(0.3, float(np.abs(state[1, :3]).max()) / acceleration)
        rest = np.stack([state[0] + 0.5 * length * state[1], np.zeros(4), np.zeros(4)])
        t = self.h * np.arange(self.longest + 2, dtype=np.float64)
        way = quintic(t, np.array([0.0, length]), *np.moveaxis(np.stack([state, rest]), 1, 0))
        return np.stack(way, axis=1)

    def whole(self, before: Array, knots: Array) -> Array:
        """Put a knot (3, 4) before knots (k, 3, 4), and rest after them: (L + 2, 3, 4)."""
        rest = np.zeros((self.longest + 1 - len(knots), 3, 4))
        rest[:, 0] = knots[-1, 0]
        return np.concatenate([before[None], knots, rest])
