"""The fitted parameters: those of the twin that poses and commands can tell, with their priors.

Mass, absolute inertias and the parts of the delay cannot be told: what is fitted are ratios and sums. The prior is the
helicopter that is given, with a spread so wide that it speaks only where the flights do not.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np

from controllers.markers import by_name
from controllers.signals import Array
from heli_twin.experiment import Experiment
from heli_twin.lab.plant.effects.battery import BatterySpec
from heli_twin.lab.plant.effects.ground_effect import GroundEffect
from heli_twin.lab.plant.effects.hub_drag import HubDrag
from heli_twin.lab.plant.effects.servo import Servo
from heli_twin.lab.plant.effects.thrust_yaw_coupling import ThrustYawCoupling
from heli_twin.lab.plant.mujoco import MuJoCo


class Parameter(NamedTuple):
    """One parameter of the fit."""

    name: str
    unit: str
    is_positive: bool
    """Fitted as a logarithm."""
    spread: float
    """Standard deviation of the prior: of the logarithm for a positive one, else in its unit."""
    meaning: str


PARAMETERS = (
    Parameter("thrust_per_mass", "m/s^2", True, 0.4, "thrust at full stick, per mass"),
    Parameter("pitch_gain", "1", True, 0.4, "sine of the pitch angle at full stick"),
    Parameter("roll_gain", "1", True, 0.4, "sine of the roll angle at full stick"),
    Parameter("yaw_gain_per_izz", "rad/s^2", True, 0.5, "yaw acceleration at full stick"),
    Parameter("yaw_damping_per_izz", "1/s", True, 0.5, "yaw damping by the on-board gyro"),
    Parameter("pitch_trim", "full stick", False, 0.1, "pitch input that holds it level"),
    Parameter("roll_trim", "full stick", False, 0.1, "roll input that holds it level"),
    Parameter("yaw_trim", "full stick", False, 0.1, "yaw input that holds the heading"),
    Parameter("drag_x_per_mass", "1/s", True, 0.5, "drag along the nose"),
    Parameter("drag_y_per_mass", "1/s", True, 0.5, "drag to port"),
    Parameter("drag_z_per_mass", "1/s", False, 1.0, "drag upwards"),
    Parameter("attitude_frequency", "rad/s", True, 0.3, "natural frequency of pitch"),
    Parameter("attitude_damping", "1", True, 0.4, "damping ratio of pitch and roll"),
    Parameter("servo_lag", "s", True, 0.4, "time constant of the swashplate servos"),
    Parameter("thrust_lag", "s", True, 0.4, "time constant of the thrust"),
    Parameter("yaw_lag", "s", True, 0.4, "time constant of the yaw torque"),
    Parameter("delay", "s", False, 0.010, "mean of compute time, radio frame and latency, and input"),
    Parameter("iyy_per_ixx", "1", True, 0.3, "inertia about the port axis by that about the nose"),
    Parameter("izz_per_iyy", "1", True, 0.3, "inertia about the mast by that about the port axis"),
    Parameter("hub_drag_per_iyy", "1/m", False, 30.0, "moment of the drag at the hubs: height mass / Iyy"),
    Parameter("thrust_yaw_coupling_per_izz", "rad/m", False, 2.0, "yaw acceleration per vertical acceleration"),
    Parameter("battery_drain", "1/s", False, 0.002, "share of the battery that a second of hover takes"),
    Parameter("battery_droop", "1", False, 0.05, "share of the voltage lost on the way under hover current"),
    Parameter("servo_backlash", "full stick", False, 0.03, "play between servo and swashplate, end to end"),
    Parameter("servo_slowness", "s / full stick", False, 0.3, "time that the servo needs for full stick"),
    Parameter("ground_effect", "1", False, 1.0, "strength of the ground effect, 1: Cheeseman and Bennett's"),
)
"""In the order of the fit's vector."""
NAMES = tuple(p.name for p in PARAMETERS)
INDEX = {name: i for i, name in enumerate(NAMES)}
POSITIVE = np.array([p.is_positive for p in PARAMETERS])
SPREAD = np.array([p.spread for p in PARAMETERS])
ROTOR_RADIUS_M = GroundEffect().radius
"""Of a ground effect of strength 1, which grows with its square."""
LEAST_LAG_S = 1e-3
"""The logarithm of a lag of zero does not exist."""
BATTERY_VOLTAGE_V = 3.95
"""Voltage of the full cell in hover, to which drain and droop are related."""


def values(theta: Array) -> Array:
    """Return parameters (..., n) in their units from the fit's vector: logarithms of the positive ones."""
    return np.where(POSITIVE, np.exp(np.where(POSITIVE, theta, 0.0)), theta)


