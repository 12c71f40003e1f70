"""No supervisor: the plan is flown, whatever happens."""

from dataclasses import dataclass
from typing import Literal

from controllers.model import Model
from controllers.signals import Command, Estimate, Reference
from controllers.supervisors import Order, Phase


@dataclass(frozen=True, slots=True)
class NoSupervisor:
    """The plan is flown from its start to the end of the flight."""

    kind: Literal["off"] = "off"

    def start(self, model: Model, period: float) -> "PlanFollower":
        """Make the supervisor of one flight."""
        return PlanFollower()


class PlanFollower:
    """Hands the plan to the controller."""

    phase: Phase = "flying"

    def order(self, now: int, estimate: Estimate | None, plan: Reference) -> Order:
        """Return the plan."""
        return Order(plan if estimate else None)

    def battery(self, voltage: float) -> None:
        """Take no note of it."""

    def sent(self, command: Command) -> None:
        """Take no note of it."""
