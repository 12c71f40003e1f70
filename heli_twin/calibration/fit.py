"""The fit: Gauss-Newton on windows of flights, weighted with the covariance of gusts and cameras.

    y_w = h(theta, nuisance, x0_w) + e_w,   e_w ~ N(0, C)

The first state x0 of each window is projected out, and so is which of two commands a frame of the radio carries that
comes within the jitter of the compute time: one in ten, each with the variance of its probability as the prior. Push,
tilt and place of the markers, and a small error of the delay belong to each log. Between the steps, the variances in C
are estimated by REML.

Source: Jategaonkar, Flight Vehicle System Identification, 2nd ed. (2015), chapters 4 and 5.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from controllers.signals import Array
from heli_twin.calibration import noise
from heli_twin.calibration.equations import Normal, information, normal, scattered
from heli_twin.calibration.parameters import INDEX
from heli_twin.calibration.problem import LEAST, Problem
from heli_twin.calibration.unknowns import BEGIN, BEGIN_SHARE_S, FIXED, LOG_SPREAD, N_LOG, N_START, N_THETA, State

MAX_ITERATIONS = 14
MAX_STEP = 1.0
"""Largest step, in units of the prior's spread."""
CONVERGED = 0.1
"""Largest step, in posterior standard deviations, of a fit that has converged."""
STALE = 0.5
"""Step, in posterior standard deviations, up to which the derivatives before it are used again."""
SETTLED = 0.3
"""Change of a variance, in standard deviations of its logarithm, up to which the variances are kept."""
RENEWED = 5.0
"""Step, in posterior standard deviations, after which the response to wind is found again."""
WIDER_WITH_SERVOS = 1.1
"""A reported standard deviation, as a multiple of the model's, where the servos' play is fitted: what a command does
then depends on when it comes in a period, which is known to a millisecond. Chosen on pilot twins (seeds 2000 to 2018)
that no test judges; without that play they need no factor."""
MOST_BEGIN_S = 0.5 * BEGIN_SHARE_S
"""Largest `servo_phase`."""
NEAR = 1.0
"""Step, in posterior standard deviations, from which on residuals are no longer errors of the parameters."""
MEMORY_WINDOWS = 2
"""Windows further apart than this are taken as independent by the sandwich."""


@dataclass(frozen=True)
class Fit:
    """A finished fit."""

    problem: Problem
    state: State
    ahead: State
    """After the step that is still asked for: where a next fit begins."""
    covariance: Array
    """(n, n) of theta: the model's."""
    sandwich: Array
    """(n, n) of theta, from the scatter of the windows."""
    nuisance_deviation: Array
    """(logs, N_LOG) standard deviations."""
    eta_covariance: Array
    last_step: float
    """Largest step of the last iteration, posterior standard deviations."""
    iterations: int
    residual: Array = field(repr=False)
    """(w, BINS, 6) poses minus prediction, each window's first state fitted; 0 where there is no pose."""
    predicted: Array = field(repr=False)
    """(w, BINS, 6)."""
    jacobian: Array = field(repr=False)
    """(w, BINS, 6, N_THETA + N_LOG) derivative of the prediction by theta and the log's nuisance."""
    first: Array = field(repr=False)
    """(w, BINS, 6, .) derivative by the first state and then the frames in doubt."""
    air: noise.Windage = field(repr=False)

    @property
    def deviation(self) -> Array:
        """Standard deviations (n,) of theta."""
        return self.wider * np.sqrt(np.diag(self.covariance))

    @property
    def wider(self) -> float:
        """Standard deviations as a multiple of the model's."""
        return WIDER_WITH_SERVOS if self.problem.spread[INDEX["servo_slowness"]] > FIXED else 1.0


class _Step(NamedTuple):
    """One linearisation, and the step that it asks for."""

    predicted: Array
    residual: Array
    jacobian: Array
    first: Array
    equations: Normal
    covariance: Array
    step: Array
    eta: Array
    """The next one."""
    eta_covariance: Array
    eta_size: float
    """Largest change of its entries, standard deviations."""
    size: float
    """Largest step of a parameter, posterior standard deviations."""


def fit(
    problem: Problem,
    begin: State | None = None,
    progress: Callable[[], None] = lambda: None,
    enough: float = CONVERGED,
    limit: int = MAX_ITERATIONS,
) -> Fit:
    """Fit the twin to flights.

    Args:
        problem: The flights and the prior.
        begin: From an earlier fit of the same flights; None for the prior, whose noise is then kept: residuals are
            errors of the parameters at first.
        progress: Called after every iteration.
        enough: Largest step, in posterior standard deviations, after which it stops.
        limit: Most iterations.
    """
    # More threads would add numbers in another order.
    with threadpool_limits(limits=1):
        return _fit(problem, begin, progress, enough, limit)


def _fit(problem: Problem, begin: State | None, progress: Callable[[], None], enough: float, limit: int) -> Fit:
    state = begin or problem.initial()
    air, is_blind = problem.windage(state), begin is None
    before, now, share, iteration = None, _step(problem, state, air, None, is_blind=is_blind), 1.0, 1
    progress()
    while iteration < limit and not (iteration > 1 and now.size < enough and now.eta_size < 1.0):
        state = _moved(problem, state, now, share)
        if now.size > RENEWED:
            air = problem.windage(state)
        is_stale = now.size > STALE or (before is not None and now.size > 0.5 * before.size)
        before, now = now, _step(problem, state, air, None if is_stale else now, is_blind=is_blind)
        # Steps to and fro jump over a kink of the servos' play.
        share = max(0.5 * share, 0.1) if _turns_back(before, now) else min(1.3 * share, 1.0)
        iteration += 1
        progress()
    return _finished(problem, state, now, air, iteration)


