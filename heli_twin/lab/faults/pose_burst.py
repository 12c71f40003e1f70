"""Poses pile up on the way and arrive all at once."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from controllers.signals import nanoseconds
from heli_twin.lab.faults import Duration, Hooks, Rate, Spells, Start
from heli_twin.lab.mocap import Arrival


@dataclass(frozen=True, slots=True)
class PoseBurst:
    """Poses seen in the fault arrive no earlier than its end, with their true stamps: a network that stalls."""

    kind: Literal["pose_burst"] = "pose_burst"
    start: Start = 5.0
    duration: Duration = 0.2
    rate: Rate = 0.0

    def hooks(self, rng: np.random.Generator) -> Hooks:
        """Delay the arrival."""
        spells, duration = Spells(self, rng), nanoseconds(self.duration)

        def pose(arrival: Arrival) -> Arrival:
            began = spells.began(arrival.pose.stamp)
            return arrival if began is None else arrival._replace(at=max(arrival.at, began + duration))

        return Hooks(pose=pose)
