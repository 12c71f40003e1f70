"""One of the two motors loses power."""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Le, Unit, doc

from controllers.signals import Array
from heli_twin.lab.faults import Duration, Hooks, Rate, Spells, Start
from heli_twin.lab.plant import Truth


@dataclass(frozen=True, slots=True)
class MotorLoss:
    """One rotor gives less thrust, and the torque of the other one turns the helicopter.

        thrust input = u_z (1 - loss / 2),   yaw input = u_yaw + loss torque u_z

    Source: at full throttle a rotor gives 0.252 N with a torque of 0.016 m times that (induced velocity 1.6 m/s, figure
    of merit 0.5, 200 rad/s), 1.3 times the yaw drive's 0.003 N m.
    """

    kind: Literal["motor_loss"] = "motor_loss"
    start: Start = 5.0
    duration: Duration = 1.0
    rate: Rate = 0.0
    loss: Annotated[float, Ge(0), Le(1), Unit("1"), doc("share of one rotor's thrust that is lost")] = 0.2
    torque: Annotated[float, Ge(-3), Le(3), Unit("full stick"), doc("torque of one rotor at full throttle")] = 1.3

    def hooks(self, rng: np.random.Generator) -> Hooks:
        """Change throttle and yaw input."""
        spells = Spells(self, rng)

        def act(t: int, u: Array, truth: Truth) -> Array:
            if spells.began(t) is None:
                return u
            ux, uy, uz, uyaw = u.tolist()
            throttle = min(max(uz, 0.0), 1.0)
            return np.array((ux, uy, throttle * (1.0 - 0.5 * self.loss), uyaw + self.loss * self.torque * throttle))

        return Hooks(input=act)
