"""The fit: Gauss-Newton on windows of flights, weighted with the covariance of gusts and cameras.

    y_w = h(theta, nuisance, x0_w) + e_w,   e_w ~ N(0, C)

The first state x0 of each window is projected out; push, tilt and place of the markers, and a small error of the delay
belong to each log. Between the steps, the variances in C are estimated by REML.

Source: Jategaonkar, Flight Vehicle System Identification, 2nd ed. (2015), chapters 4 and 5.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from controllers.signals import Array
from heli_twin.calibration import noise
from heli_twin.calibration.data import WINDOW_STEPS, Flight
from heli_twin.calibration.drive import drives_of
from heli_twin.calibration.motion import Lanes, simulate
from heli_twin.calibration.parameters import INDEX, NAMES, SPREAD, Lab

OF_A_LOG = (
    "push_x",
    "push_y",
    "push_z",
    "marker_roll",
    "marker_pitch",
    "marker_yaw",
    "marker_x",
    "marker_y",
    "marker_z",
    "delay_error",
    "frame_phase",
)
"""Nuisance of each log: m/s^2 in the world; tilt of the marker body, rad; its place in the body, m; s."""
LOG_SPREAD = np.array([0.3, 0.3, 0.1] + [0.02] * 3 + [0.01] * 3 + [0.0003, 0.006])
"""Standard deviations of their priors. A flight begins anywhere between two steps of radio and physics."""
PUSH, TILT, LEVER, LATE, PHASE = slice(0, 3), slice(3, 6), slice(6, 9), 9, 10
N_THETA, N_LOG, N_START = len(NAMES), len(OF_A_LOG), 12
STEPS = {
    "delay": 2e-5,
    "hub_drag_per_iyy": 0.1,
    "thrust_yaw_coupling_per_izz": 1e-2,
    "drag_z_per_mass": 1e-3,
    "battery_drain": 1e-5,
    "battery_droop": 1e-3,
    "servo_backlash": 2e-3,
    "servo_slowness": 0.02,
    "ground_effect": 0.05,
}
"""Steps of the differences; 1e-4 for the others."""
START_STEP = np.array([0, 0, 0, 1e-4, 1e-4, 1e-4, 1e-4, 1e-4, 1e-4, 1e-3, 1e-3, 1e-3])
PUSH_STEP, PHASE_STEP = 1e-3, 2e-4
DRIVEN = (
    "delay",
    "servo_lag",
    "thrust_lag",
    "yaw_lag",
    "thrust_per_mass",
    "battery_drain",
    "battery_droop",
    "servo_backlash",
    "servo_slowness",
)
"""Parameters that change what the actuators do."""
FIRST = {"servo_backlash": 0.02, "servo_slowness": 0.3}
"""Where the fit of these begins: at zero they have no slope."""
PHASES, FRAME_GAIN = 22, 50.0
"""Phases of the frames that are tried, and the least gain in the weighted square that decides for one: twice the log of
the number of phases is 6, and the gain is in the hundreds where frames are regular."""
FIXED = 1e-5
"""Spread of a prior below which a parameter is held."""
MAX_ITERATIONS = 14
BLIND_ITERATIONS = 2
"""Iterations with the prior's noise: before them, residuals are errors of the parameters."""
MAX_STEP = 1.0
"""Largest step, in units of the prior's spread."""
CONVERGED = 0.1
"""Largest step, in posterior standard deviations, of a fit that has converged."""
STALE = 0.5
"""Step, in posterior standard deviations, up to which the derivatives before it are used again."""
MEMORY_WINDOWS = 2
"""Windows further apart than this are taken as independent by the sandwich."""


class State(NamedTuple):
    """What is being fitted."""

    theta: Array
    """(n,) parameters; logarithms of positive ones."""
    nuisance: Array
    """(logs, N_LOG)."""
    start: Array
    """(w, 12)."""
    eta: Array
    """(9,) logarithms of `noise.COMPONENTS`."""
    framed: tuple[float | None, ...]
    """For each log when the input of one of the radio's frames acts, to which `frame_phase` is added; None if the wait
    for a frame is taken as its mean."""


@dataclass(frozen=True)
class Fit:
    """A finished fit."""

    problem: "Problem"
    state: State
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
    """(w, BINS, 6, 12) derivative by the first state."""
    air: noise.Windage = field(repr=False)

    @property
    def deviation(self) -> Array:
        """Standard deviations (n,) of theta: the wider of model and sandwich."""
        return np.sqrt(np.maximum(np.diag(self.covariance), np.diag(self.sandwich)))


