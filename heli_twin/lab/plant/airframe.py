"""A helicopter of a user's own: an MJCF that keeps the contract in `heli_twin.lab.plant.contract`."""

import re
from dataclasses import dataclass
from functools import lru_cache
from math import asin, atan2
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Ge, Le, Unit, doc

from controllers.markers import EachOf, FileContent, Named, by_name
from controllers.signals import Array, nanoseconds
from heli_twin.lab.plant import is_whole_nanoseconds
from heli_twin.lab.plant.contract import hover_trim, motion_of, violations
from heli_twin.lab.plant.effects import Effect
from heli_twin.lab.plant.mjcf_text import normal_form, read_text, timestep, unpacked
from heli_twin.lab.plant.mujoco import engine, model_file
from heli_twin.lab.plant.shape import Primitive
from heli_twin.lab.plant.twin import Parts, Twin
from heli_twin.terminal_text import clean

TOLD_VIOLATIONS = 3
LONGEST_STEP_S, SHORTEST_STEP_S = 0.005, 1e-5


def read_model(file: Path) -> str:
    """Read an MJCF of a user's own as the text of `Airframe.model`, after a check that it keeps the contract.

    Raises:
        OSError: It cannot be read.
        ValueError: One sentence that says what it lacks or may not have.
    """
    name = clean(file.name, 80)
    try:
        text = read_text(file)
        _check_step(text)
        _check_contract(text)
    except ValueError as error:
        raise ValueError(f"{name} {error}") from None
    return text


@dataclass(frozen=True, slots=True)
class Airframe:
    """A helicopter of your own, described by an MJCF file: `plant.model=my_heli.xml`.

    The file keeps a contract: the body `fuselage` on a free joint, the four stick actuators u_x, u_y, u_z, u_yaw first,
    a key frame `hover` (`heli_twin.lab.plant.contract` says all of it). The value of `model` is its text, with the mesh
    files that it names inside: a log flies again without the file. Without a text it is `models/mcx2.xml`.
    """

    kind: Literal["airframe"] = "airframe"
    # Effects and delay stand first, since the text is long.
    input_delay: Annotated[
        float, Ge(0), Le(0.2), Unit("s"), doc("receiver and servo electronics, rounded to whole steps")
    ] = 0.002
    model: Annotated[str | Path, FileContent(read_model), doc("MJCF: a file, whose text is kept; empty: the mCX2")] = ""
    effects: Annotated[
        tuple[Effect | Named[Effect], ...],
        EachOf("heli_twin.lab.plant.effects"),
        doc("what else it does; `off` leaves one out"),
    ] = ()

    def __post_init__(self) -> None:
        """Read the file if `model` is a path, and check the text as far as can be without the engine.

        Raises:
            ValueError: The text is none that may fly.
        """
        if isinstance(self.model, Path):
            try:
                object.__setattr__(self, "model", read_model(self.model))
            except OSError as error:
                raise ValueError(f"model: cannot read {clean(str(self.model), 200)}: {error.strerror}") from None
            except ValueError as error:
                raise ValueError(f"model: {error}") from None
        elif self.model:
            try:
                object.__setattr__(self, "model", normal_form(self.model))
                _check_step(self.text)
            except ValueError as error:
                raise ValueError(f"model {error}") from None

    @property
    def text(self) -> str:
        """The MJCF in its normal form."""
        return str(self.model) or _mcx2()

    @property
    def step(self) -> float:
        """Length of one physics step, s: the `timestep` of the MJCF."""
        return timestep(self.text)

    @property
    def step_ns(self) -> int:
        """Length of one physics step, ns."""
        return nanoseconds(self.step)

    @property
    def delay_steps(self) -> int:
        """`input_delay` in physics steps."""
        return round(self.input_delay / self.step)

    def start(self, x: Array) -> Twin:
        """Make the helicopter in physical state x (8,), level, in its key frame `hover`, at time 0.

        Raises:
            ValueError: The model does not keep the contract, lacks what an effect needs, or would stand in the floor.
        """
        try:
            _check_contract(self.text)
        except ValueError as error:
            raise ValueError(f"plant.model {error}") from None
        model = self._edited(visuals=False).compile()
        data = engine().MjData(model)
        engine().mj_resetDataKeyframe(model, data, model.key("hover").id)
        mass = float(model.body_subtreemass[model.body_rootid[model.body("fuselage").id]])
        parts = Parts(engine(), model, data, motion_of(model, data), hover_trim(model), mass, self._mjcf)
        try:
            return Twin(parts, self, x)
        except KeyError as error:
            raise ValueError(f"an effect needs what plant.model has not: {clean(str(error), 100)}") from None

    def shape(self) -> tuple[Primitive, ...]:
        """Return its drawn shape: a primitive for each geom of the body and of what hangs on it.

        Raises:
            ValueError: The model does not keep the contract.
        """
        return _shape(self.text)

    def drawn(self) -> Any:
        """Return the model with what is only looked at, as an MjSpec.

        Raises:
            ValueError: The model does not keep the contract.
        """
        _check_contract(self.text)
        return self._edited(visuals=True)

    def _mjcf(self) -> str:
        return self._edited(visuals=True).to_xml()

    def _edited(self, *, visuals: bool) -> Any:
        spec = _parsed(self.text)
        spec.compiler.discardvisual = not visuals
        for stick in spec.actuators[:4] if self.delay_steps else ():
            stick.delay = self.delay_steps * spec.option.timestep
            stick.nsample = self.delay_steps
        for effect in by_name(self.effects).values():
            effect.build(_Named(spec, effect.kind))
        if visuals:
            spec.compile()
        return spec


