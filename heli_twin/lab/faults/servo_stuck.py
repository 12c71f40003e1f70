"""A servo of the swashplate sticks."""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import doc

from controllers.signals import Array
from heli_twin.lab.faults import Duration, Hooks, Rate, Spells, Start
from heli_twin.lab.plant import Truth

AXES = ("pitch", "roll")
"""Cyclic inputs in the order of the input."""


@dataclass(frozen=True, slots=True)
class ServoStuck:
    """One cyclic servo stays where it was when the fault began."""

    kind: Literal["servo_stuck"] = "servo_stuck"
    start: Start = 5.0
    duration: Duration = 0.5
    rate: Rate = 0.0
    axis: Annotated[Literal["pitch", "roll"], doc("which servo")] = "pitch"

    def hooks(self, rng: np.random.Generator) -> Hooks:
        """Hold the position of the servo instead of its input."""
        spells, axis = Spells(self, rng), AXES.index(self.axis)
        stuck: tuple[int, float] | None = None

        def act(t: int, u: Array, truth: Truth) -> Array:
            nonlocal stuck
            began = spells.began(t)
            if began is None:
                return u
            if stuck is None or stuck[0] != began:
                stuck = began, float(truth.actuators[axis])
            u = u.copy()
            u[axis] = stuck[1]
            return u

        return Hooks(input=act)
