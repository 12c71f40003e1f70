"""The twin: the helicopter with what the paper's model leaves out, simulated by MuJoCo, which is imported only here.

At hover thrust and steady tilt it reduces exactly to the paper's (1) with (27); on the way there it has attitude,
servo, thrust and yaw lag, a receiver's delay, a floor, and a weight of its own. With t the pitch angle, roll mirrored:

    servo     ds/dt = (u(t - input_delay) - s) / lag                 for each of the four inputs
    pitch     Iyy t'' = -K sin t - 2 zeta w Iyy t' + K pitch_gain s   with K = Iyy w^2, the same K for roll
    thrust    thrust_gain s thrust_factor, along the mast
    yaw       Izz r' = yaw_gain s - yaw_damping r
    drag      -diag(drag_x, drag_y, drag_z) (v - wind) in the yaw frame: turned by the heading, not tilted

To these MuJoCo adds what a tilting rigid body does anyway: tilted thrust carries less, and turning couples the axes.
Importing this module does not load the engine; starting a flight does.
"""

import ctypes
from collections.abc import Callable, Sequence
from contextlib import suppress
from copy import copy
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.resources import files
from math import isfinite, sqrt
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, Protocol

import numpy as np
from annotated_types import Ge, Gt, Le, Unit, doc

from controllers.markers import EachOf, Named, by_name
from controllers.model import GRAVITY
from controllers.signals import Array, nanoseconds
from heli_twin.lab.plant import STILL_AIR, Air, Battery, Truth
from heli_twin.lab.plant.effects import PERIOD_NS, Effect, Physics, number
from heli_twin.lab.plant.motion import FreeJoint, Gimbal, Motion

STICKS = ("u_x", "u_y", "u_z", "u_yaw")
"""Actuators that the receiver drives, in the order of the input; they come first in the model file."""


