"""The network between ground stations: every message goes to all others, late, and some are lost."""

from collections.abc import Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Annotated, Literal, NamedTuple

import numpy as np
from annotated_types import Ge, Le, Unit, doc

from controllers.coordinations import Message
from controllers.signals import nanoseconds
from heli_twin.lab.chance import blocks


class Delivery(NamedTuple):
    """A message at one receiver."""

    at: int
    """When it arrives, ns."""
    receiver: str
    message: Message


@dataclass(frozen=True, slots=True)
class Network:
    """A local network: messages arrive in any order, and each is lost or late for each receiver by itself.

    An outage is a time in which nobody hears anybody. The defaults are those of a wired network.
    """

    kind: Literal["network"] = "network"
    delay: Annotated[float, Ge(0), Le(10), Unit("s"), doc("least time from sender to receiver")] = 0.0005
    jitter: Annotated[float, Ge(0), Le(10), Unit("s"), doc("mean of the further, exponential delay")] = 0.0001
    loss: Annotated[float, Ge(0), Le(1), doc("share of messages lost, for each receiver by itself")] = 0.0
    outage_start: Annotated[float, Ge(0), Le(36_000), Unit("s"), doc("when an outage begins")] = 0.0
    outage: Annotated[float, Ge(0), Le(36_000), Unit("s"), doc("its duration; 0 for none")] = 0.0

    def start(self, names: Sequence[str], rng: np.random.Generator) -> "NetworkInFlight":
        """Return the network of one flight.

        Args:
            names: Of all ground stations.
            rng: Source of losses and delays.
        """
        return NetworkInFlight(self, names, rng)


class NetworkInFlight:
    """The network of one flight."""

    def __init__(self, spec: Network, names: Sequence[str], rng: np.random.Generator) -> None:
        self._spec, self._names = spec, sorted(names)
        self._delay = nanoseconds(spec.delay)
        begins = nanoseconds(spec.outage_start)
        self._outage = range(begins, begins + nanoseconds(spec.outage))
        # For every message and name, lost or not, the sender's too: chance must not depend on what is sent to whom.
        self._draws = (row for block in blocks(rng.random, len(self._names), 2) for row in block.tolist())
        self._under_way: list[Delivery] = []

    def send(self, now: int, message: Message) -> None:
        """Put a message on the way to all others at `now` (ns)."""
        for name, (lost, late) in zip(self._names, next(self._draws), strict=True):
            if name != message.sender and lost >= self._spec.loss and now not in self._outage:
                jitter = nanoseconds(-self._spec.jitter * float(np.log1p(-late)))
                self._under_way.append(Delivery(now + self._delay + jitter, name, message))

    def arrived(self, now: int) -> list[Delivery]:
        """Return what has arrived until `now` (ns), in the order of arrival, and forget it."""
        arrived = sorted((d for d in self._under_way if d.at <= now), key=itemgetter(0))
        self._under_way = [d for d in self._under_way if d.at > now]
        return arrived
