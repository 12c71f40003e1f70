"""The stabiliser bar holds the rotor's plane in space, and slowly follows the fuselage."""

from dataclasses import dataclass
from typing import Annotated, Any, Literal

from annotated_types import Ge, Gt, Le, Unit, doc

from heli_twin.lab.plant.effects import Physics, Updates


@dataclass(frozen=True, slots=True)
class StabiliserBar:
    """A share of the attitude stiffness pulls towards the bar's plane instead of the level.

        moment = -share K (t - b),   following_time b' = t - b

    t is the tilt of the fuselage, b that of the bar, K the attitude stiffness; the rest of K stays level. A held stick
    then tilts on beyond the steady tilt of (1), which is a slow mode: with 1 nothing levels the helicopter but drag at
    its hubs. The bar cannot fit both the paper's gains and its steady tilt: a mismatch case, not a part of `lab`.

    Source: following time: 1.6 to 1.79 s identified on the CoaX helicopter (Fassler), scaled by Froude number.
    """

    kind: Literal["stabiliser_bar"] = "stabiliser_bar"
    share: Annotated[float, Gt(0), Le(1), Unit("1"), doc("of the attitude stiffness that the bar makes")] = 0.3
    following_time: Annotated[float, Ge(0.05), Le(20), Unit("s"), doc("in which it follows the fuselage")] = 1.25

    def build(self, model: Any) -> None:
        """Add a bar with two hinges, and a spring between each and that of the fuselage."""
        mast, up, down = model.site("mast"), model.actuator("stiffness_up"), model.actuator("stiffness_down")
        stiffness = self.share * up.biasprm[0] * mast.pos[2]
        up.biasprm[0] *= 1.0 - self.share
        down.biasprm[0] *= 1.0 - self.share
        # So light that only spring and damper move it; stacked hinges need a body each.
        tiny = 1e-9
        parent = model.body("yaw_frame")
        for name in ("pitch", "roll"):
            parent = parent.add_body(name=f"bar_{name}", mass=tiny, inertia=[tiny] * 3, gravcomp=1.0)
            hinge = model.joint(name)
            parent.add_joint(
                name=f"bar_{name}", type=hinge.type, axis=hinge.axis, damping=[stiffness * self.following_time, 0, 0]
            )
            spring = model.add_tendon(name=f"bar_{name}", stiffness=[stiffness, 0, 0])
            spring.wrap_joint(name, 1.0)
            spring.wrap_joint(f"bar_{name}", -1.0)

    def start(self, physics: Physics) -> Updates:
        """Return nothing to update: the engine computes it."""
        return Updates()
