"""Commands overtake each other on their way to the transmitter."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from controllers.signals import Command
from heli_twin.lab.faults import Duration, Hooks, Rate, Spells, Start


@dataclass(frozen=True, slots=True)
class CommandReorder:
    """Each second command reaches the transmitter after the one that follows it, so that the older one acts last."""

    kind: Literal["command_reorder"] = "command_reorder"
    start: Start = 5.0
    duration: Duration = 1.0
    rate: Rate = 0.0

    def hooks(self, rng: np.random.Generator) -> Hooks:
        """Keep a command back until the next one is sent."""
        spells = Spells(self, rng)
        kept: list[Command] = []

        def command(at: int, command: Command) -> list[tuple[int, Command]]:
            if kept:
                return [(at, command), (at, kept.pop())]
            if spells.began(at) is None:
                return [(at, command)]
            kept.append(command)
            return []

        return Hooks(command=command)
