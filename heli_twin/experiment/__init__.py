"""The experiment: an immutable value with everything that determines a flight, and nothing else.

The helicopter is described twice: `plant` is the real one, `controller.model` is what the ground station believes. A
model mismatch is a difference between the two. The defaults are the lab with everything realistic:
its helicopter is `LAB_PLANT`, while the class of the plant has the defaults of one without plant effects; what its
supervisor believes is `LAB_SUPERVISOR`.
"""

from dataclasses import dataclass, field
from typing import Annotated

from annotated_types import Ge, Gt, Le, MaxLen, Unit, doc

from controllers.estimators import EstimatorSpec
from controllers.estimators.kalman import Kalman
from controllers.excitations import ExcitationSpec
from controllers.excitations.off import NoExcitation
from controllers.laws import ControlLaw
from controllers.markers import EachOf, Named, OneOf
from controllers.supervisors import SupervisorSpec
from controllers.supervisors.safety import Safety
from controllers.trajectories import Trajectory
from controllers.trajectories.circle import Circle
from heli_twin.experiment.help_text import explained
from heli_twin.lab.compute import ComputeSpec, Modelled
from heli_twin.lab.disturbances import DisturbanceSpec
from heli_twin.lab.disturbances.bias import Bias
from heli_twin.lab.disturbances.gust import Gust
from heli_twin.lab.faults import Fault
from heli_twin.lab.mocap import MocapSpec, Vicon
from heli_twin.lab.plant import PlantSpec
from heli_twin.lab.plant.effects.battery import BatterySpec
from heli_twin.lab.plant.effects.ground_effect import GroundEffect
from heli_twin.lab.plant.effects.hub_drag import HubDrag
from heli_twin.lab.plant.effects.servo import Servo
from heli_twin.lab.plant.effects.spool_up import SpoolUp
from heli_twin.lab.plant.effects.thrust_yaw_coupling import ThrustYawCoupling
from heli_twin.lab.plant.mujoco import MuJoCo
from heli_twin.lab.radio import Dsm2, RadioSpec
from heli_twin.whole_file import uninterrupted

# Ctrl-C in the middle of its import would make ProxSuite's C++ abort the process.
with uninterrupted():
    from controllers.laws.ltv_mpc import LtvMpc


LAB_PLANT = MuJoCo(
    # Heave damping of 1.5 1/s.
    drag_z=0.042,
    effects=(BatterySpec(), GroundEffect(), HubDrag(), Servo(), SpoolUp(), ThrustYawCoupling()),
)
"""The helicopter in the lab."""
LAB_SUPERVISOR = Safety(heave_damping=1.5)
"""The supervisor in the lab: it believes the heave damping of `LAB_PLANT`."""


@explained
@dataclass(frozen=True, slots=True)
class Volume:
    """The space that the cameras see; a flight that leaves it is over."""

    half_width: Annotated[float, Gt(0), Unit("m"), doc("greatest distance from the middle, north and west")] = 2.5
    height: Annotated[float, Gt(0), Unit("m"), doc("ceiling")] = 2.5


@explained
@dataclass(frozen=True, slots=True)
class Experiment:
    """One flight. Same experiment, same flight: every recorded message but the measured times, byte for byte."""

    seed: Annotated[int, Ge(0), Le(2**53), doc("of every random number in the flight")] = 0
    duration: Annotated[float, Gt(0), Le(36_000), Unit("s"), doc("how long to fly")] = 30.0
    trajectory: Annotated[Trajectory, OneOf("controllers.trajectories"), doc("the planned flight")] = field(
        default_factory=Circle
    )
    controller: Annotated[ControlLaw, OneOf("controllers.laws"), doc("the control law and what it believes")] = field(
        default_factory=LtvMpc
    )
    estimator: Annotated[EstimatorSpec, OneOf("controllers.estimators"), doc("from poses to states")] = field(
        default_factory=Kalman
    )
    supervisor: Annotated[
        SupervisorSpec, OneOf("controllers.supervisors"), doc("levels off and lands when the flight cannot go on")
    ] = LAB_SUPERVISOR
    excitation: Annotated[
        ExcitationSpec, OneOf("controllers.excitations"), doc("added to the sent commands, for calibration")
    ] = field(default_factory=NoExcitation)
    plant: Annotated[PlantSpec, OneOf("heli_twin.lab.plant"), doc("the helicopter as it is")] = LAB_PLANT
    compute: Annotated[ComputeSpec, OneOf("heli_twin.lab.compute"), doc("time the ground station needs")] = field(
        default_factory=Modelled
    )
    radio: Annotated[RadioSpec, OneOf("heli_twin.lab.radio"), doc("from the ground station to the helicopter")] = field(
        default_factory=Dsm2
    )
    mocap: Annotated[MocapSpec, OneOf("heli_twin.lab.mocap"), doc("from the helicopter to the ground station")] = field(
        default_factory=Vicon
    )
    disturbances: Annotated[
        tuple[DisturbanceSpec | Named[DisturbanceSpec], ...],
        EachOf("heli_twin.lab.disturbances"),
        doc("what the surroundings do; `off` leaves one out, a name of its own and its `kind` add another"),
    ] = (Bias(), Gust())
    faults: Annotated[tuple[Fault | Named[Fault], ...], EachOf("heli_twin.lab.faults"), doc("what breaks")] = ()
    volume: Annotated[Volume, doc("where the flight may go")] = field(default_factory=Volume)
    noise: Annotated[
        tuple[tuple[Annotated[int, Ge(0), Le(2**53)], Annotated[float, Ge(-100), Le(100)]], ...],
        MaxLen(10_000),
        doc(
            "seeds and weights: all noise is their weighted sum, `[[1, 0.6], [2, 0.8]]`; none of it for `[[0, 0]]`;"
            " empty: that of `seed`"
        ),
    ] = ()
