"""No excitation: the control law's command is sent."""

from dataclasses import dataclass
from typing import Literal

from controllers.model import Model
from controllers.signals import Command


@dataclass(frozen=True, slots=True)
class NoExcitation:
    """The commands are the control law's."""

    kind: Literal["off"] = "off"

    def excited(self, now: int, command: Command, model: Model) -> Command:
        """Return the command as it is."""
        return command
