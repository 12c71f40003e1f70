"""Planned flights. One file here is one kind of trajectory, selected by its `kind`; there is no registry to edit.

A trajectory is a frozen dataclass with a literal `kind` and a method `flat(t)`: it returns the flat outputs and
their first two derivatives at the times t (n,), s, for every t >= 0, also after the end of the flight. That is enough
for most laws. One with a detailed model reads higher derivatives: a trajectory that gives them has `smoothness` and
`derivatives(t, highest)` too; `controllers.jets` computes them from a formula.
"""

from typing import Protocol, runtime_checkable

import numpy as np

from controllers.errors import MissingDerivatives
from controllers.flatness import FlatOutput
from controllers.model import Model
from controllers.signals import Array


class Trajectory(Protocol):
    """A planned flight as a value."""

    def flat(self, t: Array) -> FlatOutput:
        """Return the flat outputs at the times t (n,), s, each (n, 4)."""
        ...


ALL_DERIVATIVES = 1000
"""Smoothness of a trajectory of which every derivative is continuous."""
PLAIN = 2
"""Derivatives that every trajectory gives: up to the acceleration."""


@runtime_checkable
class SmoothTrajectory(Trajectory, Protocol):
    """A planned flight that gives higher derivatives too."""

    @property
    def smoothness(self) -> int:
        """Number of time derivatives that are continuous; of the next ones, some jump, and none is a pulse."""
        ...

    def derivatives(self, t: Array, highest: int) -> Array:
        """Return the flat outputs and their time derivatives at the times t (n,), s: (highest + 1, n, 4).

        Where a derivative jumps, it is the one that follows.
        """
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


def derivatives(trajectory: Trajectory, t: Array, highest: int) -> Array:
    """Return the flat outputs of any trajectory and their time derivatives at t (n,), s: (highest + 1, n, 4).

    Raises:
        MissingDerivatives: It does not give so many.
    """
    if highest <= PLAIN:
        return np.stack(trajectory.flat(t)[: highest + 1])
    if not isinstance(trajectory, SmoothTrajectory):
        raise MissingDerivatives(
            f"{type(trajectory).__name__} gives time derivatives of its flat outputs up to the 2nd, and the"
            f" {highest}th are asked for: add a method derivatives(t, highest) and a property smoothness, as"
            " controllers/trajectories/__init__.py says, or fly another trajectory or law"
        )
    return trajectory.derivatives(t, highest)


def smoothness(trajectory: Trajectory) -> int:
    """Return how many time derivatives of a trajectory are continuous; 2 for one that does not say it."""
    return trajectory.smoothness if isinstance(trajectory, SmoothTrajectory) else PLAIN
