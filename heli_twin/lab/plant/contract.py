"""The contract that a user's MJCF keeps so that it flies here, and what of it is missing.

World: x north, y west, z up; m, kg, s. The body `fuselage` is the helicopter, and what the cameras see: its origin at
the centre of gravity, x to the nose, y to port, z up.

1. `fuselage` hangs on a free joint, or on slides x, y, z and hinges yaw, pitch, roll as in `models/mcx2.xml`; these
   come first in the model.
2. The first four actuators are the sticks u_x, u_y, u_z, u_yaw: of any type, with or without a lag (`dyntype` none,
   filter or filterexact), `ctrlrange` -1 1, and 0 1 for u_z. Positive is forwards, to port, up, and nose to port.
   A stick asks for a tilt: what stabilises the attitude is a part of the model.
3. The key frame `hover` has the `ctrl` with which it stays where it is in still air.

Optional: the actuator `gyro`, whose `biasprm` damps the yaw of a free body (the fault gyro_failure switches it off);
the geom `floor`, else one is added; wind acts by the engine's medium (`option viscosity`, `density`), or through the
body `air` of `models/mcx2.xml`. Effects act on `fuselage`, and need the sites and actuators that they name.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from controllers.signals import Array
from heli_twin.lab.plant.motion import FreeJoint, Gimbal, Motion, Moving
from heli_twin.terminal_text import clean

STICKS = ("u_x", "u_y", "u_z", "u_yaw")
GIMBAL = {
    "x": (1.0, 0.0, 0.0),
    "y": (0.0, 1.0, 0.0),
    "z": (0.0, 0.0, 1.0),
    "yaw": (0.0, 0.0, 1.0),
    "pitch": (0.0, 1.0, 0.0),
    "roll": (1.0, 0.0, 0.0),
}
"""Joints of a gimbal in their order, and their axes."""
MAX_BODIES, MAX_GEOMS, MAX_DEGREES = 100, 500, 100
TRIAL_S = 0.5
"""Duration of a trial flight."""
TRIAL_STICK = 0.1
FAR_M = 1000.0
"""Height beyond which a trial diverges."""
HOVER_M_S, HOVER_RAD_S = 0.1, 0.3
"""Greatest speeds after a trial in hover: a thrust that is off by 2 %."""


def violations(mujoco: Any, model: Any) -> Iterator[str]:
    """Yield what a compiled model lacks, each a clause of a sentence.

    Args:
        mujoco: The engine.
        model: As `heli_twin.lab.plant.airframe` compiles it.
    """
    for what, count, most in (
        ("bodies", model.nbody, MAX_BODIES),
        ("geoms", model.ngeom, MAX_GEOMS),
        ("degrees of freedom", model.nv, MAX_DEGREES),
    ):
        if count > most:
            yield f"it has {count} {what}, at most {most} are allowed"
            return
    missing = [*_lacks(mujoco, model)]
    yield from missing
    if not missing:
        yield from _flies_wrong(mujoco, model)


def hover_trim(model: Any) -> Array:
    """Return the sticks (4,) of the key frame `hover`."""
    return model.key("hover").ctrl[:4].copy()


def motion_of(model: Any, data: Any) -> Motion:
    """Return how the body of a model that keeps the contract hangs in the world."""
    if model.nq >= 7 and model.jnt_type[0] == 0:
        return FreeJoint(model, data, _number(model, "gyro"))
    return Gimbal(model, data)


def _number(model: Any, actuator: str) -> int | None:
    return next((i for i in range(model.nu) if model.actuator(i).name == actuator), None)


def _lacks(mujoco: Any, model: Any) -> Iterator[str]:
    bodies = [model.body(i).name for i in range(model.nbody)]
    if "fuselage" not in bodies:
        yield f"the body fuselage is missing{_there_are(bodies[1:])}"
    elif not _hangs_right(mujoco, model, bodies.index("fuselage")):
        yield (
            "fuselage has no free joint, nor the joints x, y, z, yaw, pitch, roll of models/mcx2.xml, as the first of"
            " the model"
        )
    names = [model.actuator(i).name for i in range(model.nu)]
    absent = [stick for stick in STICKS if stick not in names]
    if absent:
        yield f"the actuator {', '.join(absent)} is missing{_there_are(names)}"
    elif tuple(names[:4]) != STICKS:
        yield f"the first four actuators are {', '.join(names[:4])}, not {', '.join(STICKS)}"
    else:
        yield from _wrong_sticks(mujoco, model)
    keys = [model.key(i).name for i in range(model.nkey)]
    if "hover" not in keys:
        yield f"the key frame hover is missing{_there_are(keys)}"


def _hangs_right(mujoco: Any, model: Any, fuselage: int) -> bool:
    if not model.njnt:
        return False
    if model.jnt_type[0] == int(mujoco.mjtJoint.mjJNT_FREE):
        return bool(model.jnt_bodyid[0] == fuselage)
    joints = [model.joint(i) for i in range(min(model.njnt, 6))]
    if [joint.name for joint in joints] != [*GIMBAL]:
        return False
    kinds = [mujoco.mjtJoint.mjJNT_SLIDE] * 3 + [mujoco.mjtJoint.mjJNT_HINGE] * 3
    right_kind = all(int(joint.type[0]) == int(kind) for joint, kind in zip(joints, kinds, strict=True))
    right_axis = all(np.allclose(joint.axis, axis) for joint, axis in zip(joints, GIMBAL.values(), strict=True))
    return right_kind and right_axis and bool(model.jnt_bodyid[5] == fuselage)


def _wrong_sticks(mujoco: Any, model: Any) -> Iterator[str]:
    lags = (int(mujoco.mjtDyn.mjDYN_FILTER), int(mujoco.mjtDyn.mjDYN_FILTEREXACT))
    for i, name in enumerate(STICKS):
        low = 0.0 if name == "u_z" else -1.0
        if not model.actuator_ctrllimited[i] or not np.array_equal(model.actuator_ctrlrange[i], (low, 1.0)):
            yield f"the ctrlrange of {name} is not {low:g} 1"
        if int(model.actuator_dyntype[i]) not in lags:
            yield f"the dyntype of {name} is none of none, filter, filterexact"


def _flies_wrong(mujoco: Any, model: Any) -> Iterator[str]:
    """Fly short trials: in hover it stays, and each stick moves it to the right side."""
    hover = hover_trim(model)
    low, high = model.actuator_ctrlrange[:4].T
    if ((hover < low) | (hover > high)).any():
        yield f"the ctrl of the key frame hover, {_told(hover)}, is beyond the ctrlrange"
        return
    still = _trial(mujoco, model, hover)
    speed, turn = float(np.linalg.norm(still.velocity)), float(np.linalg.norm(still.angular_velocity))
    # A model that diverges may fly: that is the outcome of its flight.
    if not np.isfinite([speed, turn]).all():
        return
    if speed > HOVER_M_S or turn > HOVER_RAD_S:
        yield (
            f"with the ctrl of the key frame hover, {_told(hover)}, it moves at {speed:.2g} m/s and turns at"
            f" {turn:.2g} rad/s after {TRIAL_S:g} s, instead of hovering"
        )
        return
    before = (*still.velocity.tolist(), still.yaw_rate)
    for i, (name, where) in enumerate(zip(STICKS, ("forwards", "to port", "up", "nose to port"), strict=True)):
        u = hover.copy()
        step = TRIAL_STICK if u[i] + TRIAL_STICK <= high[i] else -TRIAL_STICK
        u[i] += step
        moved = _trial(mujoco, model, u)
        change = ((*moved.velocity.tolist(), moved.yaw_rate)[i] - before[i]) / step
        if np.isfinite(moved.position).all() and abs(moved.position[2]) < FAR_M and change < 1e-6:
            does = "does nothing" if change > -1e-6 else "acts the other way"
            yield f"a positive {name} has to move it {where}, and {does}"


def _trial(mujoco: Any, model: Any, u: Array) -> Moving:
    """Return how it moves after holding an input (4,), from hover far above the floor."""
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("hover").id)
    data.act[:4] = hover_trim(model)
    data.ctrl[:4] = u
    motion = motion_of(model, data)
    high_up = np.zeros(8)
    high_up[2] = 100.0
    motion.place(high_up)
    mujoco.mj_step(model, data, round(TRIAL_S / model.opt.timestep))
    return motion.now()


def _there_are(names: Sequence[str]) -> str:
    named = [name for name in names if name]
    return f" (there are {clean(', '.join(named), 60)})" if named else ""


def _told(u: Array) -> str:
    return " ".join(f"{value:g}" for value in u)
