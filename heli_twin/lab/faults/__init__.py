"""Faults: what breaks. One file is one fault; it is found by its `kind`, without a registry.

A fault hooks the wires it breaks, each of them between two parts of the loop: what the cameras see, poses on their way
to the ground station, the estimate on its way to the controller, commands on their way to the radio, the time of a
control step, the command that the receiver takes over, the inputs of the actuators, the on-board gyro, or what the
battery tells. The log has each wire as the fault leaves it; what acts on the actuators shows in the truth. Most faults
have a `start` and a `duration`; with a `rate` they come by chance from `start` on.
"""

from bisect import bisect_right
from collections.abc import Callable, Iterable, Sequence
from typing import Annotated, NamedTuple, Protocol

import numpy as np
from annotated_types import Ge, Le, Unit, doc

from controllers.signals import Array, Command, Estimate, nanoseconds
from heli_twin.lab.mocap import Arrival
from heli_twin.lab.plant import Battery, Plant, Truth
from heli_twin.lab.radio import Held

Start = Annotated[float, Ge(0), Le(36_000), Unit("s"), doc("when it begins")]
Duration = Annotated[float, Ge(0), Le(36_000), Unit("s"), doc("how long it lasts")]
Rate = Annotated[float, Ge(0), Le(10), Unit("1/s"), doc("how often it comes by chance from `start` on; 0: once")]


class Hooks(NamedTuple):
    """The effect of a fault on each wire; a wire that it leaves alone has None. Times are in ns."""

    pose: Callable[[Arrival], Arrival | None] | None = None
    """Changes a pose when the cameras have seen it; None if it is lost."""
    estimate: Callable[[int, Estimate], Estimate | None] | None = None
    """Takes the time of a control step and its estimate; returns what the controller is given, None for nothing."""
    command: Callable[[int, Command], list[tuple[int, Command]]] | None = None
    """Takes when a command is ready, and the command; returns what the radio is given instead."""
    latency: Callable[[int, int], int] | None = None
    """Takes the time of a control step and its latency; returns its latency."""
    received: Callable[[int, Held], Held | None] | None = None
    """Takes the time and the command that the receiver takes over; returns what it holds, None to keep the last."""
    input: Callable[[int, Array, Truth], Array] | None = None
    """Takes the time, the input (4,) that the receiver holds and the helicopter's state, in which `actuators` are where
    servos, rotors and yaw drive are; returns the input (4,) that acts on them."""
    gyro: Callable[[int], bool] | None = None
    """Takes the time; returns whether the on-board rate gyro works."""
    battery: Callable[[int, Battery], Battery | None] | None = None
    """Takes the time and what the battery is; returns what it tells the ground station, None for nothing."""
    seen: Callable[[int, Truth, Sequence[Truth]], Truth] | None = None
    """Takes the time, the helicopter, and the others in the room; returns which the cameras take for it."""


class Fault(Protocol):
    """A fault as a value. A frozen dataclass with a literal `kind`."""

    @property
    def kind(self) -> str:
        """Its name."""
        ...

    def hooks(self, rng: np.random.Generator) -> Hooks:
        """Return what it does on the wires of one flight."""
        ...


class Faults:
    """All faults of one flight together; each hooks the wire that those before it have left."""

    def __init__(self, faults: Iterable[Hooks]) -> None:
        self._faults = [*faults]
        self._input = [fault.input for fault in self._faults if fault.input]
        self._gyro = [fault.gyro for fault in self._faults if fault.gyro]
        self._estimate = [fault.estimate for fault in self._faults if fault.estimate]
        self._received = [fault.received for fault in self._faults if fault.received]
        self._battery = [fault.battery for fault in self._faults if fault.battery]
        self._seen = [fault.seen for fault in self._faults if fault.seen]

    def seen(self, t: int, truth: Truth, others: Sequence[Truth]) -> Truth:
        """Return which helicopter the cameras take for this one."""
        for fault in self._seen:
            truth = fault(t, truth, others)
        return truth

    def pose(self, arrival: Arrival | None) -> Arrival | None:
        """Return a pose as the ground station will get it; None if it is lost."""
        for fault in self._faults:
            if arrival and fault.pose:
                arrival = fault.pose(arrival)
        return arrival

    def estimate(self, t: int, estimate: Estimate | None) -> Estimate | None:
        """Return an estimate as the controller will get it; None if there is none."""
        for fault in self._estimate:
            estimate = fault(t, estimate) if estimate else None
        return estimate

    def received(self, t: int, held: Held | None) -> Held | None:
        """Return what the receiver holds from `t` on; None if it keeps the last."""
        for fault in self._received:
            held = fault(t, held) if held else None
        return held

    def battery(self, t: int, battery: Battery | None) -> Battery | None:
        """Return what the battery tells; None for nothing."""
        for fault in self._battery:
            battery = fault(t, battery) if battery else None
        return battery

    def commands(self, t: int, latency: int, command: Command) -> list[tuple[int, Command]]:
        """Return what reaches the radio of a command of the control step at `t`, and when."""
        for fault in self._faults:
            if fault.latency:
                latency = fault.latency(t, latency)
        sent = [(t + latency, command)]
        for fault in self._faults:
            if fault.command:
                sent = [changed for each in sent for changed in fault.command(*each)]
        return sent

    def input(self, t: int, u: Array, plant: Plant) -> Array:
        """Return the input (4,) that acts at the helicopter from `t` on, and switch its gyro."""
        for fault in self._input:
            u = fault(t, u, plant.truth())
        if self._gyro:
            working = [works(t) for works in self._gyro]
            plant.gyro_works = all(working)
        return u


class Timed(Protocol):
    """A fault that comes and goes."""

    @property
    def start(self) -> float:
        """When it begins, s."""
        ...

    @property
    def duration(self) -> float:
        """Its duration, s."""
        ...

    @property
    def rate(self) -> float:
        """Its rate by chance, 1/s; 0: it comes once, at its start."""
        ...


class Spells:
    """The times at which a fault is there."""

    def __init__(self, fault: Timed, rng: np.random.Generator) -> None:
        self._rng, self._rate = rng, fault.rate
        self._duration = nanoseconds(fault.duration)
        self._first = nanoseconds(fault.start)
        self._starts: list[int] = [] if fault.rate else [self._first]

    def began(self, t: int) -> int | None:
        """Return when the spell that lasts at `t` began, ns; None if there is none."""
        while self._rate and (not self._starts or self._starts[-1] <= t):
            last = self._starts[-1] if self._starts else self._first
            self._starts.append(last + nanoseconds(self._rng.exponential(1.0 / self._rate)))
        newest = bisect_right(self._starts, t) - 1
        return self._starts[newest] if newest >= 0 and t < self._starts[newest] + self._duration else None
