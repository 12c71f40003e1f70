"""One helicopter that cannot go on: how it stops on its plan, and how far others then keep away.

One that its cameras have lost flies on by what it believes of itself, and gusts that nobody sees push it away: in the
age t of its newest picture by up to a t^2 / 2, where the acceleration a is that of the strongest gust. To within that
it still flies its plan, as long as the plan is gentle: what a hard stop does, no model tells to a decimetre.
"""

import numpy as np

from controllers.committed_plan import CommittedPlan
from controllers.right_of_way import Told
from controllers.rotations import rotate_to_world
from controllers.signals import Array, Estimate

UNSEEN_NS = 100_000_000
"""Age of the newest picture from which on its cameras have lost a helicopter: ten frames of them."""
STRAYED_M = 0.15
"""Who is further from its plan no longer flies it."""
STOPS = "stops"
"""Reason in the note of a turn of one that cannot go on."""


def lost_since(now: int, estimate: Estimate | None) -> float:
    """Return the time of the newest picture, s, if the cameras have lost the helicopter; infinite if they see it.

    Args:
        now: ns.
        estimate: None before the first pose.
    """
    newest = 0 if estimate is None else estimate.pose_stamp
    return 1e-9 * newest if now - newest > UNSEEN_NS else np.inf


def strayed(plan: CommittedPlan, estimate: Estimate | None) -> Array | None:
    """Return position, velocity in the world and no acceleration (3, 4) of one that is not on its plan; None else."""
    if estimate is None:
        return None
    planned = plan.flat(np.array([1e-9 * estimate.stamp])).z[0, :2]
    if np.hypot(*(estimate.x[:2] - planned)) <= STRAYED_M:
        return None
    state = np.stack([estimate.x[:4], estimate.x[4:8], np.zeros(4)])
    state[1, :2] = rotate_to_world(estimate.x[4:6], estimate.x[3])
    return state


def berth_of(told: Told, t: Array, berth: float, drift: float) -> Array:
    """Return how much further others keep away from one at the times t (n,), s, than from one that flies on, m.

    Args:
        told: What it has told.
        t: s.
        berth: From one that lands, and at most, m.
        drift: Greatest acceleration of a gust, m/s^2.
    """
    if told.is_down:
        return np.full(len(t), berth)
    return np.minimum(berth, 0.5 * drift * np.maximum(t - told.lost, 0.0) ** 2)
