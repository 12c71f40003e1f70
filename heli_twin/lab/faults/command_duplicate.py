"""The transmitter repeats commands."""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Le, Unit, doc

from controllers.signals import Command, nanoseconds
from heli_twin.lab.faults import Duration, Hooks, Rate, Spells, Start


@dataclass(frozen=True, slots=True)
class CommandDuplicate:
    """Each command comes once more, `delay` later; where a newer one came in between, the older one acts again."""

    kind: Literal["command_duplicate"] = "command_duplicate"
    start: Start = 5.0
    duration: Duration = 1.0
    rate: Rate = 0.0
    delay: Annotated[float, Ge(0), Le(1), Unit("s"), doc("from a command to its repetition")] = 0.03

    def hooks(self, rng: np.random.Generator) -> Hooks:
        """Send repetitions that are due with the next command."""
        spells, delay = Spells(self, rng), nanoseconds(self.delay)
        waiting: list[tuple[int, Command]] = []

        def command(at: int, command: Command) -> list[tuple[int, Command]]:
            repeated = [(at, old) for due, old in waiting if due <= at]
            waiting[:] = [(due, old) for due, old in waiting if due > at]
            if spells.began(at) is not None:
                waiting.append((at + delay, command))
            return [(at, command), *repeated]

        return Hooks(command=command)