@dataclass(frozen=True, slots=True)
class MuJoCo:
    """Physical parameters of the helicopter as it is.

    The defaults are the paper's identified parameters (27) turned into physical ones at 28 g. Thrust and drag stay in
    newtons when `mass` changes, so that a heavier helicopter needs more throttle.

    Source: Kunz, Huck, Summers, ECC 2013, (27). Inertias, lags and attitude, which the paper omits, are engineering
    estimates: a component model of the airframe, and the CoaX helicopter (0.302 kg) scaled by Froude number.
    """

    kind: Literal["mujoco"] = "mujoco"
    mass: Annotated[float, Ge(0.01), Le(0.1), Unit("kg"), doc("weight as flown")] = 0.028
    inertia_xx: Annotated[float, Ge(1e-6), Le(1e-3), Unit("kg m^2"), doc("about the nose axis")] = 2.8e-5
    inertia_yy: Annotated[float, Ge(1e-6), Le(1e-3), Unit("kg m^2"), doc("about the port axis")] = 3.9e-5
    inertia_zz: Annotated[float, Ge(1e-6), Le(1e-3), Unit("kg m^2"), doc("about the mast")] = 2.7e-5
    # m b_z = 0.028 * 18
    thrust_gain: Annotated[float, Gt(0), Le(5), Unit("N"), doc("thrust at full stick")] = 0.504
    # b_x / g = 2.0 / 9.81 and b_y / g = 2.1 / 9.81: at hover thrust, g sin(tilt) is the acceleration of (27).
    pitch_gain: Annotated[float, Gt(0), Le(0.9), Unit("1"), doc("sine of the pitch angle at full stick")] = 2.0 / 9.81
    roll_gain: Annotated[float, Gt(0), Le(0.9), Unit("1"), doc("sine of the roll angle at full stick")] = 2.1 / 9.81
    # Izz b_psi = 2.7e-5 * 111, Izz |k_psi| = 2.7e-5 * 5
    yaw_gain: Annotated[float, Gt(0), Le(0.1), Unit("N m"), doc("yaw torque at full stick")] = 2.997e-3
    yaw_damping: Annotated[float, Ge(0), Le(0.1), Unit("N m s"), doc("yaw damping by the on-board rate gyro")] = 1.35e-4
    # m |k_x| = 0.028 * 0.5, m |k_y| = 0.028 * 0.4; heave damping is 0 in (1), physically 0.03 to 0.06.
    drag_x: Annotated[float, Ge(0), Le(1), Unit("N s/m"), doc("drag along the nose")] = 0.014
    drag_y: Annotated[float, Ge(0), Le(1), Unit("N s/m"), doc("drag to port")] = 0.0112
    drag_z: Annotated[float, Ge(0), Le(1), Unit("N s/m"), doc("drag upwards")] = 0.0
    attitude_frequency: Annotated[float, Gt(0), Le(2e4), Unit("rad/s"), doc("natural frequency of pitch")] = 14.0
    # Undamped, the explicit integrator would let turning and tilting pump each other.
    attitude_damping: Annotated[float, Ge(0.1), Le(5), Unit("1"), doc("damping ratio of pitch and roll")] = 0.5
    pitch_trim: Annotated[float, Ge(-0.5), Le(0.5), Unit("full stick"), doc("pitch input that holds it level")] = 0.0
    roll_trim: Annotated[float, Ge(-0.5), Le(0.5), Unit("full stick"), doc("roll input that holds it level")] = 0.0
    yaw_trim: Annotated[float, Ge(-0.5), Le(0.5), Unit("full stick"), doc("yaw input that holds the heading")] = 0.0
    servo_lag: Annotated[float, Ge(0), Le(1), Unit("s"), doc("time constant of the swashplate servos")] = 0.03
    thrust_lag: Annotated[float, Ge(0), Le(1), Unit("s"), doc("time constant of thrust: rotor speed")] = 0.06
    # The motors' reaction torque leads the rotor speed: a coreless motor's current settles within a millisecond, and
    # the speed controller's PWM and mixing add a few. An estimate; at 20 ms a 45 ms loop would not limit-cycle in yaw.
    yaw_lag: Annotated[float, Ge(0), Le(1), Unit("s"), doc("time constant of the yaw torque")] = 0.005
    input_delay: Annotated[
        float, Ge(0), Le(0.2), Unit("s"), doc("receiver and servo electronics, rounded to whole steps")
    ] = 0.002
    step: Annotated[float, Ge(1e-5), Le(0.005), Unit("s"), doc("length of one physics step")] = 0.001
    effects: Annotated[
        tuple[Effect | Named[Effect], ...],
        EachOf("heli_twin.lab.plant.effects"),
        doc("what else it does; `off` leaves one out"),
    ] = ()

    def __post_init__(self) -> None:
        """Refuse parameters that the engine cannot simulate.

        Raises:
            ValueError: The step is no whole number of nanoseconds or too long for the attitude, or the inertias are
                no rigid body's.
        """
        if abs(self.step_ns - 1e9 * self.step) > 1e-3:
            raise ValueError(f"step is {self.step} s: take a whole number of nanoseconds")
        # The integrator keeps even an undamped oscillator stable up to 2 rad a step.
        fastest = self.attitude_frequency * max(1.0, sqrt(self.inertia_yy / self.inertia_xx))
        if fastest * self.step > 2.0:
            raise ValueError(
                f"attitude_frequency {self.attitude_frequency:g} rad/s is too fast for a step of {self.step:g} s: "
                f"take a step of at most {2.0 / fastest:.2g} s, or a frequency of at most "
                f"{2.0 / self.step * self.attitude_frequency / fastest:.4g} rad/s"
            )
        small, middle, large = sorted((self.inertia_xx, self.inertia_yy, self.inertia_zz))
        if small + middle < large:
            raise ValueError(
                f"inertias {small:g}, {middle:g}, {large:g} kg m^2 are no rigid body's: none may exceed the others' sum"
            )
        kinds = [effect.kind for effect in by_name(self.effects).values()]
        twice = next((kind for kind in kinds if kinds.count(kind) > 1), None)
        if twice:
            raise ValueError(f"effects has two of the kind '{twice}': leave one of them out")

    @property
    def step_ns(self) -> int:
        """Length of one physics step, ns."""
        return nanoseconds(self.step)

    @property
    def delay_steps(self) -> int:
        """`input_delay` in physics steps."""
        return round(self.input_delay / self.step)

    @property
    def trim(self) -> tuple[float, float, float, float]:
        """The input that holds this helicopter still in still air; full throttle if it is too heavy to hover."""
        hover = min(self.mass * GRAVITY / self.thrust_gain, 1.0)
        return (self.pitch_trim, self.roll_trim, hover, self.yaw_trim)

    def start(self, x: Array) -> "Twin":
        """Make the helicopter in physical state x (8,), level, trimmed for hover, at time 0.

        Raises:
            ValueError: At x the helicopter would stand in the floor.
        """
        # A copy: faults and effects change the model in flight.
        model = copy(_compiled(self))
        data = engine().MjData(model)
        parts = Parts(model, data, Gimbal(model, data), np.array(self.trim), self.mass, mjcf_of(self))
        return Twin(parts, self, x)


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


class Names:
    """A model in which the names of one helicopter's parts begin with a prefix, under the names without it."""

    def __init__(self, model: Any, prefix: str) -> None:
        self._model, self._prefix = model, prefix

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._model, name)
        if name in ("actuator", "body", "geom", "joint", "site", "tendon"):
            return lambda part: found(self._prefix + part)
        return found