def _turns_back(before: _Step, now: _Step) -> bool:
    """Whether a step is against the one before, and hardly shorter."""
    return now.size > 0.7 * before.size and float(before.step @ np.linalg.solve(now.covariance, now.step)) < 0.0


def _step(problem: Problem, state: State, air: noise.Windage, old: _Step | None, *, is_blind: bool) -> _Step:
    """Linearise at a state; with the derivatives of an old step where they have hardly changed.

    Args:
        problem: The flights.
        state: Where.
        air: The response to wind.
        old: A step near by; None for new derivatives.
        is_blind: Keep the variances.
    """
    if old:
        predicted, jacobian, first = problem.predict(state), old.jacobian, old.first
    else:
        predicted, jacobian, first = problem.linearise(state)
    residual = problem.residual(predicted)
    equations = normal(problem, air, state.eta, np.concatenate([jacobian, residual[..., None], first], axis=-1))
    precision = _precision(problem)
    away = np.concatenate([state.theta - problem.prior, state.nuisance.ravel()])
    covariance = np.asarray(np.linalg.inv(equations.matrix + precision), np.float64)
    step = _bounded(problem, state, covariance, covariance @ (equations.vector - precision @ away))
    size = _size(step, covariance)
    if is_blind:
        eta, of_eta = state.eta, np.diag(noise.PRIOR_SPREAD**2)
    elif old and old.eta_size < SETTLED:
        eta, of_eta = state.eta, old.eta_covariance
    else:
        # Far from the end, residuals are errors of the parameters, and have lost nothing to them.
        explained = _explained(problem, jacobian) if size < NEAR else None
        eta, of_eta = noise.next_variances(air, state.eta, residual, first, explained)
    eta_size = float(np.max(np.abs(eta - state.eta) / np.sqrt(np.diag(of_eta))))
    return _Step(predicted, residual, jacobian, first, equations, covariance, step, eta, of_eta, eta_size, size)


def _size(step: Array, covariance: Array) -> float:
    return float(np.max(np.abs(step[:N_THETA]) / np.sqrt(np.diag(covariance))[:N_THETA]))


def _explained(problem: Problem, jacobian: Array) -> noise.Explained:
    """What the parameters explain of the residual."""
    precision = _precision(problem)

    def taken(local: Array, scores: Array) -> tuple[float, float]:
        matrix, vector = information(problem, local) + precision, scattered(problem, scores).sum(axis=0)
        return float(np.linalg.slogdet(matrix)[1]), float(vector @ np.linalg.solve(matrix, vector))

    return noise.Explained(jacobian, taken)


def _bounded(problem: Problem, state: State, covariance: Array, step: Array) -> Array:
    """The step under the condition that no parameter falls below its least value."""
    lacks = LEAST - (state.theta + step[:N_THETA])
    i = np.flatnonzero((lacks > 0.0) & (problem.spread > FIXED))
    return step + covariance[:, i] @ np.linalg.solve(covariance[np.ix_(i, i)], lacks[i])


def _precision(problem: Problem) -> Array:
    """The prior's, of theta and then each log's nuisance."""
    return np.diag(np.concatenate([problem.spread, np.tile(LOG_SPREAD, len(problem.flights))]) ** -2.0)


def _moved(problem: Problem, state: State, now: _Step, share: float) -> State:
    longest = float(np.max(np.abs(now.step[:N_THETA]) / np.maximum(problem.spread, FIXED)))
    step = now.step * share * min(1.0, MAX_STEP / max(longest, 1e-9))
    nuisance = state.nuisance + step[N_THETA:].reshape(-1, N_LOG)
    nuisance[:, BEGIN] = np.clip(nuisance[:, BEGIN], -MOST_BEGIN_S, MOST_BEGIN_S)
    return State(
        np.maximum(state.theta + step[:N_THETA], LEAST),
        nuisance,
        state.start + now.equations.to_start(step)[:, :N_START],
        now.eta,
        state.framed,
        state.servo,
    )


def _finished(problem: Problem, state: State, now: _Step, air: noise.Windage, iterations: int) -> Fit:
    sandwich = _sandwich(problem, now.equations, now.covariance)
    deviation = np.sqrt(np.maximum(np.diag(now.covariance), np.diag(sandwich)))[N_THETA:].reshape(-1, N_LOG)
    start = now.equations.to_start(np.zeros(len(now.step)))[:, :N_START]
    moved = np.einsum("wbic,wc->wbi", now.first[..., :N_START], start)
    n = slice(0, N_THETA)
    return Fit(
        problem=problem,
        state=state,
        ahead=_moved(problem, state, now, 1.0),
        covariance=now.covariance[n, n],
        sandwich=sandwich[n, n],
        nuisance_deviation=deviation,
        eta_covariance=now.eta_covariance,
        last_step=now.size,
        iterations=iterations,
        residual=now.residual - moved,
        predicted=now.predicted + moved,
        jacobian=now.jacobian,
        first=now.first,
        air=air,
    )


def _sandwich(problem: Problem, equations: Normal, covariance: Array) -> Array:
    """The covariance from the scatter of the windows' scores, neighbours included, with the prior's share."""
    scores = equations.scores
    w = len(scores)
    meat = scores.T @ scores
    for lag in range(1, MEMORY_WINDOWS + 1):
        same = problem.log_of[lag:] == problem.log_of[:-lag]
        cross = scores[lag:][same].T @ scores[:-lag][same]
        meat += (1.0 - lag / (MEMORY_WINDOWS + 1)) * (cross + cross.T)
    # Fitted parameters make the scores smaller than they are.
    meat *= w / max(w - N_THETA, 0.2 * w)
    return covariance @ (meat + _precision(problem)) @ covariance
