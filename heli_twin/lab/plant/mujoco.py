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
from collections.abc import Callable
from contextlib import suppress
from copy import copy
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.resources import files
from math import sqrt
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Ge, Gt, Le, Unit, doc

from controllers.markers import EachOf, Named, by_name
from controllers.model import GRAVITY
from controllers.signals import Array, nanoseconds
from heli_twin.lab.plant import is_whole_nanoseconds
from heli_twin.lab.plant.effects import Effect
from heli_twin.lab.plant.motion import Gimbal
from heli_twin.lab.plant.twin import Parts, Twin

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
        if not is_whole_nanoseconds(self.step):
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
        parts = Parts(engine(), model, data, Gimbal(model, data), np.array(self.trim), self.mass, mjcf_of(self))
        return Twin(parts, self, x)


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
        library: Any = mujoco._functions  # pyright: ignore[reportAttributeAccessIssue]
        clock = ctypes.c_void_p.in_dll(ctypes.CDLL(library.__file__), "mjcb_time")
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
