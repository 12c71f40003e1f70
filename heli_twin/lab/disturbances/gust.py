"""Gusts in a room: air conditioning and the helicopter's own wake."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import exp, sqrt
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt, Le, Unit, doc

from controllers.signals import Array
from heli_twin.lab.chance import blocks, coloured
from heli_twin.lab.disturbances import PERIOD_NS, STILL
from heli_twin.lab.plant import Air, Truth


@dataclass(frozen=True, slots=True)
class Gust:
    """Wind in the plane as an Ornstein-Uhlenbeck process with a fixed time constant.

    Dryden length scales make no sense in hover, where the airspeed is zero. The default strength is fitted, not
    measured: with it the helicopter of the lab, which a gust tilts, errs in hover as in Fig. 4. Without hub drag the
    same errors need 0.25 m/s.
    """

    kind: Literal["gust"] = "gust"
    strength: Annotated[float, Ge(0), Le(100), Unit("m/s"), doc("standard deviation of the wind on each axis")] = 0.095
    time: Annotated[float, Gt(0), Le(1000), Unit("s"), doc("time in which the wind changes")] = 0.7

    def start(self, rng: np.random.Generator) -> "GustInFlight":
        """Start the wind of one flight."""
        return GustInFlight(gusts(self.strength, self.time, (0, 1), rng))


class GustInFlight:
    """The wind of one flight.

    Args:
        winds: (3,) of each period, world, m/s.
    """

    def __init__(self, winds: Iterator[Array]) -> None:
        self._winds = winds

    def air(self, truth: Truth) -> Air:
        """Return the wind of the next period."""
        return Air(next(self._winds), STILL)


def gusts(strength: float, time: float, axes: Sequence[int], rng: np.random.Generator) -> Iterator[Array]:
    """Yield the wind (3,) of each period, m/s: a stationary Ornstein-Uhlenbeck process.

    Args:
        strength: Standard deviation of the wind on each of the axes, m/s.
        time: Time constant, s.
        axes: Indices of the axes of the world on which it blows.
        rng: Source of its normal numbers.
    """
    keep, axes = exp(-1e-9 * PERIOD_NS / time), list(axes)
    last = strength * rng.standard_normal(len(axes))
    for normals in blocks(rng.standard_normal, len(axes)):
        winds = np.zeros((len(normals), 3))
        winds[:, axes] = coloured(last, keep, strength * sqrt(1.0 - keep**2) * normals)
        last = winds[-1, axes]
        yield from winds
