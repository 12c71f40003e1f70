"""Faults: what breaks. One file is one fault; it is found by its `kind`, without a registry."""

from typing import Protocol

from controllers.signals import Pose


class Fault(Protocol):
    """A fault on the mocap wire, as a value. A frozen dataclass with a literal `kind`."""

    @property
    def kind(self) -> str:
        """Its name."""
        ...

    def pose(self, pose: Pose) -> Pose | None:
        """Change a pose on its way to the ground station; None if it is lost."""
        ...
