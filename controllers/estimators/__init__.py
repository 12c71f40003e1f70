"""Estimators: from poses to states. One file here is one estimator; it is found by its `kind`, without a registry."""

from typing import Protocol

from controllers.model import Model
from controllers.signals import Array, Estimate, Pose


class Estimator(Protocol):
    """The estimator of one flight."""

    def receive(self, now: int, pose: Pose) -> None:
        """Use a pose that arrived at `now` (ns), or refuse it."""
        ...

    def command_sent(self, now: int, u: Array) -> None:
        """Remember that the input u (4,) was decided at `now` (ns)."""
        ...

    def estimate(self, now: int) -> Estimate | None:
        """The state to control from at `now` (ns); None before the first usable pose."""
        ...


class EstimatorSpec(Protocol):
    """The value that says which estimator to use: a frozen dataclass with a literal `kind`."""

    @property
    def lead(self) -> float:
        """Time from the control step to the moment its estimates hold for, s."""
        ...

    def start(self, model: Model) -> Estimator:
        """Make the estimator of one flight.

        Args:
            model: The believed helicopter.
        """
        ...
