"""Near the floor the rotors carry more, and slow sideways motion less."""

from dataclasses import dataclass
from typing import Annotated, Any, Literal

from annotated_types import Ge, Gt, Le, Unit, doc

from heli_twin.lab.plant.effects import Physics, Updates, number

SIDEWAYS = ("drag_x", "drag_y", "hub_drag_x_mast", "hub_drag_x_cog", "hub_drag_y_mast", "hub_drag_y_cog")
"""Actuators whose drag acts sideways."""


@dataclass(frozen=True, slots=True)
class GroundEffect:
    """Thrust above a floor, at the same power, and the loss of sideways damping that comes with it.

        T / T_far   = 1 / (1 - s),   s = (R / 4 z)^2,   z at least R / 2: at most 4 / 3
        drag / far  = 1 - min(damping_loss s, 1)

    z is the height of the lower hub above the floor.

    Source: Cheeseman and Bennett, The effect of the ground on a helicopter rotor in forward flight, ARC R&M 3021
    (1955), in hover. The loss of damping is an engineering estimate: the induced velocity, on which the blades'
    drag depends, falls by the share s.
    """

    kind: Literal["ground_effect"] = "ground_effect"
    radius: Annotated[float, Gt(0), Le(1), Unit("m"), doc("of the rotors")] = 0.095
    hub: Annotated[float, Ge(0), Le(0.2), Unit("m"), doc("lower hub above the centre of gravity")] = 0.028
    damping_loss: Annotated[float, Ge(0), Le(10), Unit("1"), doc("loss of sideways damping per share of thrust")] = 3.0

    def share(self, height: float) -> float:
        """Return s for a centre of gravity at `height` (m)."""
        return (self.radius / (4.0 * max(height + self.hub, 0.5 * self.radius))) ** 2

    def build(self, model: Any) -> None:
        """Add nothing to the model."""

    def start(self, physics: Physics) -> Updates:
        """Begin with the drag far from the floor."""
        model = physics.model
        ids = [i for name in SIDEWAYS if (i := number(model.actuator, name)) is not None]
        # Views: to look them up takes as long as a physics step.
        drag, position = model.actuator_biasprm[:, 2], physics.position
        far = drag[ids]

        def every_period(physics: Physics) -> None:
            share = self.share(float(position[2]))
            physics.thrust /= 1.0 - share
            drag[ids] = far * (1.0 - min(self.damping_loss * share, 1.0))

        return Updates(every_period=every_period)
