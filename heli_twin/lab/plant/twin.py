"""A helicopter of MuJoCo in flight: its state is read, and what acts on it is written, between physics steps."""

from collections.abc import Callable, Sequence
from functools import partial
from math import isfinite
from typing import Any, NamedTuple, Protocol

import numpy as np

from controllers.markers import Named, by_name
from controllers.signals import Array
from heli_twin.lab.plant import STILL_AIR, Air, Battery, Truth
from heli_twin.lab.plant.effects import PERIOD_NS, Effect, Physics, number
from heli_twin.lab.plant.motion import FreeJoint, Motion


class Spec(Protocol):
    """Facts about a flying helicopter beside its MuJoCo model."""

    @property
    def step_ns(self) -> int:
        """Length of one physics step, ns."""
        ...

    @property
    def delay_steps(self) -> int:
        """Delay of the stick inputs in physics steps; it is in the model too."""
        ...

    @property
    def effects(self) -> tuple[Effect | Named[Effect], ...]:
        """Effects; they are built into the model."""
        ...


class Parts(NamedTuple):
    """The engine's side of a helicopter, for `Twin`. Its first four actuators are the sticks."""

    engine: Any
    """MuJoCo."""
    model: Any
    """Compiled. Its body `fuselage` is the helicopter."""
    data: Any
    """As far as it is not the state of the helicopter itself."""
    motion: Motion
    trim: Array
    """(4,) input that holds it still in still air, without effects."""
    mass: float
    """kg."""
    describe: Callable[[], str]
    """Gives the simulated MJCF, visuals included."""
    prefix: str = ""
    """Begins the names of its parts where several helicopters share the model; then another steps all of them."""


PARTS = ("actuator", "body", "geom", "joint", "site", "tendon")
"""The lookup methods of `mujoco.MjModel` by name, which `Names` prefixes."""


class Names:
    """A model in which the names of one helicopter's parts begin with a prefix, under the names without it."""

    def __init__(self, model: Any, prefix: str) -> None:
        self._model, self._prefix = model, prefix

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._model, name)
        return partial(self._part, found) if name in PARTS else found

    def _part(self, find: Callable[[str], Any], name: str) -> Any:
        return find(self._prefix + name)