class _Named:
    """The model under an effect's hands: what it looks up by name has to be there."""

    def __init__(self, spec: Any, effect: str) -> None:
        self._spec, self._effect = spec, effect

    def __getattr__(self, what: str) -> Any:
        found = getattr(self._spec, what)
        return self._looking_up(what, found) if what in ("body", "joint", "site", "actuator", "geom") else found

    def _looking_up(self, what: str, find: Any) -> Any:
        def look(name: str) -> Any:
            thing = find(name)
            if thing is None:
                raise ValueError(
                    f"plant.effects.{self._effect} needs the {what} '{name}', which plant.model has not: turn it off"
                )
            return thing

        return look


@lru_cache(maxsize=1)
def _mcx2() -> str:
    return normal_form(model_file().read_text(encoding="utf-8"))


def _check_step(text: str) -> None:
    step = timestep(text)
    if not SHORTEST_STEP_S <= step <= LONGEST_STEP_S or not is_whole_nanoseconds(step):
        raise ValueError(
            f"has a timestep of {step:g} s: take a whole number of nanoseconds from {SHORTEST_STEP_S:g} to"
            f" {LONGEST_STEP_S:g} s"
        )


def _parsed(text: str) -> Any:
    """Return the model as an MjSpec, its sticks with a lag (of 0 s where it says none), and with a floor."""
    mujoco = engine()
    xml, files = unpacked(text)
    spec = mujoco.MjSpec.from_string(xml, assets=files)
    # The engine would silently put a helicopter that diverged back to its start.
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    spec.option.timestep = 1e-9 * nanoseconds(timestep(text))
    for stick in spec.actuators[:4]:
        if stick.dyntype == mujoco.mjtDyn.mjDYN_NONE:
            stick.dyntype, stick.actearly = mujoco.mjtDyn.mjDYN_FILTEREXACT, True
            stick.dynprm[0] = 0.0
    if spec.geom("floor") is None:
        spec.worldbody.add_geom(
            name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=(5.0, 5.0, 0.1), contype=1, conaffinity=1
        )
    return spec


@lru_cache(maxsize=16)
def _check_contract(text: str) -> None:
    """Compile a text and check what it has.

    Raises:
        ValueError: One sentence.
    """
    mujoco = engine()
    try:
        model = _parsed(text).compile()
    except (ValueError, mujoco.FatalError) as error:
        # The line is one of the normal form, not of the user's file.
        told = re.sub(r", line \d+", "", " ".join(str(error).split()))
        raise ValueError(f"is no model that MuJoCo compiles: {clean(told, 200)}") from None
    lacks = [*violations(mujoco, model)]
    if lacks:
        more = len(lacks) - TOLD_VIOLATIONS
        told = "; ".join(lacks[:TOLD_VIOLATIONS]) + (f"; and {more} more" if more > 0 else "")
        raise ValueError(f"does not keep the contract of an airframe: {told}")