class Twin:
    """A flying MuJoCo helicopter."""

    def __init__(self, parts: Parts, spec: Spec, x: Array) -> None:
        mujoco = engine()
        self._parts = parts
        self.gyro_works, self.feels_moments = True, True
        self._gyro_worked = True
        self._steps = 0
        self._step_ns = spec.step_ns
        self._effect_steps = max(1, PERIOD_NS // self._step_ns)
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
            self._every_period.append(lambda _: parts.motion.now() and None)
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
        if not all(map(isfinite, u.tolist())):
            raise ValueError(f"the input is not finite: {u}")
        if target == self._steps:
            return
        self.hold(u, air)
        while self._steps < target and not self._parts.prefix:
            steps = self.due(target)
            self._step(steps)
            self.passed(steps)

    def hold(self, u: Array, air: Air) -> None:
        """Take over the input (4,) and the air that act from now on."""
        asked = u.tolist()
        if air is not self._air:
            self._air, self._moment = air, air.moment
            self._wind[:], self._force[:] = air.wind, self._parts.mass * air.acceleration
        if self.gyro_works != self._gyro_worked:
            self._gyro_worked = self.gyro_works
            self._parts.motion.damp_yaw(self.gyro_works)
        if asked != self._u:
            self._u = asked
            self._act()

    def due(self, target: int) -> int:
        """Do what is due before the next physics step; return for how many this holds, `target` (steps) at most."""
        if not self._every_period:
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


@lru_cache(maxsize=64)
def _compiled(p: MuJoCo) -> Any:
    """Cached: it takes as long as a tenth of a second of flight, and a study flies a helicopter more than once."""
    return edited(p, visuals=False).compile()


def mjcf_of(p: MuJoCo) -> Callable[[], str]:
    """Return what gives the simulated MJCF, visuals included."""
    return lambda: _mjcf(p)


@lru_cache(maxsize=64)
def _mjcf(p: MuJoCo) -> str:
    """Cached: it takes 10 ms, and a study flies a helicopter more than once."""
    spec = edited(p, visuals=True)
    spec.compile()
    return spec.to_xml()


@cache
def engine() -> Any:
    """MuJoCo, loaded on first use. Its wheel carries no types."""
    import mujoco

    # When a flight diverges, the outcome says so; MuJoCo would also print, and write a file into the working directory.
    log = mujoco.MjLogConfig.get()  # pyright: ignore[reportAttributeAccessIssue]
    log.logto_file = log.logto_console = False
    log.set()
    # The wheel's own clock, read around every part of a step, takes a quarter of the step. Without one, MuJoCo keeps no
    # times; the bindings can change the clock but not take it away.
    with suppress(OSError, ValueError):
        clock = ctypes.c_void_p.in_dll(ctypes.CDLL(mujoco._functions.__file__), "mjcb_time")
        clock.value = None
    return mujoco


def model_file() -> Path:
    """Return the path of the MJCF: inside an installed package, or at the top of a checkout."""
    installed = Path(str(files("heli_twin") / "models" / "mcx2.xml"))
    return installed if installed.is_file() else Path(str(files("heli_twin"))).parent / "models" / "mcx2.xml"


def edited(p: MuJoCo, *, visuals: bool) -> Any:
    """The model file with the parameters `p` written into it.

    Args:
        p: Parameters.
        visuals: Whether to keep what is only looked at; it costs a tenth of the speed.
    """
    spec = engine().MjSpec.from_file(str(model_file()))
    spec.option.timestep = 1e-9 * p.step_ns
    spec.compiler.discardvisual = not visuals
    fuselage = spec.body("fuselage")
    # The carrier of the yaw frame weighs next to nothing, but hover shall be an equilibrium to the last digit.
    fuselage.mass = p.mass - spec.body("yaw_frame").mass
    fuselage.inertia = (p.inertia_xx, p.inertia_yy, p.inertia_zz)

    stiffness = p.inertia_yy * p.attitude_frequency**2
    damping = 2.0 * p.attitude_damping * sqrt(stiffness)
    spec.joint("pitch").damping[0] = damping * sqrt(p.inertia_yy)
    spec.joint("roll").damping[0] = damping * sqrt(p.inertia_xx)
    spec.joint("yaw").damping[0] = p.yaw_damping

    gains = (stiffness * p.pitch_gain, stiffness * p.roll_gain, p.thrust_gain, p.yaw_gain)
    lags = (p.servo_lag, p.servo_lag, p.thrust_lag, p.yaw_lag)
    level = (p.pitch_trim, p.roll_trim, 0.0, p.yaw_trim)
    for name, gain, lag, trim in zip(STICKS, gains, lags, level, strict=True):
        stick = spec.actuator(name)
        stick.gainprm[0] = gain
        stick.biasprm[0] = -gain * trim
        stick.dynprm[0] = lag
        if p.delay_steps:
            stick.delay = p.delay_steps * spec.option.timestep
            stick.nsample = p.delay_steps
    for name, drag in (("drag_x", p.drag_x), ("drag_y", p.drag_y), ("drag_z", p.drag_z)):
        spec.actuator(name).biasprm[2] = -drag
    force = stiffness / spec.site("mast").pos[2]
    spec.actuator("stiffness_up").biasprm[0] = force
    spec.actuator("stiffness_down").biasprm[0] = -force
    for effect in by_name(p.effects).values():
        effect.build(spec)
    return spec


def rotated_to_world(quat_wxyz: Array, vector_body: Array) -> Array:
    """Return a vector (3,) of the body in the world, given the attitude (4,), scalar first."""
    w, axis = quat_wxyz[0], quat_wxyz[1:]
    turned = 2.0 * np.cross(axis, vector_body)
    return vector_body + w * turned + np.cross(axis, turned)
