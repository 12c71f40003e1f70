"""The two rotors' torques do not cancel at every throttle: climbing turns the helicopter."""

from dataclasses import dataclass
from typing import Annotated, Any, Literal

from annotated_types import Ge, Le, Unit, doc

from heli_twin.lab.plant.effects import Physics, Updates


@dataclass(frozen=True, slots=True)
class ThrustYawCoupling:
    """A yaw torque in proportion to the change of thrust; at hover thrust the trim balances it.

        N = lever (T - T_hover)

    Source: one rotor's torque is T v_i / (FM omega) = 0.016 m T (induced velocity 1.6 m/s, figure of merit 0.5,
    200 rad/s), and the difference of two rotors some 5 % of it: an engineering estimate.
    """

    kind: Literal["thrust_yaw_coupling"] = "thrust_yaw_coupling"
    lever: Annotated[float, Ge(-0.01), Le(0.01), Unit("m"), doc("torque per thrust, to port")] = 0.0008

    def build(self, model: Any) -> None:
        """Let the thrust turn about the mast, and the yaw drive hold against its value in hover."""
        gear = model.actuator("u_z").gear.copy()
        gear[5] = self.lever
        model.actuator("u_z").gear = gear

    def start(self, physics: Physics) -> Updates:
        """Balance the torque of hovering."""
        model = physics.model
        hover = physics.trim[2] * model.actuator("u_z").gainprm[0]
        model.actuator("u_yaw").biasprm[0] -= self.lever * hover
        return Updates()
