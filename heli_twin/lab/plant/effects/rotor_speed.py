"""Rotors that neither stop in the air nor turn as fast as full stick asks."""

from dataclasses import dataclass
from typing import Annotated, Any, Literal

from annotated_types import Ge, Le, Unit, doc

from heli_twin.lab.plant.effects import Physics, Updates


@dataclass(frozen=True, slots=True)
class RotorSpeed:
    """Limits of the rotor speed, as thrust: the speed controllers clip the throttle to [least, most].

    Source: engineering estimates: the speed controllers stop the motors below 5 % of the throttle, and a motor at
    full throttle is limited by its back voltage.
    """

    kind: Literal["rotor_speed"] = "rotor_speed"
    least: Annotated[float, Ge(0), Le(0.5), Unit("full stick"), doc("throttle below which the motors stay here")] = 0.0
    most: Annotated[float, Ge(0.5), Le(1), Unit("full stick"), doc("throttle that the motors reach at most")] = 0.9

    def build(self, model: Any) -> None:
        """Limit the throttle."""
        model.actuator("u_z").ctrlrange = (self.least, self.most)

    def start(self, physics: Physics) -> Updates:
        """Return nothing to update: the engine clips the throttle."""
        return Updates()
