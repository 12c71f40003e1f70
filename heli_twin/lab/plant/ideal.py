"""The paper's model as a plant: it flies exactly as the controller believes, unless the two parameter sets differ."""

from dataclasses import dataclass, field, replace
from math import cos, isfinite, sin
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Le, Unit, doc

from controllers.model import Input, Model, State, simulator
from controllers.signals import Array, nanoseconds
from heli_twin.lab.plant import Air, Truth, is_whole_nanoseconds


@dataclass(frozen=True, slots=True)
class Ideal:
    """The helicopter of (1): no attitude, no lag, no delay, always level.

    Moments of disturbances do not act on it: it has no inertia and is always level.

    Its `model` is its own copy: a mismatch means that it differs from the controller's. Only the travel of the sticks
    limits the inputs here; the limits (29) are those of the controller.

    Source: Kunz, Huck, Summers, ECC 2013, (1).
    """

    kind: Literal["ideal"] = "ideal"
    model: Annotated[Model, doc("parameters as they are")] = field(default_factory=Model)
    step: Annotated[float, Ge(1e-5), Le(0.02), Unit("s"), doc("grid of times at which inputs may change")] = 0.001

    def __post_init__(self) -> None:
        """Refuse a step that integer time cannot count.

        Raises:
            ValueError: The step is no whole number of nanoseconds.
        """
        if not is_whole_nanoseconds(self.step):
            raise ValueError(f"step is {self.step} s: take a whole number of nanoseconds")

    @property
    def step_ns(self) -> int:
        """Length of one step, ns."""
        return nanoseconds(self.step)

    def start(self, x: Array) -> "IdealHelicopter":
        """Make the helicopter in physical state x (8,) at time 0."""
        return IdealHelicopter(self, x)


class IdealHelicopter:
    """A flying point with a heading."""

    def __init__(self, spec: Ideal, x: Array) -> None:
        self._spec = spec
        self.gyro_works = True
        self._simulate = simulator(spec.model, spec.step)
        self._simulate_undamped = simulator(replace(spec.model, k_yaw=0.0), spec.step)
        self._steps = 0
        px, py, pz, yaw, vx, vy, vz, r = (float(v) for v in x)
        self._x: State = (px, py, pz, yaw, vx, vy, vz, r)
        self._u: Input = spec.model.u_hover

    def truth(self) -> Truth:
        """Return its state now; `touching` reports the floor at height 0, which does not stop this helicopter."""
        px, py, pz, yaw, vx, vy, vz, r = self._x
        c, s = cos(yaw), sin(yaw)
        return Truth(
            stamp=self._steps * self._spec.step_ns,
            position=np.array((px, py, pz)),
            quat_wxyz=np.array((cos(0.5 * yaw), 0.0, 0.0, sin(0.5 * yaw))),
            velocity=np.array((c * vx - s * vy, s * vx + c * vy, vz)),
            angular_velocity=np.array((0.0, 0.0, r)),
            yaw=yaw,
            yaw_rate=r,
            actuators=np.array(self._u),
            touching=pz <= 0.0,
        )

    def advance(self, until: int, u: Array, air: Air) -> None:
        """Fly on to `until` (ns) with the input (4,) held; it is clipped to the travel of the sticks.

        Every step is integrated separately, so that a flight in pieces equals the whole flight to the last digit.

        Raises:
            ValueError: `until` is in the past or not on a step, or the input is not finite.
        """
        target, off_grid = divmod(until, self._spec.step_ns)
        if off_grid or target < self._steps:
            now = self._steps * self._spec.step_ns
            raise ValueError(f"until = {until} ns has to be {now} ns plus whole steps of {self._spec.step_ns} ns")
        asked = u.tolist()
        if not all(map(isfinite, asked)):
            raise ValueError(f"the input is not finite: {u}")
        if target == self._steps:
            return
        ux, uy, uz, uyaw = (min(max(stick, low), 1.0) for stick, low in zip(asked, _LOWEST, strict=True))
        self._u = (ux, uy, uz, uyaw)
        wx, wy, _ = air.wind.tolist()
        ax, ay, az = air.acceleration.tolist()
        driven, push = (ux, uy, uz * air.thrust_factor, uyaw), (ax, ay, az, 0.0)
        simulate, steps = self._simulate if self.gyro_works else self._simulate_undamped, target - self._steps
        if wx or wy:
            for _ in range(steps):
                (moved,) = simulate(_seen_from(self._x, wx, wy), (driven,), push)
                px, py, pz, yaw, vx, vy, vz, r = _seen_from(moved, -wx, -wy)
                self._x = (px + wx * self._spec.step, py + wy * self._spec.step, pz, yaw, vx, vy, vz, r)
        else:
            self._x = simulate(self._x, (driven,) * steps, push)[-1]
        self._steps = target

    def battery(self) -> None:
        """Return None: it never runs empty."""

    def description(self) -> str:
        """Empty: the model is the spec."""
        return ""


_LOWEST = (-1.0, -1.0, 0.0, -1.0)
"""Travel of the sticks; its upper end is 1."""


def _seen_from(x: State, wx: float, wy: float) -> State:
    """The state with velocities relative to air that moves with (wx, wy) in the world, m/s.

    Drag in (1) acts on them, and steady wind is as good a frame as the room. Height has no drag in (1), and no wind.
    """
    px, py, pz, yaw, vx, vy, vz, r = x
    c, s = cos(yaw), sin(yaw)
    return (px, py, pz, yaw, vx - c * wx - s * wy, vy + s * wx - c * wy, vz, r)