class Problem:
    """The windows of all flights, stacked."""

    def __init__(self, flights: Sequence[Flight], lab: Lab, prior: Array, spread: Array = SPREAD) -> None:
        self.flights, self.lab, self.prior, self.spread = tuple(flights), lab, prior, spread
        windows = [flight.windows for flight in flights]
        self.y = np.concatenate([w.y for w in windows])
        self.frames = np.concatenate([w.frames for w in windows])
        self.weights = np.concatenate([w.weights for w in windows])
        self.early = np.concatenate([w.early for w in windows])
        self.start = np.concatenate([w.start for w in windows])
        self.log_of = np.repeat(np.arange(len(flights)), [len(w.first) for w in windows])
        self.present = self.frames > 0
        # Headings between poses, for the covariance alone.
        self.yaw = np.stack([_filled(y[:, 3], seen) for y, seen in zip(self.y, self.present, strict=True)])

    def initial(self) -> State:
        """The prior's helicopter, with the first states that the poses suggest."""
        theta = self.started(self.prior, self.spread)
        return State(
            theta,
            np.zeros((len(self.flights), N_LOG)),
            self.start.copy(),
            np.log(noise.PRIOR),
            (None,) * len(self.flights),
        )

    @staticmethod
    def started(theta: Array, spread: Array) -> Array:
        """Return a vector in which the free parameters without a slope at zero have left it."""
        out = theta.copy()
        for name, value in FIRST.items():
            out[INDEX[name]] = value if spread[INDEX[name]] > FIXED else 0.0
        return out

    def predict(self, state: State) -> Array:
        """Poses (w, BINS, 6) that a state predicts."""
        return self._measured(self._simulate(state, state.theta[None], [0.0])[0], state)

    def linearise(self, state: State) -> tuple[Array, Array, Array]:
        """Predicted poses (w, BINS, 6), and their derivatives by theta and a log's nuisance, and by the first state."""
        steps = np.array([STEPS.get(name, 1e-4) for name in NAMES])
        free = np.flatnonzero(self.spread > FIXED)
        n, m = 1 + len(free), 1 + len(free) + N_START - 3
        variants = state.theta + np.vstack([np.zeros(N_THETA), np.diag(steps)[free], np.zeros(N_THETA)])
        out = self._simulate(state, variants, [0.0] * n + [PHASE_STEP], START_STEP)
        by_phase = (out[n] - out[0]) / PHASE_STEP
        out = np.delete(out, n, axis=0)
        by_theta = np.zeros((N_THETA, *out.shape[1:]))
        by_theta[free] = (out[1:n] - out[0]) / steps[free, None, None, None]
        by_start = (out[n:m] - out[0]) / START_STEP[3:, None, None, None]
        by_push = (out[m:] - out[0]) / PUSH_STEP
        by_place = np.zeros((3, *out.shape[1:]))
        by_place[range(3), :, :, range(3)] = 1.0
        jacobian = np.moveaxis(np.concatenate([by_theta, by_push, by_phase[None]]), 0, -1)
        first = np.moveaxis(np.concatenate([by_place, by_start]), 0, -1)
        h, lever = out[0], state.nuisance[self.log_of][:, LEVER]
        turned = _lever_turned(h, lever)
        for columns in (jacobian, first):
            columns[..., :3, :] += np.einsum("wbij,wbjc->wbic", turned, columns[..., 3:, :])
        of_log = np.concatenate(
            [
                jacobian[..., N_THETA:-1],
                _by_tilt(h),
                _by_lever(h),
                jacobian[..., [INDEX["delay"]]],
                jacobian[..., -1:],
            ],
            axis=-1,
        )
        seen = self.present[:, :, None, None]
        jacobian = np.concatenate([jacobian[..., :N_THETA], of_log], axis=-1) * seen
        return self._measured(h, state), jacobian, first * seen

    def framed(self, fitted: "Fit") -> State:
        """Return the state of a fit with the frames of each log's radio where they explain its poses best, if any do.

        Frames a millisecond apart are tried. The misfit is the weighted square of the residual, with everything else
        fitted anew in one linear step. A log whose frames explain nothing keeps the mean wait for a frame.
        """
        if not self.lab.frame_period:
            return fitted.state
        phases = self.lab.frame_period * np.arange(PHASES) / PHASES
        nuisance = fitted.state.nuisance.copy()
        nuisance[:, PHASE] = 0.0
        state = fitted.state._replace(nuisance=nuisance, framed=(0.0,) * len(self.flights))
        unframed = state._replace(framed=(None,) * len(self.flights))
        variants = np.broadcast_to(state.theta, (PHASES, N_THETA))
        predicted = [
            *self._simulate(state, variants, phases.tolist()),
            self._simulate(unframed, variants[:1], [0.0])[0],
        ]
        misfit = self._misfit(fitted, np.stack([self.residual(self._measured(h, state)) for h in predicted], axis=-1))
        best = np.argmin(misfit[:, :PHASES], axis=1)
        gains = misfit[:, PHASES] - misfit[np.arange(len(best)), best]
        framed = [float(phases[i]) if gain > FRAME_GAIN else None for i, gain in zip(best, gains, strict=True)]
        return state._replace(framed=tuple(framed))

    def _misfit(self, fitted: "Fit", residuals: Array) -> Array:
        """Weighted squares (logs, c) of residuals (w, BINS, 6, c), with parameters and first states fitted to each."""
        c, n = residuals.shape[-1], N_THETA + N_LOG
        rows = np.concatenate([residuals, fitted.jacobian, fitted.first], axis=-1)
        gram = np.zeros((len(rows), rows.shape[-1], rows.shape[-1]))
        for weights in noise.weighted(fitted.air, fitted.state.eta, with_parts=False):
            for matrix, part in noise.blocks(weights, rows).values():
                gram[weights.windows] += part.transpose(0, 2, 1) @ (matrix @ part)
        k = c + n
        back = np.linalg.solve(gram[:, k:, k:] + 1e-9 * np.eye(N_START), gram[:, k:, :k])
        local = gram[:, :k, :k] - gram[:, :k, k:] @ back
        spread = np.concatenate([self.spread, LOG_SPREAD])
        out = np.zeros((len(self.flights), c))
        for log in range(len(self.flights)):
            of_log = local[self.log_of == log].sum(axis=0)
            fitted_away = np.linalg.solve(of_log[c:, c:] + np.diag(spread**-2.0), of_log[c:, :c])
            out[log] = np.diag(of_log[:c, :c] - of_log[:c, c:] @ fitted_away)
        return out

    def residual(self, predicted: Array) -> Array:
        """Poses minus prediction; 0 where there is no pose."""
        return (self.y - predicted) * self.present[..., None]

    def _measured(self, h: Array, state: State) -> Array:
        nuisance = state.nuisance[self.log_of]
        out = h + np.einsum("wbic,wc->wbi", _by_tilt(h), nuisance[:, TILT])
        out[..., :3] += np.einsum("wbic,wc->wbi", _by_lever(h)[..., :3, :], nuisance[:, LEVER])
        return out

    def _simulate(
        self, state: State, variants: Array, later: Sequence[float], start_steps: Array | None = None
    ) -> Array:
        """Simulated poses (p, w, BINS, 6) of variants (p, n), with `later` frames (p,), s.

        With `start_steps` (12,) the first state is varied too, and after it the push; the variants are then the nominal
        vector, one for each free parameter, and one with later frames.
        """
        p, w = len(variants), len(self.log_of)
        which = np.arange(p)
        if start_steps is not None:
            # Most parameters move the helicopter under the same drive.
            free = np.flatnonzero(self.spread > FIXED).tolist()
            driven = [0, *(1 + free.index(INDEX[name]) for name in DRIVEN if INDEX[name] in free), p - 1]
            which = np.zeros(p, np.int64)
            which[driven] = np.arange(len(driven))
        drive = self._drives(state, *zip(*[(variants[i], later[i]) for i in _firsts(which)], strict=True))
        push = np.broadcast_to(state.nuisance[self.log_of][:, PUSH], (p, w, 3))
        start = np.broadcast_to(state.start, (p, w, N_START))
        if start_steps is not None:
            extra = N_START - 3 + 3
            variants = np.vstack([variants, np.broadcast_to(state.theta, (extra, N_THETA))])
            which = np.concatenate([which, np.zeros(extra, np.int64)])
            start, push = (np.concatenate([a, np.broadcast_to(a[0], (extra, *a.shape[1:]))]) for a in (start, push))
            for i in range(3, N_START):
                start[p + i - 3, :, i] += start_steps[i]
            for i in range(3):
                push[p + N_START - 3 + i, :, i] += PUSH_STEP
        return simulate(Lanes(variants, start, push, drive, which), self.weights, self.early, self.lab)

    def _drives(self, state: State, variants: Sequence[Array], later: Sequence[float]) -> Array:
        out = np.empty((WINDOW_STEPS, len(variants), 4, len(self.log_of)))
        at = 0
        for i, flight in enumerate(self.flights):
            rows = flight.windows.first[None, :] + np.arange(WINDOW_STEPS)[:, None]
            count = rows.shape[1]
            late = [theta + state.nuisance[i, LATE] * (np.arange(N_THETA) == INDEX["delay"]) for theta in variants]
            framed = state.framed[i]
            phases = [None if framed is None else framed + state.nuisance[i, PHASE] + more for more in later]
            for j, drive in enumerate(drives_of(flight, late, phases)):
                for k, channel in enumerate(drive):
                    out[:, j, k, at : at + count] = channel[rows]
            at += count
        return out


