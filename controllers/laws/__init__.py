"""Control laws. One file here is one law; it is found by its `kind` and needs no registry."""

from typing import Protocol

import numpy as np

from controllers.model import Model
from controllers.signals import Command, Estimate, QpReport, Reference


class Controller(Protocol):
    """A control law in flight. It dies with the flight."""

    def step(self, now: int, estimate: Estimate, reference: Reference) -> Command:
        """Decide the next input.

        Args:
            now: The control time, ns.
            estimate: What the helicopter will be doing when the command acts.
            reference: The planned flight from the estimate's stamp on, `steps` inputs long.
        """
        ...

    def explain(self, command: Command) -> Command:
        """Add to the command of the last step what it rests on, as far as the law has it: plan and QP report.

        To fly, nobody needs them: they are worked out when they are asked for, once the command is on its way.
        """
        ...


class ControlLaw(Protocol):
    """A control law as a value. A frozen dataclass with a literal `kind`.

    Studies quote the last paragraph of its docstring, which says where its defaults come from.
    """

    @property
    def period(self) -> float:
        """Control period, s."""
        ...

    @property
    def steps(self) -> int:
        """How many control periods of the planned flight it wants to see."""
        ...

    @property
    def model(self) -> Model:
        """The helicopter as it believes it to be."""
        ...

    def start(self) -> Controller:
        """A controller for one flight."""
        ...


def safe_hover(model: Model, now: int) -> Command:
    """What to send while nothing better is known: level, and the thrust that is believed to hold the height."""
    return Command(now, np.array(model.u_hover), qp=QpReport("safe_hover", 0, 0, 0.0, 0.0))
