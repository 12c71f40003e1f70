"""What flights would tell before anyone flies: Cramer and Rao's bound, and which next flight would help most."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from controllers.signals import Array
from heli_twin.calibration import noise
from heli_twin.calibration.calibrate import EFFECTS, TOLD, hold
from heli_twin.calibration.data import Flight
from heli_twin.calibration.equations import normal
from heli_twin.calibration.expected import expected_noise
from heli_twin.calibration.frames import begun
from heli_twin.calibration.parameters import INDEX, NAMES, PARAMETERS, SPREAD, lab_of, of_experiment, vector
from heli_twin.calibration.problem import Problem
from heli_twin.calibration.unknowns import LOG_SPREAD, N_LOG, N_THETA
from heli_twin.experiment import Experiment


class Bound(NamedTuple):
    """The least standard deviation of one parameter."""

    name: str
    unit: str
    deviation: float
    """Relative for positive parameters, else in its unit."""
    is_relative: bool
    told: bool


def information(flight: Flight, base: Experiment) -> Array:
    """Return the information (n, n) of one flight on the parameters, its own nuisance projected out.

    Args:
        flight: Flown by the helicopter of `base`, or by any.
        base: The helicopter at which the bound is taken, with its gusts and cameras; effects that it does not have are
            taken as known.
    """
    believed, expected = of_experiment(base), expected_noise(base)
    theta = vector(np.array([believed[name] for name in NAMES]))
    problem = Problem([flight], lab_of(base), theta, _spread(base))
    state = begun(problem, theta, np.log([expected[name] for name in noise.COMPONENTS]))
    with threadpool_limits(limits=1):
        predicted, jacobian, first = problem.linearise(state)
        rows = np.concatenate([jacobian, problem.residual(predicted)[..., None], first], axis=-1)
        equations = normal(problem, problem.windage(state), state.eta, rows)
    own = equations.matrix[N_THETA:, N_THETA:] + np.diag(LOG_SPREAD**-2.0)
    cross = equations.matrix[:N_THETA, N_THETA:]
    assert own.shape == (N_LOG, N_LOG)
    return equations.matrix[:N_THETA, :N_THETA] - cross @ np.linalg.solve(own, cross.T)


def _spread(base: Experiment) -> Array:
    """The prior's (n,), without the effects that a helicopter does not have."""
    spread, present = SPREAD.copy(), of_experiment(base)
    for effect, names in EFFECTS.items():
        if not any(present[name] for name in names):
            hold(spread, effect)
    return spread


def bounds(informations: Sequence[Array], base: Experiment) -> list[Bound]:
    """Return what flights together would tell of each parameter, with the prior."""
    spread = _spread(base)
    covariance = np.linalg.inv(sum(informations, np.zeros((N_THETA, N_THETA))) + np.diag(spread**-2.0))
    deviation = np.sqrt(np.diag(covariance))
    return [
        Bound(p.name, p.unit, float(deviation[i]), p.is_positive, bool(deviation[i] < TOLD * SPREAD[i]))
        for i, p in enumerate(PARAMETERS)
        if spread[INDEX[p.name]] == SPREAD[INDEX[p.name]]
    ]


def gain(known: Array, more: Array, base: Experiment) -> float:
    """Return how much a further flight lessens the logarithms of all standard deviations, on the average."""
    before, after = (
        np.log([bound.deviation for bound in bounds(list(information), base)])
        for information in ((known,), (known, more))
    )
    return float(np.mean(before - after))


def as_json(flights: dict[str, list[Bound]], gains: dict[str, float]) -> dict[str, Any]:
    """The plan as `heli-twin calibrate --plan --json` prints it."""
    return {
        "flights": {
            name: {b.name: {"deviation": b.deviation, "relative": b.is_relative, "told": b.told} for b in each}
            for name, each in flights.items()
        },
        "next": gains,
    }
