"""The calibrated helicopter as files: TOML for `heli-twin fly`, the posterior, an ensemble as a study.

Truth and belief stay apart: `[plant]` is the helicopter as it is, `[controller.model]` what a controller may believe of
it. Only ratios are told, so that mass and inertia about the port axis are taken as given.
"""

import json
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from controllers.markers import by_name
from controllers.model import GRAVITY
from heli_twin.calibration import noise
from heli_twin.calibration.calibrate import EFFECTS, Calibrated
from heli_twin.calibration.coverage import covered
from heli_twin.calibration.parameters import (
    BATTERY_VOLTAGE_V,
    NAMES,
    ROTOR_RADIUS_M,
    helicopter,
    member,
    values,
)
from heli_twin.experiment import Experiment
from heli_twin.experiment.tree import physics_line, table_of
from heli_twin.lab.plant.effects.battery import BatterySpec
from heli_twin.lab.plant.effects.ground_effect import GroundEffect
from heli_twin.lab.plant.effects.hub_drag import HubDrag
from heli_twin.lab.plant.effects.servo import Servo
from heli_twin.lab.plant.effects.thrust_yaw_coupling import ThrustYawCoupling
from heli_twin.lab.plant.mujoco import MuJoCo

LEAST_SLOWNESS = 1e-3
"""Of a servo whose speed has a limit."""


class Twin(NamedTuple):
    """A helicopter made of parameters, and what of the delay its steps could not hold."""

    plant: MuJoCo
    compute_latency: float
    """s."""
    remainder: float
    """Delay that is left over, s."""


def twin_of(base: Experiment, p: dict[str, float], mass: float, kept: tuple[str, ...]) -> Twin:
    """Return the helicopter with given parameters.

    Args:
        base: Inertia about the port axis, radio and compute time are taken from it.
        p: Parameters by name.
        mass: kg.
        kept: Effects that it has.
    """
    believed = helicopter(base)
    iyy = believed.inertia_yy
    ixx, izz = iyy / p["iyy_per_ixx"], iyy * p["izz_per_iyy"]
    # No rigid body's inertia exceeds the sum of the others.
    izz = min(max(izz, abs(iyy - ixx) * 1.0001), (iyy + ixx) * 0.9999)
    way = getattr(base.compute, "latency", 0.0) + getattr(base.radio, "latency", 0.0)
    way += 0.5 * getattr(base.radio, "frame_period", 0.0)
    steps = max(round((p["delay"] - way) / believed.step), 0)
    compute = float(getattr(base.compute, "latency", 0.0))
    if p["delay"] < way:
        compute = max(compute + p["delay"] - way, 0.0)
    left = p["delay"] - (way - getattr(base.compute, "latency", 0.0) + compute + steps * believed.step)
    plant = replace(
        believed,
        mass=mass,
        inertia_xx=ixx,
        inertia_zz=izz,
        thrust_gain=p["thrust_per_mass"] * mass,
        pitch_gain=p["pitch_gain"],
        roll_gain=p["roll_gain"],
        yaw_gain=p["yaw_gain_per_izz"] * izz,
        yaw_damping=p["yaw_damping_per_izz"] * izz,
        drag_x=p["drag_x_per_mass"] * mass,
        drag_y=p["drag_y_per_mass"] * mass,
        drag_z=max(p["drag_z_per_mass"], 0.0) * mass,
        attitude_frequency=p["attitude_frequency"],
        attitude_damping=max(p["attitude_damping"], 0.1),
        pitch_trim=p["pitch_trim"],
        roll_trim=p["roll_trim"],
        yaw_trim=p["yaw_trim"],
        servo_lag=p["servo_lag"],
        thrust_lag=p["thrust_lag"],
        yaw_lag=p["yaw_lag"],
        input_delay=steps * believed.step,
        effects=_effects(believed, p, mass, izz, kept),
    )
    return Twin(plant, compute, left)


