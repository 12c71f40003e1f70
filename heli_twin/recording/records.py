"""Messages, events, committed plans, turns of planners, attachments and the ending of a flight log."""

from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple, get_args

from controllers.coordinations import CommittedPlan
from heli_twin.recording.schema import Severity
from heli_twin.terminal_text import clean


class Event(NamedTuple):
    """`/events`: something a person wants to know."""

    time: int
    """ns."""
    severity: Severity
    name: str
    text: str


class Attachment(NamedTuple):
    """A file in the log."""

    name: str
    media_type: str
    data: bytes

    def __repr__(self) -> str:
        return f"Attachment({clean(self.name, 60)!r}, {len(self.data)} bytes)"


class Messages(NamedTuple):
    """The messages of one topic, in the order of the file."""

    times: Sequence[int]
    """Log times, ns."""
    data: Sequence[bytes | memoryview]

    def __repr__(self) -> str:
        span = f" from {1e-9 * self.times[0]:g} to {1e-9 * self.times[-1]:g} s" if self.times else ""
        return f"Messages({len(self.times)}{span})"


OutcomeKind = Literal[
    "completed",
    "landed",
    "crashed",
    "collided",
    "left_volume",
    "diverged",
    "invalid",
    "aborted",
    "interrupted",
    "imported",
    "unknown",
]
"""Outcomes of a flight. `landed`: the supervisor ended it early; `collided`: it touched another helicopter; `invalid`:
the process of the control law failed, so that the flight has no digest and says nothing about the law; `aborted`: the
program raised; `interrupted`: the log was recovered and does not say; `imported`: a recording of poses; `unknown`: none
that this version knows."""
OUTCOMES: Mapping[str, OutcomeKind] = {kind: kind for kind in get_args(OutcomeKind)}

Origin = Literal["flight", "import", "resolve", "unknown"]
"""The program that wrote a log: a flight of the twin, `heli-twin import`, or `heli-twin resolve`."""
ORIGINS: Mapping[str, Origin] = {origin: origin for origin in get_args(Origin)}
ORIGIN_KEY = "origin"
"""Key of the origin in a log's metadata; a flight has none."""


class Ending(NamedTuple):
    """The end of a flight: outcome, time and reason."""

    outcome: OutcomeKind = "unknown"
    time: int = 0
    """Simulated, ns."""
    text: str = ""
    """One sentence; empty if the log has none."""
    digest: str = ""
    """SHA-256 of the experiment and of every message but the measured times."""
    error: str = ""
    """The exception that aborted the flight."""
    recovered: bool = False
    """True for a log that is the intact part of a damaged one."""


class ShipRecord(NamedTuple):
    """Metadata and ending of one of several helicopters in a log of all."""

    metadata: Mapping[str, str]
    ending: Ending


class Committed(NamedTuple):
    """A plan that one of several helicopters flew from a time on."""

    time: int
    """ns."""
    plan: CommittedPlan | None
    """None for its wish, the trajectory of its experiment."""


class Turn(NamedTuple):
    """A turn of the planner of one of several helicopters: its outcome, effort and messages."""

    time: int
    """ns."""
    outcome: str
    """`committed`, `kept` or `refused`."""
    reason: str
    """In a few words."""
    is_stuck: bool
    iterations: int
    """Of the solver."""
    sent: int
    """Messages to each other helicopter."""
    received: int
    """Messages since the last turn."""
