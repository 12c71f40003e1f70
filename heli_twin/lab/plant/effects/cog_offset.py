"""The centre of gravity lies beside the mast: another trim, and turning shakes the helicopter."""

from dataclasses import dataclass
from typing import Annotated, Any, Literal

from annotated_types import Ge, Le, Unit, doc

from heli_twin.lab.plant.effects import Physics, Updates


@dataclass(frozen=True, slots=True)
class CogOffset:
    """The centre of gravity is at (x, y) from the mast; the weight then tilts the helicopter unless the sticks hold it.

        M_pitch = m g x,   M_roll = -m g y

    Attitude hinges, drag and the recorded position stay at the foot of the mast.

    Source: trims of up to 0.1 of full stick in the counts of the Harvard mCX testbed; 1 mm is worth 0.18.
    """

    kind: Literal["cog_offset"] = "cog_offset"
    x: Annotated[float, Ge(-0.01), Le(0.01), Unit("m"), doc("to the nose")] = 0.0005
    y: Annotated[float, Ge(-0.01), Le(0.01), Unit("m"), doc("to port")] = 0.0

    def build(self, model: Any) -> None:
        """Move the mass."""
        model.body("fuselage").ipos = (self.x, self.y, 0.0)

    def start(self, physics: Physics) -> Updates:
        """Trim the sticks against the weight."""
        model = physics.model
        weight = -model.body("fuselage").mass[0] * model.opt.gravity[2]
        physics.trim[0] -= weight * self.x / model.actuator("u_x").gainprm[0]
        physics.trim[1] -= weight * self.y / model.actuator("u_y").gainprm[0]
        return Updates()
