"""Drag acts at the rotor hubs, above the centre of gravity: a gust tilts the helicopter."""

from dataclasses import dataclass
from typing import Annotated, Any, Literal

from annotated_types import Ge, Le, Unit, doc

from heli_twin.lab.plant.effects import Physics, Updates


@dataclass(frozen=True, slots=True)
class HubDrag:
    """The moment of the rotor's drag and of its flapping blades about the centre of gravity.

        M = (height drag + flapping) v_disc

    `v_disc` is the velocity of the hubs relative to the air in the plane of the rotor disc, and `drag` is `drag_x` or
    `drag_y` of the plant. The blades flap back in it, which tilts the thrust: that is the drag itself, and it acts at
    the hubs. `flapping` adds the moment of blades whose hinges are stiff. In steady flight the moment tilts the
    helicopter against its motion: the speed per stick falls to 1 / (1 + m g height / K), 40 % with the defaults, where
    K is the attitude stiffness.

    Source: Bramwell's Helicopter Dynamics, 2nd ed., chapter 3 (flapping); fuselage drag of 0.0024 N at 1 m/s leaves
    the identified drag of 0.014 N to the rotors; height: midway between hubs at 28 and 54 mm.
    """

    kind: Literal["hub_drag"] = "hub_drag"
    height: Annotated[float, Ge(-0.2), Le(0.2), Unit("m"), doc("of the hubs above the centre of gravity")] = 0.041
    flapping: Annotated[float, Ge(0), Le(0.01), Unit("N s"), doc("moment of stiff blades per speed")] = 0.0

    def build(self, model: Any) -> None:
        """Add a couple of forces at mast and centre of gravity; it is the moment of the drag and no net force."""
        lever = model.site("mast").pos[2]
        for axis in ("x", "y"):
            drag = model.actuator(f"drag_{axis}")
            force = (self.height * -drag.biasprm[2] + self.flapping) / lever
            for site, sign in (("mast", -1.0), ("cog", 1.0)):
                added = model.add_actuator(name=f"hub_drag_{axis}_{site}", target="air", refsite=site)
                added.trntype, added.biastype, added.gear = drag.trntype, drag.biastype, drag.gear
                # With a gain of zero, the compiler would read a positive coefficient as a damping ratio.
                added.gainprm[0] = 1.0
                added.biasprm[2] = sign * force

    def start(self, physics: Physics) -> Updates:
        """Return nothing to update: the engine computes it."""
        return Updates()
