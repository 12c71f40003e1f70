"""Plant effects: what the helicopter does beyond the basic twin. One file is one effect; it is found by its `kind`.

An effect writes itself into the MuJoCo model before it is compiled, so that the engine computes it at every physics
step. What changes slowly (voltage, ground effect) is updated every `PERIOD_NS`, what answers to an input also when the
input changes; no Python runs at the physics steps in between.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

from controllers.signals import Array
from heli_twin.lab.plant import Battery
from heli_twin.lab.plant.motion import Motion

PERIOD_NS = 20_000_000
"""Time between two updates of the effects."""


class Physics:
    """The engine's model and data of one flight, and the quantities that effects share.

    Other helicopters may be in the same model: ask it for parts by their names, and take the numbers that it gives.
    """

    def __init__(self, model: Any, data: Any, motion: Motion, trim: Array, period: float) -> None:
        self.model, self.data = model, data
        self.position, self.velocity = motion.position, motion.velocity
        """(3,) views, world, m and m/s."""
        self.first_stick = int(model.actuator("u_x").id)
        """Number of the first of the four sticks."""
        lags = model.actuator_actadr[self.first_stick]
        self.actuators: Array = data.act[lags : lags + 4]
        """(4,) view: what servos, rotors and yaw drive have reached, in units of the inputs."""
        self.period = period
        """Time between two updates, s: `PERIOD_NS` in whole physics steps."""
        self.trim = trim
        """(4,) input that holds the helicopter still in still air; effects correct it when they start."""
        self.u = trim.copy()
        """(4,) input that acts on servos and rotors: that of the receiver, as the effects have changed it."""
        self.thrust = 1.0
        """Thrust as a fraction of what the throttle gives without effects; set to 1 before every update."""
        self.stands = False
        """True if the flight begins with rotors at rest instead of the trim."""
        self.battery: Battery | None = None
        self.loose_geom = -1
        """Number of a geom that is not a part of the helicopter although it moves; -1 if there is none."""


def number(find: Callable[[str], Any], name: str) -> int | None:
    """Return the number of a part of the model; None if there is none of this name.

    Args:
        find: Looks it up, such as `model.actuator`.
        name: Of the part.
    """
    try:
        return int(find(name).id)
    except KeyError:
        return None


class Updates(NamedTuple):
    """The part of an effect that acts in flight; nothing if the compiled model does it all."""

    every_period: Callable[[Physics], None] | None = None
    """Called at time 0 and every `PERIOD_NS`, for the time until the next call."""
    on_input: Callable[[Physics], None] | None = None
    """Called after `every_period`, and at once when the receiver holds another input."""


class Effect(Protocol):
    """A plant effect as a value. A frozen dataclass with a literal `kind`."""

    @property
    def kind(self) -> str:
        """Its name."""
        ...

    def build(self, model: Any) -> None:
        """Write the effect into the MuJoCo model (an MjSpec) before it is compiled."""
        ...

    def start(self, physics: Physics) -> Updates:
        """Begin a flight: correct the trim, and return what has to be updated in flight."""
        ...
