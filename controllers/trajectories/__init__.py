"""Planned flights. One file here is one kind of trajectory, selected by its `kind`; there is no registry to edit.

A trajectory is a frozen dataclass with a literal `kind` and a method `flat(t)`: it returns the flat outputs and
their first two derivatives at the times t (n,), s, for every t >= 0, also after the end of the flight.
"""

from typing import Protocol, runtime_checkable

from controllers.flatness import FlatOutput
from controllers.model import Model
from controllers.signals import Array


class Trajectory(Protocol):
    """A planned flight as a value."""

    def flat(self, t: Array) -> FlatOutput:
        """Return the flat outputs at the times t (n,), s, each (n, 4)."""
        ...


@runtime_checkable
class OpenTrajectory(Trajectory, Protocol):
    """A planned flight of which some values, such as times, depend on the believed limits."""

    def fitted(self, model: Model) -> Trajectory:
        """Return the flight with these values chosen for `model`."""
        ...


def fitted(trajectory: Trajectory, model: Model) -> Trajectory:
    """Return the trajectory with all values chosen that depend on the believed helicopter."""
    return trajectory.fitted(model) if isinstance(trajectory, OpenTrajectory) else trajectory
