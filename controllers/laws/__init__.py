"""Control laws. One file here is one law, selected by its `kind`; there is no registry to edit."""

from typing import Protocol

import numpy as np

from controllers.model import Model
from controllers.signals import Command, Estimate, QpReport, Reference


class Controller(Protocol):
    """A control law during one flight, with its state."""

    def step(self, now: int, estimate: Estimate, reference: Reference) -> Command:
        """Decide the next input.

        Args:
            now: The control time, ns.
            estimate: The state expected at the time when the command acts.
            reference: The planned flight from the estimate's stamp on, `steps` inputs long.
        """
        ...

    def explain(self, command: Command) -> Command:
        """Return the command of the last step with its plan and QP report, if the law has them.

        They are computed after the command was sent, because the flight does not need them.
        """
        ...


class ControlLaw(Protocol):
    """A control law as a value: a frozen dataclass with a literal `kind`.

    Studies quote the last paragraph of its docstring, which says where its defaults come from.
    """

    @property
    def period(self) -> float:
        """Control period, s."""
        ...

    @property
    def steps(self) -> int:
        """Number of control periods of the planned flight that the law reads in each step."""
        ...

    @property
    def model(self) -> Model:
        """The helicopter as the law believes it to be."""
        ...

    def start(self) -> Controller:
        """Return a controller for one flight."""
        ...


def safe_hover(model: Model, now: int) -> Command:
    """Return the command that is sent without a usable estimate or plan: level, with the believed hover thrust."""
    return Command(now, np.array(model.u_hover), qp=QpReport("safe_hover", 0, 0, 0.0, 0.0))
