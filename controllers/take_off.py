"""Plans that all have committed before take-off, and that all know: clear of each other, or there is no flight."""

from collections.abc import Mapping

import numpy as np

from controllers.committed_plan import CommittedPlan
from controllers.separation import distances, fine_path
from controllers.wish_plan import WishPlan


def before_take_off(
    wishes: Mapping[str, WishPlan], step: int, distance: float, bend: float
) -> dict[str, CommittedPlan]:
    """Return the plans at time 0: the wish and a stop, or to stay where wishes are too near.

    Args:
        wishes: Of each, by name.
        step: Of the grid, ns.
        distance: To keep, m.
        bend: Greatest distance of a relative path from its chord, m; see `controllers.separation.bend_of`.

    Raises:
        ValueError: Some start too near to each other.
    """
    plans = {name: CommittedPlan(0, step, own.wished(0, own.longest + 2)) for name, own in wishes.items()}
    waits = True
    while waits and (pairs := _too_near(plans, distance, bend)):
        waits = False
        for name in {each for pair in pairs for each in pair}:
            knots = plans[name].knots
            if not knots[0, 1:].any() and not np.array_equal(knots[0], knots[-1]):
                plans[name], waits = plans[name]._replace(knots=np.repeat(knots[:1], len(knots), axis=0)), True
    for one, other in _too_near(plans, distance, bend):
        apart = float(np.hypot(*(plans[one].knots[0, 0, :2] - plans[other].knots[0, 0, :2])))
        raise ValueError(
            f"{one} and {other} start {apart:.2f} m apart, and fly nearer than distance = {distance:g} m"
            ": start them further apart or at rest, or promise less"
        )
    return plans


def _too_near(plans: Mapping[str, CommittedPlan], distance: float, bend: float) -> list[tuple[str, str]]:
    names = [*plans]
    paths = np.stack([fine_path(plan.knots, 1e-9 * plan.step) for plan in plans.values()])
    pairs: list[tuple[str, str]] = []
    for i, one in enumerate(names):
        near = distances(paths[i], paths[i + 1 :], bend).min(axis=1) < distance
        pairs += [(one, names[i + 1 + j]) for j in np.flatnonzero(near)]
    return pairs
