"""The air that other helicopters blow down."""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Le, Unit, doc

from controllers.signals import Array
from heli_twin.lab.disturbances import STILL
from heli_twin.lab.plant import Air, Truth

ORIGIN_M = 1.0
"""The jet spreads as from a point so far above the rotors."""
STRENGTH_M2_S = 3.6
"""Speed on the axis of the jet, times the distance from that point."""
SPREAD = 0.08
"""Radius at which the speed is half of that on the axis, over the distance from that point."""
BEGIN_M = 0.2
"""Below the rotors the jet grows to its full strength over this distance."""
DISC = 0.067 * np.array([[0, 0], *([np.cos(a), np.sin(a)] for a in np.arange(6) * np.pi / 3)], dtype=np.float64)
"""(7, 2) points of the rotor disc over which the jet is averaged, m."""


@dataclass(frozen=True, slots=True)
class Downwash:
    """The jets below the other helicopters in the room: they take thrust, and push the fuselage down.

    A round turbulent jet: 2.4 m/s on its axis half a metre below the rotors, 1.8 m/s a metre below, half as fast 12 and
    16 cm beside the axis. It goes straight down. Of a lone helicopter it does nothing.

    Source: L. Bauersfeld et al., arXiv 2403.13321, scaled to a disc of 0.19 m; loss of thrust as of a Crazyflie. The
    heave damping of the lab's helicopter would be a loss of 0.15.
    """

    kind: Literal["downwash"] = "downwash"
    strength: Annotated[float, Ge(0), Le(10), Unit("1"), doc("factor on the speed of the jets")] = 1.0
    thrust_loss: Annotated[float, Ge(0), Le(1), Unit("s/m"), doc("share of thrust lost per m/s of the jet")] = 0.07
    push: Annotated[float, Ge(0), Le(10), Unit("1/m"), doc("downward acceleration per squared m/s of the jet")] = 0.09

    def start(self, rng: np.random.Generator) -> "DownwashInFlight":
        """Return the jets of one flight, in which nothing is random."""
        return DownwashInFlight(self)


class DownwashInFlight:
    """The jets over one helicopter."""

    def __init__(self, spec: Downwash) -> None:
        self._spec = spec

    def air(self, truth: Truth, others: Array) -> Air:
        """Return the loss of thrust and the push."""
        spec, speed = self._spec, self._spec.strength * jet(truth.position, others)
        push = np.array([0.0, 0.0, -spec.push * speed * speed])
        return Air(STILL, push, max(0.0, 1.0 - spec.thrust_loss * speed))


def jet(position: Array, others: Array) -> float:
    """Return the downward speed of the air, m/s, over the rotor disc of a helicopter: the sum of all jets.

    Args:
        position: (3,) the helicopter, world, m.
        others: (n, 3) the others; those that are not higher blow elsewhere.
    """
    below = others[:, 2] - position[2]
    above = below > 0.0
    if not above.any():
        return 0.0
    below, aside = below[above], (position[:2] - others[above, :2])[:, None] + DISC
    distance = below + ORIGIN_M
    radius = np.linalg.norm(aside, axis=2) / (SPREAD * distance)[:, None]
    # The profile of a round turbulent jet (Schlichting), in radii of half the speed.
    profile = (1.0 + (2.0**0.5 - 1.0) * radius**2) ** -2
    on_axis = STRENGTH_M2_S / distance * np.minimum(1.0, below / BEGIN_M)
    return float((on_axis * profile.mean(axis=1)).sum())