def _firsts(which: Array) -> list[int]:
    """The first variant that uses each drive."""
    return [int(np.argmax(which == drive)) for drive in range(int(which.max()) + 1)]


def _filled(values: Array, seen: Array) -> Array:
    i = np.arange(len(values))
    return np.interp(i, i[seen], values[seen])


def _by_tilt(h: Array) -> Array:
    """Derivative (w, BINS, 6, 3) of a measured pose by a small tilt of the marker body about its own axes."""
    pitch, roll = h[..., 4], h[..., 5]
    sr, cr, tp, cp = np.sin(roll), np.cos(roll), np.tan(pitch), np.cos(pitch)
    out = np.zeros((*h.shape, 3))
    out[..., 3, 1], out[..., 3, 2] = sr / cp, cr / cp
    out[..., 4, 1], out[..., 4, 2] = cr, -sr
    out[..., 5, 0], out[..., 5, 1], out[..., 5, 2] = 1.0, tp * sr, tp * cr
    return out


def _by_lever(h: Array) -> Array:
    """Derivative (w, BINS, 6, 3) of a measured pose by the place of the markers in the body."""
    (sy, sp, sr), (cy, cp, cr) = (np.moveaxis(f(h[..., 3:]), -1, 0) for f in (np.sin, np.cos))
    out = np.zeros((*h.shape, 3))
    out[..., 0, :] = np.stack([cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr], axis=-1)
    out[..., 1, :] = np.stack([sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr], axis=-1)
    out[..., 2, :] = np.stack([-sp, cp * sr, cp * cr], axis=-1)
    return out


