"""From poses to states. One file here is one estimator; it is found by its `kind` and needs no registry."""

from typing import Protocol

from controllers.model import Model
from controllers.signals import Array, Estimate, Pose


class Estimator(Protocol):
    """An estimator in flight. It dies with the flight."""

    def receive(self, now: int, pose: Pose) -> None:
        """Take in a pose that arrived at `now` (ns)."""
        ...

    def command_sent(self, now: int, u: Array) -> None:
        """Remember that the input u (4,) was decided at `now` (ns)."""
        ...

    def estimate(self, now: int) -> Estimate | None:
        """The state to control from, or None before the first usable pose."""
        ...


class EstimatorSpec(Protocol):
    """An estimator as a value. A frozen dataclass with a literal `kind`."""

    @property
    def lead(self) -> float:
        """How far ahead of the control time its estimates hold, s."""
        ...

    def start(self, model: Model) -> Estimator:
        """An estimator for one flight that believes in `model`."""
        ...
