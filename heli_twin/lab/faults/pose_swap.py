"""The tracker takes one marker for another: the pose jumps."""

from dataclasses import dataclass
from math import cos, sin
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Le, Unit, doc

from controllers.signals import Array, Pose
from heli_twin.lab.faults import Duration, Hooks, Rate, Spells, Start
from heli_twin.lab.mocap import Arrival


@dataclass(frozen=True, slots=True)
class PoseSwap:
    """Positions displaced by `size` in a level direction drawn for the flight, and attitudes turned, for a while.

    Source: swaps of 1 to 5 cm and 10 to 40 degrees, in 0.1 % of the frames, are usual; larger ones happen when two
    rigid bodies are exchanged.
    """

    kind: Literal["pose_swap"] = "pose_swap"
    start: Start = 5.0
    duration: Duration = 0.3
    rate: Rate = 0.0
    size: Annotated[float, Ge(0), Le(5), Unit("m"), doc("displacement of the position")] = 0.3
    turn: Annotated[float, Ge(-3.2), Le(3.2), Unit("rad"), doc("turn of the attitude about the mast")] = 0.0

    def hooks(self, rng: np.random.Generator) -> Hooks:
        """Displace and turn the pose."""
        direction = rng.uniform(-np.pi, np.pi)
        jump = self.size * np.array([cos(direction), sin(direction), 0.0])
        spells = Spells(self, rng)

        def pose(arrival: Arrival) -> Arrival:
            if spells.began(arrival.pose.stamp) is None:
                return arrival
            stamp, position, quat_wxyz = arrival.pose
            return Arrival(arrival.at, Pose(stamp, position + jump, turned_about_mast(quat_wxyz, self.turn)))

        return Hooks(pose=pose)


def turned_about_mast(quat_wxyz: Array, angle: float) -> Array:
    """Rotate an attitude (4,) by an angle (rad) about the body's z axis."""
    w, x, y, z = quat_wxyz.tolist()
    c, s = cos(0.5 * angle), sin(0.5 * angle)
    return np.array((c * w - s * z, c * x + s * y, c * y - s * x, c * z + s * w))
