"""Distances in the plane between plans on one grid of times, between their knots too.

Helicopters keep apart in the plane, at whatever heights: the jet of a rotor reaches the floor.
"""

import numpy as np

from controllers.committed_plan import CommittedPlan
from controllers.signals import Array

FINE = 4
"""Chords in each step of the grid."""


def knots_from(plan: CommittedPlan, first: int, count: int) -> Array:
    """Return `count` knots (count, 3, 4) of a plan from the index `first` of the common grid on.

    The grid begins at time 0. Outside its own knots a plan is at rest.
    """
    here = first - plan.start // plan.step + np.arange(count)
    return plan.knots[np.clip(here, 0, len(plan.knots) - 1)]


def fine_path(knots: Array, h: float) -> Array:
    """Return positions (..., FINE (n - 1) + 1, 2) in the plane, `FINE` in each step, of knots (..., n, 3, >= 2)."""
    scaled = knots[..., :2] * np.array([1.0, h, h * h])[:, None]
    ends = np.concatenate([scaled[..., :-1, :, :], scaled[..., 1:, :, :]], axis=-2)
    inside = np.matmul(_BASIS, ends)
    path = inside.reshape(*inside.shape[:-3], FINE * inside.shape[-3], 2)
    return np.concatenate([path, knots[..., -1:, 0, :2]], axis=-2)


def _basis() -> Array:
    """Positions (FINE, 6) in a step per position, velocity and acceleration at its start and at its end."""
    q = np.arange(FINE) / FINE
    c3, c4, c5 = q**3, q**4, q**5
    return np.stack(
        [
            1.0 - 10.0 * c3 + 15.0 * c4 - 6.0 * c5,
            q - 6.0 * c3 + 8.0 * c4 - 3.0 * c5,
            0.5 * q**2 - 1.5 * c3 + 1.5 * c4 - 0.5 * c5,
            10.0 * c3 - 15.0 * c4 + 6.0 * c5,
            -4.0 * c3 + 7.0 * c4 - 3.0 * c5,
            0.5 * c3 - c4 + 0.5 * c5,
        ],
        axis=1,
    )


_BASIS = _basis()


def distances(path: Array, others: Array, bend: float) -> Array:
    """Return a lower bound (j, t - 1) of the distance to each other during each chord, m.

    Args:
        path: (t, 2) own positions at equal times.
        others: (j, t, 2) those of the others.
        bend: Greatest distance of a relative path from its chord, m; see `bend_of`.
    """
    there = others - path
    start, way = there[:, :-1], np.diff(there, axis=1)
    # The nearest point of each chord to the origin.
    length = np.maximum((way * way).sum(axis=2), 1e-30)
    share = np.clip(-(start * way).sum(axis=2) / length, 0.0, 1.0)
    return np.sqrt(((start + share[:, :, None] * way) ** 2).sum(axis=2)) - bend


def bend_of(acceleration: float, h: float) -> float:
    """Return how far the path between two helicopters leaves a chord: a time^2 / 8 for a relative acceleration a.

    Args:
        acceleration: Greatest of each helicopter on each axis, m/s^2.
        h: Step of the grid, s.
    """
    return 2.0 * 2.0**0.5 * acceleration * (h / FINE) ** 2 / 8.0


def reach(since: Array, length: float, acceleration: float) -> Array:
    """Return how far two plans that part can be from each other in the plane (n,), m.

    Both have the same state where they part, keep |acceleration| of each axis, and are at rest at the end.

    Args:
        since: (n,) time since they part, s; before, it is 0.
        length: From where they part to where both are at rest, s.
        acceleration: Limit, m/s^2.
    """
    since = np.clip(since, 0.0, length)
    apart = np.where(since < 0.5 * length, since**2, 0.5 * length**2 - (length - since) ** 2)
    return 2.0**0.5 * acceleration * apart
