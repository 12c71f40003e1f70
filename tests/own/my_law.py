"""A control law of thirty lines, as a user would write it beside his script."""

from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Gt, Unit, doc

from controllers.model import Model
from controllers.signals import Command


class Controller:
    """One flight of it."""

    def __init__(self, law: "MyLaw") -> None:
        self.law = law

    def step(self, now: int, estimate: Any, reference: Any) -> Command:
        """PD in the plane, on height and on heading."""
        model, gain = self.law.model, self.law.gain
        error = reference.x[0] - estimate.x
        c, s = np.cos(estimate.x[3]), np.sin(estimate.x[3])
        ahead, aside = c * error[0] + s * error[1], c * error[1] - s * error[0]
        u = np.array(
            [
                gain * ahead + 0.5 * error[4],
                gain * aside + 0.5 * error[5],
                model.u_hover[2] + 0.3 * error[2] + 0.2 * error[6],
                0.2 * error[3],
            ]
        )
        return Command(now, np.clip(u, model.u_min, model.u_max))

    def explain(self, command: Command) -> Command:
        """It has no plan."""
        return command


@dataclass(frozen=True, slots=True)
class MyLaw:
    """A PD law of a user's own."""

    kind: Literal["my_law"] = "my_law"
    period: Annotated[float, Gt(0), Unit("s"), doc("control period")] = 0.02
    gain: Annotated[float, Gt(0), doc("input per metre")] = 0.8
    model: Annotated[Model, doc("the helicopter as the law believes it to be")] = field(default_factory=Model)

    @property
    def steps(self) -> int:
        """It looks one period ahead."""
        return 1

    def start(self) -> Controller:
        """For one flight."""
        return Controller(self)
