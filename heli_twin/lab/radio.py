"""The wire from the ground station to the helicopter: a framed, quantised, lossy transmitter."""

from dataclasses import dataclass
from typing import Annotated, Literal, NamedTuple, Protocol

import numpy as np
from annotated_types import Ge, Le, Unit, doc

from controllers.signals import Array, Command, nanoseconds
from heli_twin.lab.chance import blocks

NEVER_NS = 1 << 62
"""A time that no flight reaches."""


class Held(NamedTuple):
    """The command that the receiver holds from now on."""

    stamp: int
    """When the ground station decided it, ns; -1 for the trim it started with."""
    u: Array
    """(4,) inputs."""


class Turn(NamedTuple):
    """The place of a helicopter among those that one transmitter serves in turn."""

    number: int
    """From 0."""
    of: int
    """Number of helicopters that the transmitter serves."""


class Radio(Protocol):
    """A radio link in flight."""

    due: int
    """When the receiver can next take over a command, ns."""

    def send(self, at: int, command: Command) -> None:
        """Hand a command over to the transmitter; it is ready at `at` (ns)."""
        ...

    def receive(self, now: int) -> Held | None:
        """Return the newest command that has arrived until `now` (ns); None if there is none."""
        ...


class RadioSpec(Protocol):
    """A radio link as a value."""

    def start(self, rng: np.random.Generator) -> Radio:
        """A link for one flight."""
        ...


@dataclass(frozen=True, slots=True)
class Dsm2:
    """A DSM2-like link: each frame carries the newest command, quantised; a lost frame leaves the last one in force.

    Frames and control steps are not synchronised: a command waits up to a frame, and now and then one is
    overwritten before it is sent. Without commands for `failsafe`, the receiver centres the sticks and gives the
    motors `failsafe_thrust`, until the next command. Defaults: Spektrum DM module at 22 ms and 10 bit, counts 170-852;
    the time of the failsafe is an engineering estimate.
    """

    kind: Literal["dsm2"] = "dsm2"
    frame_period: Annotated[float, Ge(0.001), Le(1), Unit("s"), doc("time between two frames")] = 0.022
    latency: Annotated[float, Ge(0), Le(1), Unit("s"), doc("serial line and air time of a frame")] = 0.005
    levels: Annotated[int, Ge(2), doc("steps between full stick one way and the other")] = 682
    loss: Annotated[float, Ge(0), Le(1), doc("share of frames lost")] = 0.003
    failsafe: Annotated[
        float, Ge(0), Le(3600), Unit("s"), doc("time without commands, then the receiver's own; 0: never")
    ] = 1.0
    failsafe_thrust: Annotated[float, Ge(0), Le(1), Unit("full stick"), doc("for the motors in failsafe")] = 0.0

    def start(self, rng: np.random.Generator) -> "Dsm2Link":
        """A link for one flight."""
        period = nanoseconds(self.frame_period)
        return Dsm2Link(self, rng, int(rng.integers(period)), period)

    def start_in_turn(self, rng: np.random.Generator, shared: np.random.Generator, turn: Turn) -> "Dsm2Link":
        """A link for one of several helicopters, to which one transmitter sends its frames in turn.

        Args:
            rng: Source of its lost frames.
            shared: Source of the phase of the frames; the same numbers for all of them.
            turn: Its place among them.
        """
        period = nanoseconds(self.frame_period)
        return Dsm2Link(self, rng, int(shared.integers(period)) + turn.number * period, turn.of * period)


class Dsm2Link:
    """The link of one flight."""

    def __init__(self, spec: Dsm2, rng: np.random.Generator, first: int, period: int) -> None:
        """Begin at time 0.

        Args:
            spec: What it is.
            rng: Source of its lost frames.
            first: When the first frame is sent, ns.
            period: Time between two frames, ns.
        """
        self._spec, self._half = spec, 0.5 * spec.levels
        self._period, self._latency = period, nanoseconds(spec.latency)
        self._frame = first
        self._waiting: list[tuple[int, Held]] = []
        self.due = self._frame + self._latency
        self._failsafe = nanoseconds(spec.failsafe) or NEVER_NS
        self._failsafe_at = self._failsafe
        # Drawn for every frame, sent or not: chance must not depend on what the controller did.
        self._losses = (lost for block in blocks(rng.random) for lost in (block < spec.loss).tolist())

    def send(self, at: int, command: Command) -> None:
        """Queue a command for the first frame at or after `at`."""
        half = self._half
        self._waiting.append((at, Held(command.stamp, np.rint(command.u * half) / half)))

    def receive(self, now: int) -> Held | None:
        """The newest command that a frame received until `now` carries."""
        held = None
        while self.due <= now:
            if not next(self._losses):
                ready = [i for i, (at, _) in enumerate(self._waiting) if at <= self._frame]
                if ready:
                    held = self._waiting[ready[-1]][1]
                    # Older commands are dropped too, ready or not: a late command must not replace a newer one.
                    del self._waiting[: ready[-1] + 1]
            self._frame += self._period
            self.due = self._frame + self._latency
        if held:
            self._failsafe_at = now + self._failsafe
        elif now >= self._failsafe_at:
            self._failsafe_at = NEVER_NS
            held = Held(-1, np.array([0.0, 0.0, self._spec.failsafe_thrust, 0.0]))
        return held


@dataclass(frozen=True, slots=True)
class NoRadio:
    """No radio: a command acts, unquantised, as soon as it is ready."""

    kind: Literal["off"] = "off"

    def start(self, rng: np.random.Generator) -> "Wire":
        """A wire for one flight."""
        return Wire()


class Wire:
    """A link without frames, loss or latency."""

    def __init__(self) -> None:
        self._waiting: list[tuple[int, Held]] = []
        self.due = NEVER_NS

    def send(self, at: int, command: Command) -> None:
        """Let the command act at `at`."""
        self._waiting.append((at, Held(command.stamp, command.u)))
        self.due = self._waiting[0][0]

    def receive(self, now: int) -> Held | None:
        """The newest command that is ready at `now`."""
        held = None
        while self.due <= now:
            held = self._waiting.pop(0)[1]
            self.due = self._waiting[0][0] if self._waiting else NEVER_NS
        return held
