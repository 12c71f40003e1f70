"""Planned flights. One file here is one family; it is found by its `kind` and needs no registry.

A trajectory is a frozen dataclass with a literal `kind` and a method `flat(t)`: times (n,) in s to the flat
outputs and their first two derivatives, for every t >= 0, also beyond the end of the flight.
"""

from typing import Protocol

from controllers.flatness import FlatOutput
from controllers.signals import Array


class Trajectory(Protocol):
    """A planned flight as a value."""

    def flat(self, t: Array) -> FlatOutput:
        """Flat outputs at the times t (n,), s, each (n, 4)."""
        ...
