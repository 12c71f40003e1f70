"""The helicopter as it is: the interface of every plant. One file here is one kind of plant."""

from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from controllers.signals import Array, nanoseconds


class Truth(NamedTuple):
    """The true state of the helicopter. Only the lab sees it."""

    stamp: int
    """ns."""
    position: Array
    """(3,) centre of gravity, world, m."""
    quat_wxyz: Array
    """(4,) body attitude in world, scalar first."""
    velocity: Array
    """(3,) world, m/s."""
    angular_velocity: Array
    """(3,) body, rad/s."""
    yaw: float
    """Heading, unwrapped, rad."""
    yaw_rate: float
    """rad/s."""
    actuators: Array
    """(4,) what the servos, rotors and yaw drive have reached, in units of the inputs."""
    touching: bool
    """True while any part touches the floor."""


class Battery(NamedTuple):
    """The battery of the helicopter."""

    voltage: float
    """At its terminals, under load, V."""
    current: float
    """A."""
    charge: float
    """Share of the capacity that is left."""


class Air(NamedTuple):
    """The effect of the surroundings on the helicopter until the next update."""

    wind: Array
    """(3,) velocity of the air, world, m/s."""
    acceleration: Array
    """(3,) push that no model explains, world, m/s^2."""
    thrust_factor: float = 1.0
    """Thrust as a fraction of nominal."""
    moment: Array | None = None
    """(3,) moment on the helicopter, body, N m; None from a disturbance that gives none."""


STILL_AIR = Air(np.zeros(3), np.zeros(3))


class Plant(Protocol):
    """A flying helicopter. It is made by its spec's `start(x)` at rest in its trim and dies with the flight."""

    gyro_works: bool
    """True while the on-board rate gyro damps the yaw; a fault switches it."""

    def truth(self) -> Truth:
        """Return its state now; the arrays are copies that the caller may keep and does not change."""
        ...

    def advance(self, until: int, u: Array, air: Air) -> None:
        """Fly on to `until` (ns, a multiple of the step) with the input (4,) that the receiver holds.

        An `air` that is handed over does not change afterwards: the same object again is the same air.
        """
        ...

    def battery(self) -> Battery | None:
        """Return its battery now; None if it has none that could run empty."""
        ...

    def description(self) -> str:
        """Return the simulated model as text to keep with the log (the compiled MJCF; empty if there is none)."""
        ...


@runtime_checkable
class FeelsMoments(Protocol):
    """A plant on which the moments of disturbances act; a flight of one that is none warns of them."""

    @property
    def feels_moments(self) -> bool:
        """True."""
        ...


def is_whole_nanoseconds(step: float) -> bool:
    """Whether a step (s) is a whole number of nanoseconds; a thousandth of one is rounding."""
    return abs(nanoseconds(step) - 1e9 * step) <= 1e-3


class PlantSpec(Protocol):
    """The helicopter as a value. A frozen dataclass with a literal `kind`."""

    @property
    def step(self) -> float:
        """Length of one physics step, s."""
        ...

    def start(self, x: Array) -> Plant:
        """Make the helicopter in physical state x (8,), level, trimmed for hover, at time 0."""
        ...


def physical_state(truth: Truth) -> Array:
    """The eight states of the controller's model (8,), velocities turned into the yaw frame; of many truths (n, 8)."""
    c, s = np.cos(truth.yaw), np.sin(truth.yaw)
    x, y, z = np.moveaxis(truth.position, -1, 0)
    vx, vy, vz = np.moveaxis(truth.velocity, -1, 0)
    return np.stack([x, y, z, truth.yaw, c * vx + s * vy, c * vy - s * vx, vz, truth.yaw_rate], axis=-1)
