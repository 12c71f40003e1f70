"""What a planner knows of all others in its turn, on the common grid of times, and the half-spaces between them."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from controllers.plan_qp import HalfSpaces
from controllers.separation import FINE, distances, fine_path
from controllers.signals import Array

Mask = NDArray[np.bool_]

NEAR_M = 0.4
"""Others whose plans come nearer than the distance to keep and this are in the first QP; further ones if need be."""
BETWEEN_M = 0.012
"""Added to the distance to keep at the knots, for what is between them: half the square of 2 m/s times 0.05 s, by
0.45 m, and the bend of the path."""


class Scene(NamedTuple):
    """The own committed plan and what is known of the others, from one index of the grid on."""

    first: int
    """Index g of the knot from which on a plan can be new; plans begin a knot earlier."""
    h: float
    """Duration of a step, s."""
    bend: float
    """Greatest distance of a relative path from a chord, m; see `controllers.separation.bend_of`."""
    old: Array
    """(L + 2, 3, 4) knots of the own committed plan from g - 1 on."""
    names: list[str]
    """Of the others."""
    knots: Array
    """(j, L + 2, 2) positions of the others."""
    paths: Array
    """(j, t, 2) positions of the others, `FINE` in each step."""
    wide: Array
    """(j, t - 1) distance to keep from each during each chord, m."""
    in_danger: Mask
    """(j,) whether the own plan leads to one that has left its plan to land."""
    pressed: Mask
    """(j,) whether the own plan is nearer than wanted to one that lands or that its cameras have lost."""
    push: float
    """Acceleration at which plans move away from those, m/s^2."""
    unheard: list[str]
    """Those whose newest turns have not been heard."""

    @property
    def here(self) -> Array:
        """(2,) where the own plan is at the knot g."""
        return self.old[1, 0, :2]

    def room(self, knots: Array) -> Array:
        """Return how much further than to keep from each (j,), m, a plan (L + 2, 3, 4) from g - 1 on stays at least."""
        if not self.names:
            return np.zeros(0)
        return (distances(fine_path(knots, self.h), self.paths, self.bend) - self.wide).min(axis=1)

    def half_spaces(self, near: Mask, turn: float, steps: int, braking: float) -> HalfSpaces | None:
        """Return lines between the own old plan and those of others, turned so that all pass on the right.

        The old plan is behind each, so that it stays feasible, but for those that it has to move away from; from one
        that lies ahead all that braking allows.

        Args:
            near: (j,) from whom to keep away.
            turn: Greatest turn of the lines, rad.
            steps: Knots g + 1 .. g + steps are kept behind them.
            braking: Acceleration away from one that lies ahead, m/s^2.
        """
        k = np.arange(1, steps + 1, dtype=np.int64)
        sides: list[tuple[NDArray[np.int64], Array, Array]] = []
        for j in np.flatnonzero(near):
            there = self.knots[j, 2 : steps + 2]
            away = self.old[2 : steps + 2, 0, :2] - there
            # Of the chord before each knot.
            keep = self.wide[j, FINE - 1 :: FINE][1 : steps + 1] + BETWEEN_M
            if self.in_danger[j]:
                away = np.tile(self.here - self.knots[j, 1], (steps, 1))
            apart = np.maximum(np.hypot(*away.T), 1e-6)
            angle = np.minimum(turn, 0.9 * np.arccos(np.minimum(keep / apart, 1.0)))
            c, s = np.cos(angle), np.sin(angle)
            normals = np.stack([c * away[:, 0] - s * away[:, 1], s * away[:, 0] + c * away[:, 1]], axis=1)
            normals /= apart[:, None]
            kept = (normals * away).sum(axis=1)
            if self.in_danger[j]:
                # As hard as it can brake, and then away.
                t, closing = self.h * k, (normals * self.old[1, 1, :2]).sum(axis=1)
                kept += closing * t + 0.5 * braking * t**2
            elif self.pressed[j]:
                kept += 0.5 * self.push * (self.h * k) ** 2
            sides.append((k, normals, (normals * there).sum(axis=1) + np.minimum(keep, kept)))
        if not sides:
            return None
        knots, normals, offsets = zip(*sides, strict=True)
        return HalfSpaces(np.concatenate(knots), np.concatenate(normals), np.concatenate(offsets))
