"""The radio is jammed: the receiver holds what it has."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from controllers.signals import Command
from heli_twin.lab.faults import Duration, Hooks, Rate, Spells, Start


@dataclass(frozen=True, slots=True)
class RadioOutage:
    """Commands that become ready in the fault are lost; the last one before it stays in force."""

    kind: Literal["radio_outage"] = "radio_outage"
    start: Start = 5.0
    duration: Duration = 0.3
    rate: Rate = 0.0

    def hooks(self, rng: np.random.Generator) -> Hooks:
        """Lose the commands."""
        spells = Spells(self, rng)

        def command(at: int, command: Command) -> list[tuple[int, Command]]:
            return [(at, command)] if spells.began(at) is None else []

        return Hooks(command=command)
