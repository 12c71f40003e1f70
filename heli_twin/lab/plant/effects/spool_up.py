"""On the floor the rotors stand still until the first command."""

from dataclasses import dataclass
from typing import Annotated, Any, Literal

from annotated_types import Ge, Le, Unit, doc

from heli_twin.lab.plant.effects import Physics, Updates


@dataclass(frozen=True, slots=True)
class SpoolUp:
    """A flight that begins on the floor begins with stopped rotors; they spool up with the thrust lag.

        s' = (u - s) / thrust_lag,   s(0) = 0

    Without this effect a flight begins in the trim of hovering, on the floor too.

    Source: the lag is the plant's (rotor speed of the CoaX, scaled by Froude number); that it holds from rest on is an
    engineering estimate.
    """

    kind: Literal["spool_up"] = "spool_up"
    height: Annotated[float, Ge(0), Le(1), Unit("m"), doc("centre of gravity below which it stands")] = 0.05

    def build(self, model: Any) -> None:
        """Let parts within a millimetre of the floor count as touching it: nothing presses at height 0.045000001 m.

        The gap makes contacts known to the engine; no force acts in them.
        """
        for geom in model.worldbody.geoms:
            geom.gap = 0.001

    def start(self, physics: Physics) -> Updates:
        """Stop the rotors of a helicopter that stands."""
        if physics.position[2] < self.height:
            physics.stands = True
        return Updates()