def _effects(believed: MuJoCo, p: dict[str, float], mass: float, izz: float, kept: tuple[str, ...]) -> tuple[Any, ...]:
    """The effects that the flights show, and those that a calibration does not look at."""
    old = by_name(believed.effects)
    effects: list[Any] = [effect for name, effect in old.items() if name not in EFFECTS]
    if "hub_drag" in kept:
        effects.append(HubDrag(height=p["hub_drag_per_iyy"] * believed.inertia_yy / mass))
    if "thrust_yaw_coupling" in kept:
        effects.append(ThrustYawCoupling(lever=p["thrust_yaw_coupling_per_izz"] * izz / mass))
    if "battery" in kept:
        cell = member(old, BatterySpec)
        capacity = (cell.idle_current + cell.hover_current) / (3600.0 * max(p["battery_drain"], 1e-5))
        resistance = max(p["battery_droop"], 0.0) * BATTERY_VOLTAGE_V / max(cell.hover_current, 1e-3)
        effects.append(replace(cell, capacity=min(capacity, 10.0), resistance=min(resistance, 2.0)))
    if "servo" in kept:
        slew = 1.0 / max(p["servo_slowness"], LEAST_SLOWNESS)
        effects.append(Servo(deadband=0.0, slew=slew, backlash=max(p["servo_backlash"], 0.0)))
    if "ground_effect" in kept and p["ground_effect"] > 0.0:
        radius = ROTOR_RADIUS_M * min(float(np.sqrt(p["ground_effect"])), 10.0)
        effects.append(replace(member(old, GroundEffect), radius=radius))
    return tuple(effects)


def point(calibrated: Calibrated) -> dict[str, float]:
    """Return the fitted parameters by name; those of effects that were left out are 0."""
    return dict(zip(NAMES, values(calibrated.fit.state.theta).tolist(), strict=True))


_FIELDS = {
    "thrust_gain": "thrust_per_mass",
    "pitch_gain": "pitch_gain",
    "roll_gain": "roll_gain",
    "yaw_gain": "yaw_gain_per_izz",
    "yaw_damping": "yaw_damping_per_izz",
    "drag_x": "drag_x_per_mass",
    "drag_y": "drag_y_per_mass",
    "drag_z": "drag_z_per_mass",
    "inertia_xx": "iyy_per_ixx",
    "inertia_zz": "izz_per_iyy",
    "input_delay": "delay",
}


