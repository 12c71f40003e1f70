"""The tracker takes another helicopter in the room for this one."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Gt, Le, Unit, doc

from heli_twin.lab.faults import Duration, Hooks, Rate, Spells, Start
from heli_twin.lab.plant import Truth


@dataclass(frozen=True, slots=True)
class IdentitySwap:
    """For a while, the cameras report the pose of the nearest other helicopter under the name of this one.

    It begins when its time has come and another is near enough to be confused. Set for all in a room, two that are near
    are exchanged. Alone in the room, a helicopter is never confused.

    Source: trackers that know a body by its markers alone exchange two with the same ones when they come near, such as
    Crazyflies with a single marker each.
    """

    kind: Literal["identity_swap"] = "identity_swap"
    start: Start = 2.0
    duration: Duration = 0.3
    rate: Rate = 0.0
    near: Annotated[float, Gt(0), Le(100), Unit("m"), doc("distance below which two are confused")] = 0.8

    def hooks(self, rng: np.random.Generator) -> Hooks:
        """Report the nearest other."""
        spells, near = Spells(self, rng), self.near

        def seen(t: int, truth: Truth, others: Sequence[Truth]) -> Truth:
            if spells.began(t) is None or not others:
                return truth
            distances = [float(np.linalg.norm(other.position - truth.position)) for other in others]
            nearest = int(np.argmin(distances))
            return others[nearest] if distances[nearest] < near else truth

        return Hooks(seen=seen)
