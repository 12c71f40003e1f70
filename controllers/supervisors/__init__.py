"""Supervisors: who decides whether the plan is flown. One file here is one supervisor, found by its `kind`.

A supervisor sees what the ground station sees: estimates, the age of the poses in them, how control problems were
solved, and its own commands. It never sees the truth.
"""

from typing import Literal, NamedTuple, Protocol, get_args, runtime_checkable

from controllers.model import Model
from controllers.signals import Command, Estimate, Reference

Phase = Literal["ready", "flying", "coasting", "levelling", "landing", "landed"]
PHASES: tuple[Phase, ...] = get_args(Phase)


class PhaseChange(NamedTuple):
    """A change of phase."""

    severity: Literal["info", "warning"]
    phase: Phase
    reason: str
    """One sentence."""


class Order(NamedTuple):
    """The order of a supervisor for one control step."""

    reference: Reference | None = None
    """For the controller, from the estimate's stamp on; None before the first estimate."""
    command: Command | None = None
    """Sent instead of the controller's."""
    thrust: float | None = None
    """Input u_z to send instead of the controller's, with its other inputs."""
    event: PhaseChange | None = None

    def applied(self, command: Command) -> Command:
        """Return the controller's command with the ordered thrust."""
        if self.thrust is None:
            return command
        u = command.u.copy()
        u[2] = self.thrust
        return command._replace(u=u)


class Supervisor(Protocol):
    """The supervisor of one flight."""

    phase: Phase

    def order(self, now: int, estimate: Estimate | None, plan: Reference) -> Order:
        """Decide what to fly.

        Args:
            now: Control time, ns.
            estimate: The state at the time when a command of this step acts; None before the first pose.
            plan: The planned flight, from the estimate's stamp on.
        """
        ...

    def battery(self, voltage: float) -> None:
        """Take note of the voltage (V) that the helicopter tells, if it tells any."""
        ...

    def sent(self, command: Command) -> None:
        """Take note of the command that was sent, and of how its control problem was solved."""
        ...


@runtime_checkable
class LandsOnPlan(Protocol):
    """A supervisor that can stop and land along the plan, in place of where the helicopter is.

    For several helicopters in one room, whose planners bring a helicopter that cannot go on to rest, clear of others.
    """

    lands_on_plan: bool


class SupervisorSpec(Protocol):
    """The value that says which supervisor watches a flight: a frozen dataclass with a literal `kind`."""

    @property
    def kind(self) -> str:
        """Its name."""
        ...

    def start(self, model: Model, period: float) -> Supervisor:
        """Make the supervisor of one flight.

        Args:
            model: The believed helicopter.
            period: Control period, s.
        """
        ...