def shape_of(plant: Any) -> tuple[Primitive, ...]:
    """Return the drawn shape of a plant: a ball for a model that does not fly here, empty for any other plant."""
    if not isinstance(plant, Airframe):
        return ()
    try:
        return plant.shape()
    except ValueError:
        return (Primitive("sphere", (0.05,), (0.0, 0.0, 0.0), 0xA0A4ABFF),)


@lru_cache(maxsize=16)
def _shape(text: str) -> tuple[Primitive, ...]:
    _check_contract(text)
    mujoco = engine()
    model = _parsed(text).compile()
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("hover").id)
    motion_of(model, data).place(np.zeros(8))
    mujoco.mj_kinematics(model, data)
    fuselage = model.body("fuselage").id
    own = model.body_rootid[model.geom_bodyid] == model.body_rootid[fuselage]
    # Groups from 3 on are hidden by MuJoCo's viewers: collision shapes, as a rule.
    shown = own & (model.geom_group < 3) if (own & (model.geom_group < 3)).any() else own
    parts: list[Primitive] = []
    turn, origin = data.xmat[fuselage].reshape(3, 3), data.xpos[fuselage]
    for i in map(int, np.flatnonzero(shown)):
        R = turn.T @ data.geom_xmat[i].reshape(3, 3)
        centre = turn.T @ (data.geom_xpos[i] - origin)
        rgba = model.geom_rgba[i] if model.geom_matid[i] < 0 else model.mat_rgba[model.geom_matid[i]]
        colour = int.from_bytes(bytes(round(255.0 * min(max(float(c), 0.0), 1.0)) for c in rgba), "big")
        parts += _primitives(mujoco.mjtGeom(int(model.geom_type[i])).name, model, i, centre, R, colour)
    return tuple(parts)


def _primitives(kind: str, model: Any, i: int, centre: Array, R: Array, colour: int) -> list[Primitive]:
    """Return the primitives of one geom; a mesh is the box around it."""
    size, rpy = [float(s) for s in model.geom_size[i]], _rpy(R)
    at = (float(centre[0]), float(centre[1]), float(centre[2]))
    match kind.removeprefix("mjGEOM_"):
        case "SPHERE":
            return [Primitive("sphere", (size[0],), at, colour)]
        case "ELLIPSOID":
            return [Primitive("ellipsoid", (size[0], size[1], size[2]), at, colour, rpy)]
        case "CYLINDER":
            return [Primitive("cylinder", (size[0], 2.0 * size[1]), at, colour, rpy)]
        case "CAPSULE":
            ends = [centre + sign * size[1] * R[:, 2] for sign in (-1.0, 1.0)]
            balls = [Primitive("sphere", (size[0],), (float(x), float(y), float(z)), colour) for x, y, z in ends]
            return [Primitive("cylinder", (size[0], 2.0 * size[1]), at, colour, rpy), *balls]
        case "BOX":
            return [Primitive("box", (2.0 * size[0], 2.0 * size[1], 2.0 * size[2]), at, colour, rpy)]
        case "MESH":
            middle, half = model.geom_aabb[i, :3], [float(s) for s in model.geom_aabb[i, 3:]]
            x, y, z = (centre + R @ middle).tolist()
            return [Primitive("box", (2.0 * half[0], 2.0 * half[1], 2.0 * half[2]), (x, y, z), colour, rpy)]
        case _:
            return []


def _rpy(R: Array) -> tuple[float, float, float]:
    """Roll, pitch, yaw of a rotation matrix (3, 3), rad."""
    pitch = asin(min(max(-float(R[2, 0]), -1.0), 1.0))
    if abs(float(R[2, 0])) > 1.0 - 1e-9:
        # Straight up or down: roll and yaw turn about the same axis.
        return (0.0, pitch, atan2(-float(R[0, 1]), float(R[1, 1])))
    return (atan2(float(R[2, 1]), float(R[2, 2])), pitch, atan2(float(R[1, 0]), float(R[0, 0])))