def _lever_turned(h: Array, lever: Array) -> Array:
    """Derivative (w, BINS, 3, 3) of the markers' position by yaw, pitch and roll."""
    base, out = _by_lever(h)[..., :3, :], np.empty((*h.shape[:2], 3, 3))
    for i in range(3):
        moved = h.copy()
        moved[..., 3 + i] += 1e-5
        out[..., i] = np.einsum("wbic,wc->wbi", (_by_lever(moved)[..., :3, :] - base) / 1e-5, lever)
    return out


def framed(problem: Problem, fitted: Fit) -> State:
    """Return the state of a fit with the frames of the radio, as `Problem.framed` finds them."""
    with threadpool_limits(limits=1):
        return problem.framed(fitted)


class Normal(NamedTuple):
    """The linearised problem after the projection of the first states."""

    matrix: Array
    """(m, m) sum of J' P J, of theta and then each log's nuisance."""
    vector: Array
    """(m,) sum of J' P r."""
    scores: Array
    """(w, m) J' P r of each window."""
    to_start: Callable[[Array], Array]
    """From a step (m,) to the steps (w, 12) of the first states."""
    reml: noise.Reml


def normal(problem: Problem, air: noise.Windage, eta: Array, rows: Array) -> Normal:
    """Return the normal equations of one Gauss-Newton step, and of the variances.

    Args:
        problem: The flights.
        air: The responses to wind and torque.
        eta: (9,) logarithms of `noise.COMPONENTS`.
        rows: (w, BINS, 6, .) derivatives by theta and a log's nuisance, the residual, derivatives by the first state.
    """
    w, n = len(problem.log_of), N_THETA + N_LOG
    gram, reml = np.zeros((w, n + 1 + N_START, n + 1 + N_START)), noise.Reml()
    for weights in noise.weighted(air, eta, with_parts=True):
        k, parts = weights.windows, noise.blocks(weights, rows)
        for matrix, part in parts.values():
            gram[k] += part.transpose(0, 2, 1) @ (matrix @ part)
        gram[k, n + 1 :, n + 1 :] += 1e-9 * np.eye(N_START)
        residual = {name: part[..., n : n + 1] for name, (_, part) in parts.items()}
        first = {name: part[..., n + 1 :] for name, (_, part) in parts.items()}
        reml.add(weights, residual, first, gram[k, n + 1 :, n + 1 :])
    inverse = np.linalg.inv(gram[:, n + 1 :, n + 1 :])
    back = inverse @ gram[:, n + 1 :, : n + 1]
    local = gram[:, : n + 1, : n + 1] - gram[:, : n + 1, n + 1 :] @ back
    m = N_THETA + len(problem.flights) * N_LOG
    matrix, scores = np.zeros((m, m)), np.zeros((w, m))
    places = [columns(int(log)) for log in problem.log_of]
    for i, c in enumerate(places):
        matrix[np.ix_(c, c)] += local[i, :n, :n]
        scores[i, c] = local[i, :n, n]

    def to_start(step: Array) -> Array:
        return back[..., n] - np.stack(
            [of_window @ step[c] for of_window, c in zip(back[..., :n], places, strict=True)]
        )

    return Normal(matrix, scores.sum(axis=0), scores, to_start, reml)


