"""The frames of the radio: when the input that a frame brings acts at the helicopter."""

import numpy as np
from threadpoolctl import threadpool_limits

from controllers.signals import Array
from heli_twin.calibration import noise
from heli_twin.calibration.drive import SERVO_PERIOD_S
from heli_twin.calibration.fit import Fit, fit
from heli_twin.calibration.parameters import INDEX
from heli_twin.calibration.problem import Problem
from heli_twin.calibration.unknowns import BEGIN, BEGIN_SHARE_S, LOG_SPREAD, N_LOG, N_THETA, PHASE, Later, State

PHASES, FRAME_GAIN = 22, 50.0
"""Phases of the frames that are tried, and the least gain in the weighted square that decides for one: twice the log of
the number of phases is 6, and the gain is in the hundreds where frames are regular."""
TURNS = round(SERVO_PERIOD_S / BEGIN_SHARE_S)
"""Times between two periods of the servos that are tried, each in the middle of its share of a period."""


def framed(problem: Problem, fitted: Fit, eta: Array) -> State:
    """Return the next state of a fit with the frames of each log's radio where they explain its poses best, if any do.

    Frames a millisecond apart are tried. The misfit is the weighted square of the residual, with everything else fitted
    anew in one linear step. A log whose frames explain nothing keeps the mean wait for a frame.

    Args:
        problem: The flights.
        fitted: With the mean wait for a frame.
        eta: Noise of a twin whose frames are right.
    """
    with threadpool_limits(limits=1):
        return _framed(problem, fitted, eta)


def _framed(problem: Problem, fitted: Fit, eta: Array) -> State:
    if not problem.lab.frame_period:
        return fitted.ahead._replace(eta=eta)
    phases = problem.lab.frame_period * np.arange(PHASES) / PHASES
    nuisance = fitted.state.nuisance.copy()
    nuisance[:, PHASE] = 0.0
    state = fitted.state._replace(nuisance=nuisance, framed=(0.0,) * len(problem.flights))
    unframed = state._replace(framed=(None,) * len(problem.flights))
    variants = np.broadcast_to(state.theta, (PHASES, N_THETA))
    predicted = [
        *problem.simulated(state, variants, [Later(frames) for frames in phases.tolist()]),
        problem.simulated(unframed, variants[:1], [Later()])[0],
    ]
    misfit = _misfit(
        problem, fitted, eta, np.stack([problem.residual(problem.measured(h, state)) for h in predicted], axis=-1)
    )
    best = np.argmin(misfit[:, :PHASES], axis=1)
    least = misfit[np.arange(len(best)), best]
    # The noise may be far from what was expected.
    poses = np.bincount(problem.log_of, problem.present.sum(axis=1))
    gains = (misfit[:, PHASES] - least) / np.maximum(least / (6.0 * poses), 1.0)
    framed = [float(phases[i]) if gain > FRAME_GAIN else None for i, gain in zip(best, gains, strict=True)]
    nuisance = fitted.ahead.nuisance.copy()
    nuisance[:, PHASE] = 0.0
    return fitted.ahead._replace(nuisance=nuisance, eta=eta, framed=tuple(framed))


def begun(problem: Problem, theta: Array, eta: Array) -> State:
    """Return the state of a fit in which helicopter and noise are known, and the radio's frames and servos are found.

    Args:
        problem: The flights.
        theta: (n,) the helicopter.
        eta: (9,) logarithms of `noise.COMPONENTS`.
    """
    begin = problem.initial()._replace(theta=theta.copy(), eta=eta.copy())
    blind = fit(problem, begin, limit=1)
    state = framed(problem, blind, eta)._replace(theta=theta.copy())
    return timed(problem, blind, state)[0] if theta[INDEX["servo_slowness"]] > 0.0 else state


def timed(problem: Problem, fitted: Fit, state: State) -> tuple[State, float]:
    """Return a state whose servos begin their periods when it explains the poses best.

    Args:
        problem: The flights, servos free.
        fitted: Says how the other parameters follow.
        state: Where servos with play and limited speed are tried.

    Returns:
        The state, and how much less the weighted square is than with servos that follow at once.
    """
    ideal = state.theta.copy()
    ideal[[INDEX["servo_backlash"], INDEX["servo_slowness"]]] = 0.0
    with threadpool_limits(limits=1):
        begins = SERVO_PERIOD_S * (np.arange(TURNS) + 0.5) / TURNS
        nuisance = state.nuisance.copy()
        nuisance[:, BEGIN] = 0.0
        state = state._replace(nuisance=nuisance, servo=(0.0,) * len(problem.flights))
        variants = np.vstack([np.broadcast_to(state.theta, (TURNS, N_THETA)), ideal])
        later = [*(Later(servo=begin) for begin in begins.tolist()), Later()]
        predicted = problem.simulated(state, variants, later)
        residuals = [problem.residual(problem.measured(h, state)) for h in predicted]
        misfit = _misfit(problem, fitted, state.eta, np.stack(residuals, axis=-1))
    best = np.argmin(misfit[:, :TURNS], axis=1)
    gain = float((misfit[:, TURNS] - misfit[np.arange(len(best)), best]).sum())
    return state._replace(servo=tuple(begins[best].tolist())), gain


def _misfit(problem: Problem, fitted: Fit, eta: Array, residuals: Array) -> Array:
    """Weighted squares (logs, c) of residuals (w, BINS, 6, c), with parameters and first states fitted to each."""
    c, n = residuals.shape[-1], N_THETA + N_LOG
    rows = np.concatenate([residuals, fitted.jacobian, fitted.first], axis=-1)
    # What is tried is not fitted.
    rows[..., c + N_THETA + BEGIN] = 0.0
    white = noise.whiten(fitted.air, eta, rows)[0].reshape(len(rows), -1, rows.shape[-1])
    gram = white.transpose(0, 2, 1) @ white
    k = c + n
    back = np.linalg.solve(gram[:, k:, k:] + noise.start_precision(fitted.first.shape[-1]), gram[:, k:, :k])
    local = gram[:, :k, :k] - gram[:, :k, k:] @ back
    spread = np.concatenate([problem.spread, LOG_SPREAD])
    out = np.zeros((len(problem.flights), c))
    for log in range(len(problem.flights)):
        of_log = local[problem.log_of == log].sum(axis=0)
        fitted_away = np.linalg.solve(of_log[c:, c:] + np.diag(spread**-2.0), of_log[c:, :c])
        out[log] = np.diag(of_log[:c, :c] - of_log[:c, c:] @ fitted_away)
    return out
