"""The calibration of the cameras drifts."""

from dataclasses import dataclass
from math import cos, sin
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Le, Unit, doc

from controllers.signals import Pose
from heli_twin.lab.faults import Duration, Hooks, Rate, Spells, Start
from heli_twin.lab.faults.pose_swap import turned_about_mast
from heli_twin.lab.mocap import Arrival


@dataclass(frozen=True, slots=True)
class PoseDrift:
    """Positions and headings that move away at a constant speed, in a level direction drawn for the flight.

    When the fault ends, the calibration is right again.
    """

    kind: Literal["pose_drift"] = "pose_drift"
    start: Start = 5.0
    duration: Duration = 20.0
    rate: Rate = 0.0
    speed: Annotated[float, Ge(0), Le(1), Unit("m/s"), doc("drift of the position")] = 0.002
    turn: Annotated[float, Ge(-1), Le(1), Unit("rad/s"), doc("drift of the heading")] = 0.001

    def hooks(self, rng: np.random.Generator) -> Hooks:
        """Displace and turn the pose more and more."""
        direction = rng.uniform(-np.pi, np.pi)
        velocity = self.speed * np.array([cos(direction), sin(direction), 0.0])
        spells = Spells(self, rng)

        def pose(arrival: Arrival) -> Arrival:
            began = spells.began(arrival.pose.stamp)
            if began is None:
                return arrival
            stamp, position, quat_wxyz = arrival.pose
            since = 1e-9 * (stamp - began)
            attitude = turned_about_mast(quat_wxyz, self.turn * since)
            return Arrival(arrival.at, Pose(stamp, position + velocity * since, attitude))

        return Hooks(pose=pose)
