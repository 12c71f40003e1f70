"""Margins of a control law, measured on the twin and on the helicopter that the law believes in."""

from dataclasses import dataclass, fields, replace
from tempfile import TemporaryDirectory
from typing import Any, Literal, get_args

import numpy as np

from controllers.detailed_model import DetailedModel
from controllers.excitations.multisine import Multisine
from controllers.excitations.off import NoExcitation
from controllers.markers import by_name
from controllers.model import GRAVITY, Model
from controllers.signals import Command
from controllers.supervisors.off import NoSupervisor
from controllers.trajectories.hover import Hover
from heli_twin.errors import HeliTwinError
from heli_twin.experiment import Experiment, Volume
from heli_twin.lab.faults import Hooks
from heli_twin.lab.mocap import Vicon
from heli_twin.lab.plant import PlantSpec
from heli_twin.lab.plant.effects.hub_drag import HubDrag
from heli_twin.lab.plant.ideal import Ideal
from heli_twin.lab.plant.mujoco import MuJoCo
from heli_twin.lab.radio import Dsm2
from heli_twin.metrics.margins import Margins, loop_responses, margins
from heli_twin.mission import fly
from heli_twin.recording import read_log

PROBE = Multisine(pitch=0.02, roll=0.02, thrust=0.01, yaw=0.02, slowest=0.1, fastest=8.0, record=40.0)
"""So small that no input saturates, above the radio's quantum; 40 s tell 0.1 Hz apart."""
SETTLED_S = 10.0
NOT_LINEAR = ("battery", "ground_effect", "servo", "spool_up")
"""Plant effects that are left out: a margin is that of a linear loop, and what these do depends on size or time."""

Helicopter = Literal["twin", "believed"]
HELICOPTERS: tuple[Helicopter, ...] = get_args(Helicopter)


@dataclass(frozen=True)
class Probe:
    """A multisine that is added to the commands on their way, unknown to the ground station."""

    multisine: Multisine = PROBE
    kind: Literal["probe"] = "probe"

    def hooks(self, rng: np.random.Generator) -> Hooks:
        """Return the hook on the wire to the radio."""

        def command(at: int, command: Command) -> list[tuple[int, Command]]:
            probed = command.u + self.multisine.inputs(np.array([1e-9 * command.stamp]))[0]
            return [(at, command._replace(u=probed))]

        return Hooks(command=command)


def law_margins(experiment: Experiment, helicopter: Helicopter = "twin") -> dict[str, Margins]:
    """Fly the probe in hover and return the margins of each loop x, y, z, yaw.

    The air is still and the cameras are without noise; latencies, jitter and the radio's frames are as in the
    experiment.

    Args:
        experiment: The law with its estimator, and the lab.
        helicopter: The plant of the experiment without what is not linear (see `NOT_LINEAR`), or the one that the law
            believes in.

    Raises:
        HeliTwinError: The loop is unstable, or no multisine can be flown in it.
    """
    e = quiet(experiment, helicopter)
    with TemporaryDirectory() as folder:
        result = fly(e, log_dir=folder)
        if result.outcome.kind != "completed" or result.path is None:
            raise HeliTwinError(
                f"the loop has no margins on the {helicopter} helicopter: hovering in still air, it"
                f" {result.outcome.kind} ({result.outcome.text})"
            )
        return {axis: margins(loop) for axis, loop in loop_responses(read_log(result.path), PROBE, SETTLED_S).items()}


def quiet(experiment: Experiment, helicopter: Helicopter) -> Experiment:
    """Return the flight in which margins are measured: a probed hover in still air."""
    mocap, radio = experiment.mocap, experiment.radio
    if isinstance(mocap, Vicon):
        mocap = replace(mocap, position_noise=0.0, bias=0.0, orientation_noise=0.0, dropout=0.0)
    if isinstance(radio, Dsm2):
        radio = replace(radio, loss=0.0)
    return replace(
        experiment,
        duration=SETTLED_S + PROBE.record + 1.0,
        trajectory=Hover(),
        plant=believed(experiment.controller.model) if helicopter == "believed" else linear(experiment.plant),
        supervisor=NoSupervisor(),
        excitation=NoExcitation(),
        mocap=mocap,
        radio=radio,
        disturbances=(),
        faults=(Probe(),),
        volume=Volume(half_width=100.0, height=100.0),
    )


def linear(plant: PlantSpec) -> PlantSpec:
    """Return a plant without the effects that are not linear."""
    if not isinstance(plant, MuJoCo):
        return plant
    return replace(plant, effects=tuple(e for e in by_name(plant.effects).values() if e.kind not in NOT_LINEAR))


def believed(model: Model) -> PlantSpec:
    """Return the helicopter that a law believes in as a plant: the paper's model, or the twin with the detailed one."""
    if not isinstance(model, DetailedModel):
        return Ideal(model=Model(**{f.name: getattr(model, f.name) for f in fields(Model)}))
    twin, m = MuJoCo(), MuJoCo().mass
    iyy, w = twin.inertia_yy, model.pitch_frequency
    ratio = (model.roll_frequency / w) ** 2
    hub: tuple[Any, ...] = ()
    if model.hub_drag:
        hub = (HubDrag(height=model.hub_drag * iyy * w * w / (m * GRAVITY)),)
    return replace(
        twin,
        inertia_xx=iyy / ratio,
        thrust_gain=m * model.b_z,
        pitch_gain=model.b_x / GRAVITY,
        roll_gain=model.b_y / GRAVITY,
        yaw_gain=twin.inertia_zz * model.b_yaw,
        yaw_damping=-twin.inertia_zz * model.k_yaw,
        drag_x=-m * model.k_x,
        drag_y=-m * model.k_y,
        attitude_frequency=w,
        attitude_damping=model.attitude_damping,
        servo_lag=model.servo_lag,
        thrust_lag=model.thrust_lag,
        yaw_lag=model.yaw_lag,
        effects=hub,
    )
