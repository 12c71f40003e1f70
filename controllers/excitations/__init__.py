"""Excitations: small motions added to the sent commands, so that a flight tells more about the helicopter.

One file here is one excitation, found by its `kind`. Estimator and recorder are given the command with the excitation
in it, as they are given every command that is sent; the control law then steadies the helicopter as usual.
"""

from typing import Protocol

from controllers.model import Model
from controllers.signals import Command


class ExcitationSpec(Protocol):
    """An excitation as a value: a frozen dataclass with a literal `kind`."""

    @property
    def kind(self) -> str:
        """Its name."""
        ...

    def excited(self, now: int, command: Command, model: Model) -> Command:
        """Return the command to send in place of the control law's.

        Args:
            now: Control time, ns.
            command: The control law's.
            model: The believed helicopter, whose input limits hold for the sum too.
        """
        ...
