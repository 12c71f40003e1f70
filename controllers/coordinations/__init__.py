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
    """A broadcast from one ground station to all others, over the network of the room."""

    sender: str
    stamp: int
    """Time of sending, ns since the common start."""
    body: Any
    """Plans and flags, of a frozen type that each kind of coordination defines."""
    size: int
    """Length of the body on the network, bytes."""


Outcome = Literal["committed", "kept", "refused"]
OUTCOMES: tuple[Outcome, ...] = get_args(Outcome)


class Note(NamedTuple):
    """Result of one turn of a planner."""

    outcome: Outcome
    """`committed`: a new plan; `kept`: the old one, no other was tried; `refused`: the old one, the new too near."""
    reason: str = ""
    """Reason of the outcome in a few words; empty if the plan follows the wish."""
    is_stuck: bool = False
    """The helicopter stands where it does not want to be."""
    iterations: int = 0
    """Newton iterations of ProxQP."""
    solve_ns: int = 0
    """Measured wall time of ProxQP, ns; only logged."""


class Planner(Protocol):
    """The planner of one helicopter during one flight."""

    committed: Trajectory
    """The reference of the flight: positions in m, world, over s since the common start. A new plan is a new object."""
    due: int
    """Time of the next turn, ns since the common start."""
    note: Note
    """Result of the last turn."""

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
