"""The on-board rate gyro fails: nothing damps the yaw."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from heli_twin.lab.faults import Duration, Hooks, Rate, Spells, Start


@dataclass(frozen=True, slots=True)
class GyroFailure:
    """The yaw damping, which the gyro makes, is missing for a while."""

    kind: Literal["gyro_failure"] = "gyro_failure"
    start: Start = 5.0
    duration: Duration = 1.0
    rate: Rate = 0.0

    def hooks(self, rng: np.random.Generator) -> Hooks:
        """Switch the gyro."""
        spells = Spells(self, rng)

        def gyro(t: int) -> bool:
            return spells.began(t) is None

        return Hooks(gyro=gyro)