class Twin:
    """A flying MuJoCo helicopter."""

    def __init__(self, parts: Parts, spec: Spec, x: Array) -> None:
        mujoco, self._parts = parts.engine, parts
        self.gyro_works, self.feels_moments = True, True
        self._gyro_worked = True
        self._steps = 0
        self._step_ns = spec.step_ns
        self._effect_steps = PERIOD_NS // self._step_ns
        self._mj_step = mujoco.mj_step
        self._model, self._data = model, data = parts.model, parts.data
        named = Names(model, parts.prefix) if parts.prefix else model
        thrust, fuselage, root = named.actuator("u_z").id, named.body("fuselage").id, model.body_rootid
        self._physics = Physics(named, data, parts.motion, parts.trim.copy(), 1e-9 * self._effect_steps * self._step_ns)
        first = self._physics.first_stick
        # Views of what is written in flight: to look it up takes as long as a physics step.
        self._ctrl, self._actuators = data.ctrl[first : first + 4], self._physics.actuators
        self._force, self._torque = data.xfrc_applied[fuselage, :3], data.xfrc_applied[fuselage, 3:]
        self._thrust_gain = model.actuator_gainprm[thrust, :3]
        self._full_thrust, self._thrust_factor = self._thrust_gain.copy(), 1.0
        self._air, self._moment = STILL_AIR, None
        self._truth: Truth | None = None
        self._own = root[model.geom_bodyid] == root[fuselage]
        """Of each geom: whether it is a part of the helicopter."""
        foreign = np.array([i > 0 and not model.body(i).name.startswith(parts.prefix) for i in range(model.nbody)])
        self._foreign = foreign[model.geom_bodyid]
        """Of each geom: whether it is a part of another helicopter."""
        air = number(named.joint, "air_x")
        air = None if air is None else model.jnt_dofadr[air]
        self._wind = model.opt.wind if air is None else data.qvel[air : air + 3]
        """(3,) view of what the engine takes for the wind: its own, or the velocity of the body `air`."""

        parts.motion.place(x)
        updates = [effect.start(self._physics) for effect in by_name(spec.effects).values()]
        self._every_period = [update.every_period for update in updates if update.every_period]
        if isinstance(parts.motion, FreeJoint):
            self._every_period.append(self._count_turns)
        self._on_input = [update.on_input for update in updates if update.on_input]
        self._update_effects()
        trim = self._physics.trim
        hover = 0.0 if self._physics.stands else trim[2] / max(self._physics.thrust, 1e-9)
        trim[2] = np.clip(hover, *model.actuator_ctrlrange[thrust])
        # Rotors, servos and the inputs in the receiver's delay start at trim, or the helicopter would drop at once.
        self._actuators[:] = self._ctrl[:] = trim
        self._u = trim.tolist()
        if spec.delay_steps:
            for i, u in enumerate(trim.tolist(), first):
                mujoco.mj_initCtrlHistory(model, data, i, None, np.full((spec.delay_steps, 1), u))
        mujoco.mj_forward(model, data)
        deepest = min((float(data.contact.dist[i]) for i in self._touching()), default=0.0)
        if deepest < -0.002:
            raise ValueError(
                f"at a height of {float(x[2]):g} m the helicopter would stand {-deepest:.3g} m in the floor: start"
                " higher (the height is that of its centre of gravity)"
            )

    def truth(self) -> Truth:
        """Return its state now, read from the joints: the engine's sensors would be one step old.

        `touching` alone is as of the start of the newest step.
        """
        if self._truth is None:
            stamp, moving = self._steps * self._step_ns, self._parts.motion.now()
            self._truth = Truth(stamp, *moving, self._actuators.copy(), bool(len(self._touching())))
        return self._truth

    def _touching(self) -> Sequence[int]:
        """Return the contacts of a part of it with something that is none; of a payload and other helicopters, none."""
        if not self._data.ncon:
            return ()
        geoms = self._data.contact.geom
        ignored = ((geoms == self._physics.loose_geom) | self._foreign[geoms]).any(axis=1)
        return np.flatnonzero(~ignored & (self._own[geoms].sum(axis=1) == 1)).tolist()

    def advance(self, until: int, u: Array, air: Air) -> None:
        """Fly on to `until` (ns) with the input (4,) held; it is clipped to the travel of the sticks.

        Wind acts through drag, `air.acceleration` as a force at the centre of gravity, `air.thrust_factor` on the
        thrust at once, `air.moment` about the axes of the body at each step. Of several helicopters in one world, it
        takes over what acts on it: the world flies on with all of them.

        Raises:
            ValueError: `until` is in the past or not on a physics step, or the input is not finite.
        """
        target, off_grid = divmod(until, self._step_ns)
        if off_grid or target < self._steps:
            now = self._steps * self._step_ns
            raise ValueError(f"until = {until} ns has to be {now} ns plus whole steps of {self._step_ns} ns")
        asked = u.tolist()
        # What acts already is finite.
        if asked != self._u and not all(map(isfinite, asked)):
            raise ValueError(f"the input is not finite: {u}")
        if target == self._steps:
            return
        self.hold(asked, air)
        while self._steps < target and not self._parts.prefix:
            steps = self.due(target)
            self._step(steps)
            self.passed(steps)

    def hold(self, u: list[float], air: Air) -> None:
        """Take over the four inputs and the air that act from now on."""
        if air is not self._air:
            self._air, self._moment = air, air.moment
            self._wind[:], self._force[:] = air.wind, self._parts.mass * air.acceleration
        if self.gyro_works != self._gyro_worked:
            self._gyro_worked = self.gyro_works
            self._parts.motion.damp_yaw(self.gyro_works)
        if u != self._u:
            self._u = u
            self._act()

    def due(self, target: int) -> int:
        """Do what is due before the next physics step; return for how many this holds, `target` (steps) at most."""
        if not self._every_period:
            if self._air.thrust_factor != self._thrust_factor:
                self._scale_thrust(self._air.thrust_factor)
            return target - self._steps
        into = self._steps % self._effect_steps
        if into == 0 and self._steps:
            self._update_effects()
            self._act()
        self._scale_thrust(self._air.thrust_factor * self._physics.thrust)
        return min(self._effect_steps - into, target - self._steps)

    def passed(self, steps: int) -> None:
        """Take note that physics steps are done."""
        self._steps += steps
        self._truth = None

    def place(self, x: Array) -> None:
        """Put it into physical state x (8,), level."""
        self._parts.motion.place(x)
        self._truth = None

    def turn_moment(self) -> None:
        """Turn the moment of the air with the helicopter, before a physics step."""
        if self._moment is not None:
            self._torque[:] = rotated_to_world(self._parts.motion.now().quat_wxyz, self._moment)

    def _step(self, steps: int) -> None:
        """Do some physics steps."""
        if self._moment is None:
            self._mj_step(self._model, self._data, steps)
            return
        for _ in range(steps):
            self.turn_moment()
            self._mj_step(self._model, self._data, 1)
        self._torque[:] = 0.0

    def _act(self) -> None:
        """Give the input to servos and rotors, as effects change it."""
        physics = self._physics
        if not self._on_input:
            self._ctrl[:] = self._u
            return
        physics.u = np.array(self._u)
        for update in self._on_input:
            update(physics)
        self._ctrl[:] = physics.u

    def _count_turns(self, _: Physics) -> None:
        """Look at the heading: it is unwrapped by who looks often enough."""
        self._parts.motion.now()

    def _update_effects(self) -> None:
        self._physics.thrust = 1.0
        for update in self._every_period:
            update(self._physics)

    def _scale_thrust(self, factor: float) -> None:
        if factor != self._thrust_factor:
            self._thrust_factor, self._thrust_gain[:] = factor, self._full_thrust * factor

    def battery(self) -> Battery | None:
        """Return its battery now; None without the effect of that name."""
        return self._physics.battery

    def description(self) -> str:
        """Return the simulated MJCF, visuals included."""
        return self._parts.describe()


def rotated_to_world(quat_wxyz: Array, vector_body: Array) -> Array:
    """Return a vector (3,) of the body in the world, given the attitude (4,), scalar first."""
    w, axis = quat_wxyz[0], quat_wxyz[1:]
    turned = 2.0 * np.cross(axis, vector_body)
    return vector_body + w * turned + np.cross(axis, turned)
