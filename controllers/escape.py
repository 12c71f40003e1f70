"""Plans of one helicopter that cannot go on, to rest, and of one that another endangers, away from it."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from controllers.plan_qp import Effort, PlanQp
from controllers.scene import NEAR_M, Mask, Scene
from controllers.signals import Array
from controllers.wish_plan import WishPlan

AWAY_M = 0.5
"""Who is in danger flies this far away from it."""


class Haste(NamedTuple):
    """Limits of such plans."""

    speed: float
    """Of all plans, m/s."""
    acceleration: float
    """Of plans without haste, m/s^2."""
    haste: float
    """Multiple of this acceleration that one in danger may need."""
    stop: float
    """Multiple of this acceleration at which one stops that cannot go on."""
    turn: float
    """How far half-spaces are turned, so that all pass right, rad."""


class Escape:
    """Finds these plans; each has knots (L + 2, 3, 4) from g - 1 on and ends at rest.

    Args:
        own: Ways of the helicopter.
        limits: Of the plans.
    """

    def __init__(self, own: WishPlan, limits: Haste) -> None:
        self._own, self._limits = own, limits
        effort = Effort(limits.speed, limits.haste * limits.acceleration, 0.002, 0.0)
        self._plane = PlanQp(own.steps, own.h, 2, effort)

    def to_rest(self, scene: Scene) -> tuple[Array | None, int]:
        """Return a plan to rest that is clear of all others, straight on or round them, and iterations of its QP.

        From whom it is in danger already it stays as far as the old plan does. None if there is no such plan.
        """
        n, m = self._own.steps, self._limits
        allowed = np.where(scene.in_danger, np.minimum(scene.room(scene.old), 0.0), 0.0)
        straight = self._straight(scene, m.stop)
        old, target = scene.old[1 : n + 2], np.tile(straight[-1, 0, :2], (n, 1))
        for near in (None, scene.room(scene.old) < NEAR_M, np.ones(len(scene.names), bool)):
            knots, iterations = straight, 0
            if near is not None:
                sides = scene.half_spaces(near, 0.0, n, m.haste * m.acceleration)
                plane, iterations = self._plane(old[:, :, :2], target, sides), self._plane.iterations
                if plane is None:
                    continue
                steps = np.concatenate([plane, straight[1 : n + 2, :, 2:]], axis=2)
                knots = self._own.whole(scene.old[0], steps)
            if (scene.room(knots) >= allowed).all():
                return knots, iterations
        return None, 0

    def away(self, scene: Scene) -> tuple[Array | None, int]:
        """Return the plan that comes least near to those that endanger it, and iterations of all QPs.

        From all others it keeps its distance. None if nothing is better than the old plan.
        """
        danger = scene.in_danger
        best, most, iterations = None, scene.room(scene.old)[danger].min(), 0
        for knots, more in self._ways(scene, danger):
            iterations += more
            if knots is None:
                continue
            room = scene.room(knots)
            if (room[~danger] >= 0.0).all() and room[danger].min() > most + 1e-3:
                best, most = knots, room[danger].min()
        return best, iterations

    def _ways(self, scene: Scene, danger: Mask) -> Iterator[tuple[Array | None, int]]:
        """Yield a hard stop, and flights straight away round all others, those of danger included or left out."""
        n, m, old = self._own.steps, self._limits, scene.old[1 : self._own.steps + 2]
        yield self._straight(scene, m.haste), 0
        away = scene.here - scene.knots[danger, 1].mean(axis=0)
        target = np.tile(scene.here + AWAY_M * away / max(float(np.hypot(*away)), 1e-6), (n, 1))
        near = scene.room(scene.old) < NEAR_M + AWAY_M
        for each in (near, near & ~danger):
            sides = scene.half_spaces(each, m.turn, n, 0.8 * m.haste * m.acceleration)
            plane = self._plane(old[:, :, :2], target, sides)
            knots = None if plane is None else np.concatenate([plane, old[:, :, 2:]], axis=2)
            yield None if knots is None else self._own.whole(scene.old[0], knots), self._plane.iterations

    def _straight(self, scene: Scene, share: float) -> Array:
        """A stop straight on, at this multiple of the acceleration of plans."""
        return np.concatenate([scene.old[:1], self._own.stop(scene.old[1], share * self._limits.acceleration)[:-1]])