def as_toml(calibrated: Calibrated, command: str = "") -> str:
    """Return a file for `heli-twin fly`: the helicopter, what to believe of it, and where that has been seen.

    Args:
        calibrated: The result.
        command: That makes the file again, for a comment.
    """
    p, known = point(calibrated), calibrated.parameters
    twin = twin_of(calibrated.base, p, calibrated.mass, calibrated.kept)
    lines = [
        f"# calibrated from {calibrated.seconds:.0f} s of {len(calibrated.logs)} flights; 95 % intervals behind",
        *([f"# {command}"] if command else []),
        "# mass is as weighed or believed: the flights tell ratios to it, and to the inertia about the port axis",
        f"# of the delay, {1e3 * twin.remainder:+.2f} ms are left over: the helicopter delays by whole steps",
        physics_line(),
        "",
        "[plant]",
    ]
    told = ", ".join(name for name, k in known.items() if not k.told and name in NAMES)
    if told:
        lines.insert(1, f"# not told by these flights, as believed before: {told}")
    table = table_of(twin.plant)
    for name, value in table.items():
        if name == "effects":
            continue
        source = _FIELDS.get(name, name)
        comment = ""
        if source in known:
            k = known[source]
            comment = f"  # {source} {k.low:.5g} to {k.high:.5g} {k.unit}" + ("" if k.told else ", not told")
        lines.append(f"{name} = {json.dumps(value)}{comment}")
    lines += ["", "[plant.effects]"]
    lines += [f'{name} = "off"' for name in (*EFFECTS, "spool_up") if name not in table["effects"]]
    for name, effect in table["effects"].items():
        lines += ["", f"[plant.effects.{name}]", *(f"{key} = {json.dumps(v)}" for key, v in effect.items())]
    lines += ["", "[controller.model]"]
    for name, (value, source) in believed_model(p).items():
        k = known[source]
        lines.append(f"{name} = {value:.6g}  # {source} {k.low:.5g} to {k.high:.5g} {k.unit}")
    noises: dict[str, float] = dict(zip(noise.COMPONENTS, np.exp(calibrated.fit.state.eta).tolist(), strict=True))
    lines.append("# what a detailed law may believe too; other laws leave it out")
    lines += [f"{name} = {value:.6g}" for name, value in _details(p, noises).items()]
    lines += ["", "[estimator]", f"command_delay = {max(p['delay'], 0.0):.6g}"]
    if hasattr(calibrated.base.compute, "latency"):
        lines += ["", "[compute]", f"latency = {twin.compute_latency:.6g}"]
    gust, time = known["gust_strength"], known["gust_time"]
    lines += ["", "[disturbances.gust]"]
    lines.append(f"strength = {gust.value:.5g}  # {gust.low:.5g} to {gust.high:.5g} m/s")
    lines.append(f"time = {time.value:.5g}  # {time.low:.5g} to {time.high:.5g} s")
    lines += ["", "[envelope]  # what the flights covered; beyond it the twin is a guess"]
    units = {"speed": "m/s", "climb": "m/s", "yaw_rate": "rad/s", "tilt": "rad", "height": "m", "duration": "s"}
    for name, value in covered(calibrated.fit.problem.flights).plain().items():
        lines.append(f"{name} = {json.dumps(value)}  # {units.get(name, 'full stick')}")
    lines += ["", "[noise]  # what the twin cannot predict, standard deviations: `heli-twin validate` expects it"]
    lines += [f"{name} = {value:.4g}" for name, value in noises.items()]
    return "\n".join(lines) + "\n"


def believed_model(p: dict[str, float]) -> dict[str, tuple[float, str]]:
    """The paper's parameters (27), and where each comes from."""
    return {
        "b_x": (GRAVITY * p["pitch_gain"], "pitch_gain"),
        "k_x": (-p["drag_x_per_mass"], "drag_x_per_mass"),
        "b_y": (GRAVITY * p["roll_gain"], "roll_gain"),
        "k_y": (-p["drag_y_per_mass"], "drag_y_per_mass"),
        "b_z": (p["thrust_per_mass"], "thrust_per_mass"),
        "b_yaw": (p["yaw_gain_per_izz"], "yaw_gain_per_izz"),
        "k_yaw": (-p["yaw_damping_per_izz"], "yaw_damping_per_izz"),
    }


def _details(p: dict[str, float], noises: dict[str, float]) -> dict[str, float]:
    """The fields of `controllers.detailed_model.DetailedModel` beyond the paper's."""
    frequency = p["attitude_frequency"]
    return {
        "pitch_frequency": frequency,
        "roll_frequency": frequency * float(np.sqrt(p["iyy_per_ixx"])),
        "attitude_damping": max(p["attitude_damping"], 0.01),
        "servo_lag": p["servo_lag"],
        "thrust_lag": p["thrust_lag"],
        "yaw_lag": p["yaw_lag"],
        # By tilting: the moment of the drag at the hubs against the moment that holds the attitude.
        "hub_drag": max(GRAVITY * p["hub_drag_per_iyy"] / frequency**2, 0.0),
        "servo_play": min(max(p["servo_backlash"], 0.0), 0.5),
        "servo_slew": min(1.0 / max(p["servo_slowness"], LEAST_SLOWNESS), 1e4),
        "gust_strength": noises["gust_strength"],
        "gust_time": noises["gust_time"],
    }
