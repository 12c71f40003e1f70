"""The tracker repeats its last pose with new stamps."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from controllers.signals import Pose
from heli_twin.lab.faults import Duration, Hooks, Rate, Spells, Start
from heli_twin.lab.mocap import Arrival


@dataclass(frozen=True, slots=True)
class PoseFrozen:
    """Poses that are bit-identical to the last one before the fault, each with its own stamp."""

    kind: Literal["pose_frozen"] = "pose_frozen"
    start: Start = 5.0
    duration: Duration = 0.5
    rate: Rate = 0.0

    def hooks(self, rng: np.random.Generator) -> Hooks:
        """Repeat the last pose."""
        spells = Spells(self, rng)
        last: Pose | None = None

        def pose(arrival: Arrival) -> Arrival:
            nonlocal last
            if last is None or spells.began(arrival.pose.stamp) is None:
                last = arrival.pose
            return Arrival(arrival.at, last._replace(stamp=arrival.pose.stamp))

        return Hooks(pose=pose)
