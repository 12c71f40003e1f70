"""The tracker loses its rigid body and reports NaN."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from controllers.signals import Pose
from heli_twin.lab.faults import Duration, Hooks, Rate, Spells, Start
from heli_twin.lab.mocap import Arrival


@dataclass(frozen=True, slots=True)
class PoseNan:
    """Poses of NaN for a while."""

    kind: Literal["pose_nan"] = "pose_nan"
    start: Start = 5.0
    duration: Duration = 0.1
    rate: Rate = 0.0

    def hooks(self, rng: np.random.Generator) -> Hooks:
        """Replace position and attitude."""
        spells = Spells(self, rng)

        def pose(arrival: Arrival) -> Arrival:
            if spells.began(arrival.pose.stamp) is None:
                return arrival
            return Arrival(arrival.at, Pose(arrival.pose.stamp, np.full(3, np.nan), np.full(4, np.nan)))

        return Hooks(pose=pose)
