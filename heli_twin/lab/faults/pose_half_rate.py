"""The cameras deliver only some of their frames."""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Le, doc

from heli_twin.lab.faults import Duration, Hooks, Rate, Spells, Start
from heli_twin.lab.mocap import Arrival


@dataclass(frozen=True, slots=True)
class PoseHalfRate:
    """One frame in `every` for a while, as when the cameras' computer is busy."""

    kind: Literal["pose_half_rate"] = "pose_half_rate"
    start: Start = 5.0
    duration: Duration = 10.0
    rate: Rate = 0.0
    every: Annotated[int, Ge(1), Le(100), doc("frames of which one is delivered")] = 2

    def hooks(self, rng: np.random.Generator) -> Hooks:
        """Count frames, and lose all but one in `every`."""
        spells = Spells(self, rng)
        frame = 0

        def pose(arrival: Arrival) -> Arrival | None:
            nonlocal frame
            frame += 1
            return arrival if frame % self.every == 0 or spells.began(arrival.pose.stamp) is None else None

        return Hooks(pose=pose)
