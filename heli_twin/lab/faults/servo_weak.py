"""A servo of the swashplate reaches only part of its travel."""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Le, Unit, doc

from controllers.signals import Array
from heli_twin.lab.faults import Duration, Hooks, Rate, Spells, Start
from heli_twin.lab.faults.servo_stuck import AXES
from heli_twin.lab.plant import Truth


@dataclass(frozen=True, slots=True)
class ServoWeak:
    """One cyclic servo moves the swashplate by a share of its input: the rotor's load is too much for it."""

    kind: Literal["servo_weak"] = "servo_weak"
    start: Start = 5.0
    duration: Duration = 10.0
    rate: Rate = 0.0
    axis: Annotated[Literal["pitch", "roll"], doc("which servo")] = "pitch"
    strength: Annotated[float, Ge(0), Le(1), Unit("1"), doc("share of its input that it reaches")] = 0.5

    def hooks(self, rng: np.random.Generator) -> Hooks:
        """Scale the input."""
        spells, axis = Spells(self, rng), AXES.index(self.axis)

        def act(t: int, u: Array, truth: Truth) -> Array:
            if spells.began(t) is None:
                return u
            u = u.copy()
            u[axis] *= self.strength
            return u

        return Hooks(input=act)
