"""A steady push: the offset of the inputs in Fig. 4."""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Le, Unit, doc

from heli_twin.lab.disturbances import STILL
from heli_twin.lab.plant import Air, Truth


@dataclass(frozen=True, slots=True)
class Bias:
    """A constant acceleration, such as a trim that is off or a draught."""

    kind: Literal["bias"] = "bias"
    x: Annotated[float, Ge(-100), Le(100), Unit("m/s^2"), doc("push to the north")] = 0.1
    y: Annotated[float, Ge(-100), Le(100), Unit("m/s^2"), doc("push to the west")] = 0.05
    z: Annotated[float, Ge(-100), Le(100), Unit("m/s^2"), doc("push upwards")] = 0.0

    def start(self, rng: np.random.Generator) -> "Bias":
        """Return itself: a constant has no state."""
        return self

    def air(self, truth: Truth) -> Air:
        """Return the same push at all times."""
        return Air(STILL, np.array([self.x, self.y, self.z]))
