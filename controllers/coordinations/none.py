"""No coordination: each helicopter flies what it wants."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from controllers.coordinations import Message, Note, Ship
from controllers.signals import Estimate

NEVER_NS = 1 << 62
"""A time that no flight reaches."""


@dataclass(frozen=True, slots=True)
class NoCoordination:
    """Each helicopter flies its own trajectory, and nobody tells anybody anything."""

    kind: Literal["none"] = "none"

    def planner_of(self, ship: str, ships: Sequence[Ship]) -> "NoPlanner":
        """Return a planner that commits the wish before take-off and has no turns."""
        return NoPlanner(next(each for each in ships if each.name == ship))


class NoPlanner:
    """The planner of one helicopter that flies its wish."""

    def __init__(self, ship: Ship) -> None:
        self.committed, self.due, self.note = ship.wish, NEVER_NS, Note("kept")

    def receive(self, now: int, message: Message) -> None:
        """Nobody sends any."""

    def act(self, now: int, estimate: Estimate | None, is_flying: bool) -> Sequence[Message]:
        """Return no messages."""
        return ()
