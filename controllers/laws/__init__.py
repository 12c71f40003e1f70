"""Control laws. One file here is one law, selected by its `kind`; there is no registry to edit."""

from collections.abc import Generator
from contextlib import contextmanager
from typing import Protocol, runtime_checkable

from controllers.model import Model
from controllers.reference import BLOCK_SAMPLES, ReferencePreview
from controllers.signals import Array, Command, Estimate, NamedState, Reference
from controllers.trajectories import Trajectory


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


@runtime_checkable
class Closable(Protocol):
    """A controller that holds more than memory, such as a process: it is closed when its flight is over."""

    def close(self) -> None:
        """Let go of what it holds; later calls do nothing."""
        ...


@contextmanager
def closed_after(controller: Controller) -> Generator[Controller]:
    """Close a controller when the block ends in whatever way, if it can be closed."""
    try:
        yield controller
    finally:
        if isinstance(controller, Closable):
            controller.close()


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


@runtime_checkable
class DerivativeReader(Protocol):
    """A law that reads flat outputs and their derivatives; its references then have `flat`."""

    @property
    def flat_derivatives(self) -> int:
        """Highest time derivative that it reads; one above 2 needs a trajectory that gives it."""
        ...


@runtime_checkable
class Prepares(DerivativeReader, Protocol):
    """A law that computes ahead what it needs of flat outputs: for many samples at once, not in each control step."""

    def prepare(self, flat: Array) -> Array:
        """Return one row for each of the k samples of flat outputs (n + 1, k, 4); it becomes `Reference.prepared`."""
        ...


@runtime_checkable
class HasExtraStates(Protocol):
    """A law or estimator whose plans or estimates have states beyond the physical ones."""

    @property
    def extra_states(self) -> tuple[NamedState, ...]:
        """Names and units, in the order of `Plan.extra` or `Estimate.extra`."""
        ...


@runtime_checkable
class StateReader(Protocol):
    """A law that reads further states of the estimates."""

    @property
    def estimated_states(self) -> tuple[NamedState, ...]:
        """Names and units of the first further states that an estimate must have."""
        ...


def flat_derivatives(law: object) -> int:
    """Return the highest derivative of the flat outputs that a law reads; 0 for one that reads states and inputs."""
    return law.flat_derivatives if isinstance(law, DerivativeReader) else 0


def preview_of(
    law: ControlLaw, trajectory: Trajectory, period: int, origin: int, samples: int = BLOCK_SAMPLES
) -> ReferencePreview:
    """Return the samples of a trajectory with all that a law reads of them, `samples` at once; times in ns."""
    prepare = law.prepare if isinstance(law, Prepares) else None
    return ReferencePreview(trajectory, law.model, period, origin, flat_derivatives(law), prepare, samples)


def extra_states(spec: object) -> tuple[NamedState, ...]:
    """Return names and units of the further states of a law or an estimator; none for most."""
    return tuple(NamedState(*state) for state in spec.extra_states) if isinstance(spec, HasExtraStates) else ()
