"""Rules of coordinations: plans that join, are whole, and are the same again; turns that come."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from controllers.coordinations import OUTCOMES, Planner, Ship
from controllers.model import Model
from controllers.signals import Array
from controllers.trajectories import Trajectory, fitted
from controllers.trajectories.hover import Hover
from controllers.trajectories.waypoints import Waypoints
from heli_twin.conformance.rules import require, same

_END_NS = 4_000_000_000


def _ships() -> list[Ship]:
    """Two that pass each other, and one that hovers aside."""
    model = Model()
    points = ((-0.8, 0.0, 1.0, 0.0), (0.8, 0.1, 1.0, 0.0))
    wishes = {"a": Waypoints(points=points), "b": Waypoints(points=points[::-1]), "c": Hover(y=1.5)}
    return [Ship(name, fitted(wish, model), model) for name, wish in wishes.items()]


def _turns(spec: Any) -> Iterator[tuple[int, Planner, Trajectory]]:
    """Time, planner and plan before it of each turn; messages arrive at once."""
    ships = _ships()
    planners = {ship.name: spec.planner_of(ship.name, ships) for ship in ships}
    while True:
        name = min(planners, key=lambda each: planners[each].due)
        planner, now = planners[name], planners[name].due
        if now > _END_NS:
            return
        before = planner.committed
        messages = planner.act(now, None, True)
        require(planner.due > now, f"its next turn is at {planner.due} ns, not after this one at {now} ns")
        for message in messages:
            require(message.sender == name, f"a message of {name} says that it is of {message.sender!r}")
            require(message.stamp == now, f"a message sent at {now} ns says {message.stamp} ns")
            for other in planners.keys() - {name}:
                planners[other].receive(now, message)
        yield now, planner, before


def begins_with_the_wish(spec: Any) -> None:
    """Before take-off it has committed a plan that starts where the wish starts."""
    ships = _ships()
    for ship in ships:
        planned, wanted = (
            each.flat(np.zeros(1)).z for each in (spec.planner_of(ship.name, ships).committed, ship.wish)
        )
        require(bool(np.allclose(planned, wanted, atol=1e-6)), f"{ship.name} starts at {planned[0]}, not {wanted[0]}")


def plans_join(spec: Any) -> None:
    """A plan is finite, and goes on where the one before it would have been, as fast and with its acceleration."""
    for now, planner, before in _turns(spec):
        require(planner.note.outcome in OUTCOMES, f"the outcome is {planner.note.outcome!r}")
        old, new = (each.flat(np.array([1e-9 * now])) for each in (before, planner.committed))
        for a, b in zip(old, new, strict=True):
            require(bool(np.allclose(a, b, atol=1e-6)), f"at {1e-9 * now:.3f} s the plan jumps from {a[0]} to {b[0]}")
        later = np.concatenate(planner.committed.flat(1e-9 * (now + np.arange(0, 3e9, 5e7))))
        require(bool(np.isfinite(later).all()), f"the plan of {1e-9 * now:.3f} s is not finite")


def plans_the_same_again(spec: Any) -> None:
    """Two flights of one value have the same plans, and do not share a state."""
    require(same([*_plans(spec)], [*_plans(spec)]), "the same meeting got other plans")


def _plans(spec: Any) -> Iterator[Array]:
    for now, planner, _ in _turns(spec):
        yield np.concatenate([[now], planner.committed.flat(1e-9 * (now + np.arange(0, 1e9, 1e8))).z.ravel()])