def vector(values_: Array) -> Array:
    """Return the fit's vector from parameters in their units: the inverse of `values`."""
    return np.where(POSITIVE, np.log(np.where(POSITIVE, values_, 1.0)), values_)


@dataclass(frozen=True)
class Lab:
    """Values known without a fit: of the radio, and of the helicopter's build."""

    frame_period: float
    """Of the radio, s; 0 without frames."""
    levels: int
    """Of the radio between full stick one way and the other; 0 if it does not round."""
    jitter: float = 0.001
    """Greatest difference of the compute time from its mean, s."""
    mast: float = 0.041
    """Middle of the hubs above the centre of gravity, m."""
    iyy_per_mass: float = 3.9e-5 / 0.028
    """m^2; it scales a force of less than a thousandth of the weight."""


def lab_of(experiment: Experiment) -> Lab:
    """Return what an experiment says of the radio and the build."""
    plant = helicopter(experiment)
    frame = float(getattr(experiment.radio, "frame_period", 0.0))
    levels = int(getattr(experiment.radio, "levels", 0))
    jitter = float(getattr(experiment.compute, "spread", 0.0))
    return Lab(frame, levels, jitter, iyy_per_mass=plant.inertia_yy / plant.mass)


def helicopter(experiment: Experiment) -> MuJoCo:
    """Return the MuJoCo plant of an experiment; the default one if it has another kind."""
    return experiment.plant if isinstance(experiment.plant, MuJoCo) else MuJoCo()


Kind = TypeVar("Kind")


def member(effects: Mapping[str, object], kind: type[Kind]) -> Kind:
    """Return the effect of a class; one with its default values if there is none."""
    return next((effect for effect in effects.values() if isinstance(effect, kind)), kind())


def of_experiment(experiment: Experiment) -> dict[str, float]:
    """Return the parameters of an experiment by name: the prior of a fit, and the truth of a test."""
    p = helicopter(experiment)
    effects = by_name(p.effects)
    hub, coupling = member(effects, HubDrag), member(effects, ThrustYawCoupling)
    battery, servo = member(effects, BatterySpec), member(effects, Servo)
    radio, compute = experiment.radio, experiment.compute
    delay = getattr(compute, "latency", 0.0) + 0.5 * getattr(radio, "frame_period", 0.0)
    delay += getattr(radio, "latency", 0.0) + p.delay_steps * p.step
    basic = {
        "thrust_per_mass": p.thrust_gain / p.mass,
        "pitch_gain": p.pitch_gain,
        "roll_gain": p.roll_gain,
        "yaw_gain_per_izz": p.yaw_gain / p.inertia_zz,
        "yaw_damping_per_izz": max(p.yaw_damping / p.inertia_zz, 1e-3),
        "pitch_trim": p.pitch_trim,
        "roll_trim": p.roll_trim,
        "yaw_trim": p.yaw_trim,
        "drag_x_per_mass": max(p.drag_x / p.mass, 1e-3),
        "drag_y_per_mass": max(p.drag_y / p.mass, 1e-3),
        "drag_z_per_mass": p.drag_z / p.mass,
        "attitude_frequency": p.attitude_frequency,
        "attitude_damping": p.attitude_damping,
        "servo_lag": max(p.servo_lag, LEAST_LAG_S),
        "thrust_lag": max(p.thrust_lag, LEAST_LAG_S),
        "yaw_lag": max(p.yaw_lag, LEAST_LAG_S),
        "delay": delay,
        "iyy_per_ixx": p.inertia_yy / p.inertia_xx,
        "izz_per_iyy": p.inertia_zz / p.inertia_yy,
    }
    of_effects = {
        "hub_drag": {
            "hub_drag_per_iyy": (hub.height * p.mass + hub.flapping / max(p.drag_x / p.mass, 1e-3)) / p.inertia_yy
        },
        "thrust_yaw_coupling": {"thrust_yaw_coupling_per_izz": coupling.lever * p.mass / p.inertia_zz},
        "battery": {
            "battery_drain": (battery.idle_current + battery.hover_current) / (3600.0 * battery.capacity),
            "battery_droop": battery.resistance * battery.hover_current / BATTERY_VOLTAGE_V,
        },
        "servo": {"servo_backlash": servo.backlash, "servo_slowness": 1.0 / servo.slew},
        "ground_effect": {"ground_effect": (member(effects, GroundEffect).radius / ROTOR_RADIUS_M) ** 2},
    }
    for kind, its in of_effects.items():
        basic |= its if kind in effects else dict.fromkeys(its, 0.0)
    return basic
