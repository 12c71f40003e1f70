"""Estimated time to repeat a flight: a log is foreign, so hours of work need the user's agreement."""

from heli_twin.errors import HeliTwinError
from heli_twin.experiment import Experiment

ASK_ABOVE_S = 600.0
"""Work that takes longer than this is done only if it is agreed to."""
SECOND_OF_FLIGHT_S = 0.03
PHYSICS_STEP_S = 6e-6
CONTROL_STEP_S = 0.2e-3
HORIZON_STEP_S = 0.05e-3
ESTIMATOR_STEP_S = 0.15e-3
"""Computing time of a simulated second, of a physics step, of a control step, of each step of its horizon, and of an
estimate. Measured on one core of an AMD EPYC: right within a factor of two."""


def flight_effort(experiment: Experiment) -> float:
    """The computing time of a flight, s."""
    physics = SECOND_OF_FLIGHT_S + PHYSICS_STEP_S / experiment.plant.step
    return experiment.duration * physics + control_effort(
        experiment, experiment.duration / experiment.controller.period
    )


def control_effort(experiment: Experiment, count: float) -> float:
    """The computing time of so many control steps, s."""
    return count * (CONTROL_STEP_S + HORIZON_STEP_S * experiment.controller.steps)


def require_agreement(seconds: float, work: str, is_agreed: bool) -> None:
    """Refuse work that takes long, unless it is agreed to.

    Args:
        seconds: Its estimated time.
        work: What it is, in words that begin a sentence.
        is_agreed: Whether the user has said yes.

    Raises:
        HeliTwinError: It takes longer than `ASK_ABOVE_S`, and is not agreed to.
    """
    if seconds > ASK_ABOVE_S and not is_agreed:
        unit, size = ("hours", 3600.0) if seconds > 2 * 3600 else ("minutes", 60.0)
        raise HeliTwinError(f"{work} takes about {seconds / size:.0f} {unit} on this machine: say --yes to do it")
