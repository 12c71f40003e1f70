"""The ground station's computer stalls."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from controllers.signals import nanoseconds
from heli_twin.lab.faults import Duration, Hooks, Rate, Spells, Start


@dataclass(frozen=True, slots=True)
class ComputeStall:
    """Commands of control steps in the fault are ready only after its end; a garbage collection may take 100 ms."""

    kind: Literal["compute_stall"] = "compute_stall"
    start: Start = 5.0
    duration: Duration = 0.1
    rate: Rate = 0.0

    def hooks(self, rng: np.random.Generator) -> Hooks:
        """Add what is left of the fault to the latency."""
        spells, duration = Spells(self, rng), nanoseconds(self.duration)

        def latency(t: int, latency: int) -> int:
            began = spells.began(t)
            return latency if began is None else began + duration - t + latency

        return Hooks(latency=latency)
