"""Rise from the floor, fly any other trajectory, and come down again."""

from dataclasses import dataclass, field, replace
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt, Unit, doc

from controllers.flatness import FlatOutput
from controllers.jets import at_pace
from controllers.markers import OneOf
from controllers.model import Model
from controllers.pace import paced, ride_clock, ride_duration, smooth_ride
from controllers.signals import Array
from controllers.splines import quintic, quintic_derivatives
from controllers.trajectories import Trajectory, derivatives, fitted, smoothness
from controllers.trajectories.circle import Circle


@dataclass(frozen=True, slots=True)
class TakeoffAndLanding:
    """Climb vertically to the start of a trajectory, fly it from rest to rest, and descend vertically from its end."""

    kind: Literal["takeoff_and_landing"] = "takeoff_and_landing"
    flight: Annotated[Trajectory, OneOf("controllers.trajectories"), doc("what to fly in between")] = field(
        default_factory=Circle
    )
    airborne: Annotated[float, Gt(0), Unit("s"), doc("how much of it to fly")] = 20.0
    stand: Annotated[float, Ge(0), Unit("s"), doc("time on the floor before it rises: the motors start")] = 1.0
    climb: Annotated[float, Gt(0), Unit("s"), doc("time to rise, and to come down")] = 3.0
    ramp: Annotated[float, Gt(0), Unit("s"), doc("time to gather speed and to stop, half of it extra")] = 2.0
    # The skids reach 0.045 m below the centre of gravity.
    floor: Annotated[float, Gt(0), Unit("m"), doc("height of the centre of gravity when it stands")] = 0.045

    def __post_init__(self) -> None:
        """Refuse a take-off within a take-off, which would double the work at each level.

        Raises:
            ValueError: The flight is of this class.
        """
        if isinstance(self.flight, TakeoffAndLanding):
            raise ValueError("flight is a take-off and landing again: choose any other trajectory")  # noqa: TRY004

    def flat(self, t: Array) -> FlatOutput:
        """Return the flight at the pace of a clock that starts and stops, lowered to the floor at both ends."""
        t = t - self.stand
        pace = smooth_ride(t - self.climb, self.airborne, self.ramp)
        inner = paced(self.flight.flat(pace[0]), pace)
        times, lowering = self._lowering()
        rest = np.zeros((4, 4))
        sunk = quintic(t, times, lowering, rest, rest)
        return FlatOutput(inner.z + sunk.z, inner.dz + sunk.dz, inner.ddz + sunk.ddz)

    @property
    def smoothness(self) -> int:
        """Up to the acceleration, where it starts and stops, or less if the flight in between is less smooth."""
        return min(2, smoothness(self.flight))

    def derivatives(self, t: Array, highest: int) -> Array:
        """Return the flat outputs and their time derivatives."""
        t = t - self.stand
        clock = ride_clock(t - self.climb, self.airborne, self.ramp, highest)
        inner = at_pace(lambda reading, order: derivatives(self.flight, reading, order), clock)
        rest = np.zeros((4, 4))
        return inner + quintic_derivatives(t, highest, *self._lowering(), (rest, rest))

    def _lowering(self) -> tuple[Array, Array]:
        """Times (4,) and points (4, 4) by which the flight is lowered to the floor at both ends."""
        first, last = self.flight.flat(np.array([0.0, self.airborne])).z[:, 2]
        descent = self.climb + ride_duration(self.airborne, self.ramp)
        lowering = np.zeros((4, 4))
        lowering[[0, 3], 2] = self.floor - first, self.floor - last
        return np.array([0.0, self.climb, descent, descent + self.climb]), lowering

    def fitted(self, model: Model) -> "TakeoffAndLanding":
        """Return the same flight with the inner trajectory fitted to `model`."""
        return replace(self, flight=fitted(self.flight, model))
