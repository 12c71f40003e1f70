"""The time the ground station needs to decide, as a modelled delay: measured time never changes a flight."""

from dataclasses import dataclass
from typing import Annotated, Literal, Protocol

import numpy as np
from annotated_types import Ge, Le, Unit, doc

from controllers.signals import nanoseconds


class ComputeSpec(Protocol):
    """Compute latency as a value."""

    def latency_ns(self, rng: np.random.Generator) -> int:
        """Latency of one control step, ns; drawn once a step."""
        ...


@dataclass(frozen=True, slots=True)
class Modelled:
    """A control step takes a time drawn uniformly about a mean; the paper's solver took 5 to 7 ms."""

    kind: Literal["modelled"] = "modelled"
    latency: Annotated[float, Ge(0), Le(1), Unit("s"), doc("mean time from the control step to a command")] = 0.006
    spread: Annotated[float, Ge(0), Le(1), Unit("s"), doc("greatest difference from the mean, either way")] = 0.001

    def latency_ns(self, rng: np.random.Generator) -> int:
        """A draw that is uniform about the mean and never negative."""
        return max(0, nanoseconds(self.latency + self.spread * (2.0 * rng.random() - 1.0)))


@dataclass(frozen=True, slots=True)
class NoComputeTime:
    """A command is ready the moment its control step begins."""

    kind: Literal["off"] = "off"

    def latency_ns(self, rng: np.random.Generator) -> int:
        """Zero."""
        return 0
