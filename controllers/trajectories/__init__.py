"""Planned flights. One file here is one family; it is found by its `kind` and needs no registry.

A trajectory is a frozen dataclass with a literal `kind` and a method `flat(t)`: times (n,) in s to the flat
outputs and their first two derivatives, for every t >= 0, also beyond the end of the flight.
"""

from typing import Protocol, runtime_checkable

from controllers.flatness import FlatOutput
from controllers.model import Model
from controllers.signals import Array


class Trajectory(Protocol):
    """A planned flight as a value."""

    def flat(self, t: Array) -> FlatOutput:
        """Flat outputs at the times t (n,), s, each (n, 4)."""
        ...


@runtime_checkable
class OpenTrajectory(Trajectory, Protocol):
    """A planned flight that leaves something for the believed limits to decide."""

    def fitted(self, model: Model) -> Trajectory:
        """The flight as `model` can fly it."""
        ...


def fitted(trajectory: Trajectory, model: Model) -> Trajectory:
    """The trajectory with everything decided that it leaves to the believed helicopter."""
    return trajectory.fitted(model) if isinstance(trajectory, OpenTrajectory) else trajectory
