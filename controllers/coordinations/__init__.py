"""Coordinations: how several helicopters in one room keep out of each other's way. One file here is one kind.

Each helicopter has a planner in its own ground station. Planners know all wishes before take-off, and in flight only
what they tell each other in messages. A planner commits to a plan, which its helicopter then flies: a trajectory that
ends at rest, so that it stays safe if no other follows.

All planners read one clock. Each has its turns at times that all know.
"""

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple, Protocol, get_args

from controllers.committed_plan import CommittedPlan
from controllers.model import Model
from controllers.signals import Estimate
from controllers.trajectories import Trajectory

__all__ = ["OUTCOMES", "CommittedPlan", "Coordination", "Message", "Note", "Outcome", "Planner", "Ship"]


class Ship(NamedTuple):
    """A helicopter as all ground stations know it before take-off."""

    name: str
    wish: Trajectory
    """The flight that it wants, in s since the common start, as `controllers.trajectories.fitted` returns it."""
    model: Model
    """As its ground station believes it to be."""


class Message(NamedTuple):
    """What one ground station tells all others."""

    sender: str
    stamp: int
    """When it is sent, ns."""
    body: Any
    """A value of the coordination's own, which nobody changes."""
    size: int
    """Of the body on the network, bytes."""


Outcome = Literal["committed", "kept", "refused"]
OUTCOMES: tuple[Outcome, ...] = get_args(Outcome)


class Note(NamedTuple):
    """What a planner did in its last turn."""

    outcome: Outcome
    """A new plan was committed; the old one was kept, for nothing else was tried; or a new one was refused."""
    reason: str = ""
    """In a few words; empty if the plan is what the helicopter wants."""
    is_stuck: bool = False
    """The helicopter stands where it does not want to be."""
    iterations: int = 0
    """Newton iterations of ProxQP."""
    solve_ns: int = 0
    """Measured wall time of ProxQP, ns; only logged."""


class Planner(Protocol):
    """The planner of one helicopter during one flight."""

    committed: Trajectory
    """What the helicopter flies from now on; another object as soon as another plan is committed."""
    due: int
    """When its next turn is, ns."""
    note: Note
    """Of its last turn."""

    def receive(self, now: int, message: Message) -> None:
        """Take note of a message of another planner that arrives at `now` (ns)."""
        ...

    def act(self, now: int, estimate: Estimate | None, is_flying: bool) -> Sequence[Message]:
        """Take its turn, and return the messages to send to all others.

        Args:
            now: ns; not before `due`.
            estimate: The state of its helicopter; None before the first pose.
            is_flying: Whether the helicopter flies the committed plan. It does not on the floor, and when its
                supervisor has taken over to stop or land it.
        """
        ...


class Coordination(Protocol):
    """A coordination as a value: a frozen dataclass with a literal `kind`."""

    @property
    def kind(self) -> str:
        """Its name."""
        ...

    def planner_of(self, ship: str, ships: Sequence[Ship]) -> Planner:
        """Return the planner of one helicopter, before take-off.

        Args:
            ship: Its name.
            ships: All helicopters, it among them.

        Raises:
            ValueError: They cannot fly together; the message says why and what to change.
        """
        ...
