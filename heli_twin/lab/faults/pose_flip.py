"""The tracker takes the tail for the nose."""

from dataclasses import dataclass
from math import pi
from typing import Literal

import numpy as np

from heli_twin.lab.faults import Duration, Hooks, Rate, Spells, Start
from heli_twin.lab.faults.pose_swap import turned_about_mast
from heli_twin.lab.mocap import Arrival


@dataclass(frozen=True, slots=True)
class PoseFlip:
    """Attitudes turned by 180 degrees about the mast for a while: the markers are nearly symmetric."""

    kind: Literal["pose_flip"] = "pose_flip"
    start: Start = 5.0
    duration: Duration = 0.2
    rate: Rate = 0.0

    def hooks(self, rng: np.random.Generator) -> Hooks:
        """Turn the attitude."""
        spells = Spells(self, rng)

        def pose(arrival: Arrival) -> Arrival:
            if spells.began(arrival.pose.stamp) is None:
                return arrival
            flipped = turned_about_mast(arrival.pose.quat_wxyz, pi)
            return Arrival(arrival.at, arrival.pose._replace(quat_wxyz=flipped))

        return Hooks(pose=pose)
