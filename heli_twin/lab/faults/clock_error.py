"""The clocks of the cameras and of the ground station disagree."""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Le, Unit, doc

from controllers.signals import nanoseconds
from heli_twin.lab.faults import Duration, Hooks, Rate, Spells, Start
from heli_twin.lab.mocap import Arrival


@dataclass(frozen=True, slots=True)
class ClockError:
    """Stamps of poses that are wrong by a step and a drift for a while; poses arrive when they arrive.

        stamp = true stamp + step + drift (time since the fault began)

    A stamp before the flight's start is the start.
    """

    kind: Literal["clock_error"] = "clock_error"
    start: Start = 5.0
    duration: Duration = 10.0
    rate: Rate = 0.0
    step: Annotated[float, Ge(-1), Le(1), Unit("s"), doc("how far the cameras' clock jumps ahead")] = 0.005
    drift: Annotated[float, Ge(-0.1), Le(0.1), Unit("s/s"), doc("how much faster it runs")] = 0.0001

    def hooks(self, rng: np.random.Generator) -> Hooks:
        """Change the stamps."""
        spells = Spells(self, rng)

        def pose(arrival: Arrival) -> Arrival:
            stamp = arrival.pose.stamp
            began = spells.began(stamp)
            if began is None:
                return arrival
            wrong = stamp + nanoseconds(self.step + self.drift * 1e-9 * (stamp - began))
            return arrival._replace(pose=arrival.pose._replace(stamp=max(wrong, 0)))

        return Hooks(pose=pose)