def columns(log: int) -> Array:
    """The places of theta and of a log's nuisance in the vector of all unknowns."""
    return np.concatenate([np.arange(N_THETA), N_THETA + log * N_LOG + np.arange(N_LOG)])


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
        begin: From an earlier fit of the same flights; None for the prior.
        progress: Called after every iteration.
        enough: Largest step, in posterior standard deviations, after which it stops.
        limit: Most iterations.
    """
    # More threads would add numbers in another order.
    with threadpool_limits(limits=1):
        return _fit(problem, begin, progress, enough, limit)


def _fit(problem: Problem, begin: State | None, progress: Callable[[], None], enough: float, limit: int) -> Fit:
    state, logs = begin or problem.initial(), len(problem.flights)
    spread = np.concatenate([problem.spread, np.tile(LOG_SPREAD, logs)])
    precision = np.diag(spread**-2.0)
    blind = 0 if begin else BLIND_ITERATIONS
    air, last = None, np.inf
    for iteration in range(1, limit + 1):
        if last > STALE:
            predicted, jacobian, first = problem.linearise(state)
        else:
            # The derivatives have hardly changed.
            predicted = problem.predict(state)
        residual = problem.residual(predicted)
        if air is None or iteration <= blind + 3:
            air = noise.windage(state.theta, problem.yaw, problem.frames)
        equations = normal(problem, air, state.eta, np.concatenate([jacobian, residual[..., None], first], axis=-1))
        eta, eta_covariance = equations.reml.step(state.eta)
        away = np.concatenate([state.theta - problem.prior, state.nuisance.ravel()])
        covariance = np.linalg.inv(equations.matrix + precision)
        step = covariance @ (equations.vector - precision @ away)
        last = float(np.max(np.abs(step[:N_THETA]) / np.sqrt(np.diag(covariance))[:N_THETA]))
        calm = bool(np.max(np.abs(eta - state.eta) / np.sqrt(np.diag(eta_covariance))) < 1.0)
        progress()
        if (iteration > blind + 1 and last < enough and calm) or iteration == limit:
            break
        step *= min(1.0, MAX_STEP / float(np.max(np.abs(step[:N_THETA]) / np.maximum(problem.spread, FIXED))))
        theta = state.theta + step[:N_THETA]
        for name in FIRST:
            theta[INDEX[name]] = max(theta[INDEX[name]], 0.0)
        state = State(
            theta,
            state.nuisance + step[N_THETA:].reshape(logs, N_LOG),
            state.start + equations.to_start(step),
            state.eta if iteration <= blind else eta,
            state.framed,
        )
    sandwich = _sandwich(problem, equations, covariance, precision)
    deviation = np.sqrt(np.maximum(np.diag(covariance), np.diag(sandwich)))[N_THETA:].reshape(logs, N_LOG)
    moved = np.einsum("wbic,wc->wbi", first, equations.to_start(np.zeros(len(step))))
    n = slice(0, N_THETA)
    return Fit(
        problem,
        state,
        covariance[n, n],
        sandwich[n, n],
        deviation,
        eta_covariance,
        last,
        iteration,
        residual - moved,
        predicted + moved,
        jacobian,
        first,
        air,
    )


def _sandwich(problem: Problem, equations: Normal, covariance: Array, precision: Array) -> Array:
    """The covariance from the scatter of the windows' scores, neighbours included, with the prior's share."""
    scores = equations.scores
    w = len(scores)
    meat = scores.T @ scores
    for lag in range(1, MEMORY_WINDOWS + 1):
        same = problem.log_of[lag:] == problem.log_of[:-lag]
        cross = scores[lag:][same].T @ scores[:-lag][same]
        meat += (1.0 - lag / (MEMORY_WINDOWS + 1)) * (cross + cross.T)
    told = N_THETA
    meat *= w / max(w - told, 0.2 * w)
    return covariance @ (meat + precision) @ covariance
