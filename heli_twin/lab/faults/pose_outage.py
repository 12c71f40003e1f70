"""The cameras lose the helicopter for a while."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from heli_twin.lab.faults import Duration, Hooks, Rate, Spells, Start
from heli_twin.lab.mocap import Arrival


@dataclass(frozen=True, slots=True)
class PoseOutage:
    """No pose at all for a while; 0.3 s is what occlusion costs in the field (PX4-Autopilot #8758)."""

    kind: Literal["pose_outage"] = "pose_outage"
    start: Start = 5.0
    duration: Duration = 0.3
    rate: Rate = 0.0

    def hooks(self, rng: np.random.Generator) -> Hooks:
        """Lose the poses."""
        spells = Spells(self, rng)

        def pose(arrival: Arrival) -> Arrival | None:
            return arrival if spells.began(arrival.pose.stamp) is None else None

        return Hooks(pose=pose)
