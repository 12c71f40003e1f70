"""Open-loop predictions of a flight: from a second of its poses, the next two seconds from the sent commands alone.

    y = h(theta, x0) + e,   e ~ N(0, C)

x0, the state at the begin of the second, is fitted to it; the prediction is the mean of y under the condition of the
poses seen so far, as a Kalman filter would predict: what is known of the wind fades with the gust's time. C says how
large the error of a right twin is.

Source: Rasmussen and Williams, Gaussian Processes for Machine Learning (2006), (2.41) and (2.42).
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from controllers.signals import Array
from heli_twin.calibration.data import BIN_STEPS, STEP_S, Cut, Flight
from heli_twin.calibration.fit import Fit, fit
from heli_twin.calibration.frames import framed, timed
from heli_twin.calibration.parameters import INDEX
from heli_twin.calibration.problem import FIXED, N_LOG, Problem, State
from heli_twin.validation.covariance import PLANE, weighted, windage
from heli_twin.validation.covariance import blocks as in_blocks
from heli_twin.validation.twins import Twin

BIN_S = BIN_STEPS * STEP_S
HISTORY_BINS = 50
"""Bins of poses that a prediction starts from: 1 s."""
HORIZON_BINS = 100
"""Bins that are predicted: 2 s."""
CUT = Cut(steps=(HISTORY_BINS + HORIZON_BINS) * BIN_STEPS, every=1000)
"""A prediction begins every second."""
HELD = 0.1 * FIXED
"""Spread of the prior of a parameter that is held."""


class Forecast(NamedTuple):
    """Predictions of one flight, piece by piece."""

    begin: Array
    """(w,) when each begins, s since the start of the log."""
    flown: Array
    """(w, HORIZON_BINS, 6) mean pose of each bin, x y z (m) yaw pitch roll (rad); NaN where there is no pose."""
    predicted: Array
    """(w, HORIZON_BINS, 6); NaN where there is no pose."""
    deviation: Array
    """(w, HORIZON_BINS, 6) standard deviation of the error of a right twin, cameras included."""
    last: Array
    """(w, 6) pose at the begin, from the poses up to then."""

    @property
    def error(self) -> Array:
        """Flown minus predicted (w, HORIZON_BINS, 6)."""
        return self.flown - self.predicted


def held_fit(flight: Flight, twin: Twin) -> Fit:
    """Fit what belongs to the day and not to the helicopter, with the twin's parameters held.

    That is a constant push, tilt and place of the markers, the phase of the radio's frames, and the strength of noise
    and gusts.

    Args:
        flight: In windows of 2 s.
        twin: Whose parameters are held.
    """
    problem = Problem([flight], twin.lab, twin.theta, np.full(len(twin.theta), HELD))
    begin = State(twin.theta.copy(), np.zeros((1, N_LOG)), problem.start.copy(), twin.eta.copy(), (None,), (0.0,))
    blind = fit(problem, begin, limit=1)
    begin = framed(problem, blind, twin.eta)
    if twin.theta[INDEX["servo_slowness"]] > 0.0:
        begin, _ = timed(problem, blind, begin)
    return fit(problem, begin, limit=3)


def forecast(pieces: Flight, twin: Twin, held: Fit) -> Forecast:
    """Predict a flight.

    Args:
        pieces: The flight, cut as `CUT` says.
        twin: Predicts.
        held: Of the same twin, for what belongs to the day.
    """
    with threadpool_limits(limits=1):
        return _forecast(pieces, twin, held)


def _forecast(pieces: Flight, twin: Twin, held: Fit) -> Forecast:
    problem = Problem([pieces], twin.lab, twin.theta, np.full(len(twin.theta), HELD))
    state = State(twin.theta, held.state.nuisance, problem.start.copy(), twin.eta, held.state.framed, held.state.servo)
    predicted, _, by_start = problem.linearise(state)
    windows = list(_windows(problem, twin, by_start))
    # The start is nearly linear in the poses: one step to it here, and the rest in the mean.
    residual = problem.residual(predicted)
    steps = [window.start(r) for window, r in zip(windows, residual, strict=True)]
    predicted = problem.predict(state._replace(start=state.start + np.stack(steps)))
    residual = problem.residual(predicted)
    mean = np.stack([window.future(r) for window, r in zip(windows, residual, strict=True)])
    ahead, seen = slice(HISTORY_BINS, None), problem.present[..., None]
    return Forecast(
        np.asarray(pieces.origin + STEP_S * pieces.windows.first + HISTORY_BINS * BIN_S, np.float64),
        np.where(seen, problem.y, np.nan)[:, ahead],
        np.where(seen, predicted, np.nan)[:, ahead] + mean,
        np.sqrt([window.variance() for window in windows]),
        np.where(seen, predicted, np.nan)[:, HISTORY_BINS] + mean[:, 0],
    )


class _Block(NamedTuple):
    """The channels of one window whose errors are correlated."""

    channels: tuple[int, ...]
    weighed: Array
    """(12, h) from the history's residual to the vector of the normal equations of the start."""
    cross: Array
    """(f, h) from the history's residual to the expected one of the future, with the start as it is."""
    by_start: Array
    """(f, 12) derivative of the expected future by the start."""
    variance: Array
    """(f,) of the future with the start known."""


class _Window(NamedTuple):
    """One window: what its history says is linear in its residual (bins, 6), 0 where there is no pose."""

    blocks: list[_Block]
    covariance: Array
    """(12, 12) of the start."""

    def start(self, residual: Array) -> Array:
        """Return the step (12,) of the start."""
        return self.covariance @ sum(b.weighed @ _history(residual, b.channels) for b in self.blocks)

    def future(self, residual: Array) -> Array:
        """Return the expected residual (HORIZON_BINS, 6), after a step of the start."""
        step, out = self.start(residual), np.empty((HORIZON_BINS, 6))
        for b in self.blocks:
            ahead = b.by_start @ step - b.cross @ _history(residual, b.channels)
            out[:, b.channels] = ahead.reshape(len(b.channels), HORIZON_BINS).T
        return out

    def variance(self) -> Array:
        """Return the variance (HORIZON_BINS, 6) of the error of a right twin."""
        out = np.empty((HORIZON_BINS, 6))
        for b in self.blocks:
            by_start = np.einsum("fi,ij,fj->f", b.by_start, self.covariance, b.by_start)
            out[:, b.channels] = (b.variance + by_start).reshape(len(b.channels), HORIZON_BINS).T
        return out


def _history(residual: Array, channels: tuple[int, ...]) -> Array:
    return residual[:HISTORY_BINS, channels].T.ravel()


def _windows(problem: Problem, twin: Twin, by_start: Array) -> Iterator[_Window]:
    """Yield each window, from the derivatives (w, bins, 6, 12) of its poses by its start."""
    yaw = np.stack([_filled(y[:, 3], seen) for y, seen in zip(problem.y, problem.present, strict=True)])
    for weights in weighted(windage(twin.theta, yaw, problem.frames), twin.eta):
        blocks = in_blocks(weights, by_start)
        for i in range(len(weights.log_det)):
            information, each = 1e-9 * np.eye(by_start.shape[-1]), list[_Block]()
            for name, channels in CHANNELS_OF.items():
                inverse, rows = (a[i] for a in blocks[name])
                block, of_block = _block(channels, inverse, rows)
                information += of_block
                each.append(block)
            yield _Window(each, np.asarray(np.linalg.inv(information), np.float64))


def _filled(values: Array, seen: NDArray[np.bool_]) -> Array:
    """Values (n,) with straight lines where they are not seen."""
    i = np.arange(len(values))
    return np.interp(i, i[seen], values[seen])


CHANNELS_OF: dict[str, tuple[int, ...]] = {"plane": PLANE, "z": (2,), "yaw": (3,)}
"""Channels of each block of `in_blocks`."""


def _block(channels: tuple[int, ...], inverse: Array, by_start: Array) -> tuple[_Block, Array]:
    """Return a block, and the information (12, 12) of its history on the start.

    Args:
        channels: Of the block.
        inverse: (n, n) inverse covariance of history and future, channel by channel.
        by_start: (n, 12) derivative by the start.
    """
    past = np.tile(np.arange(HISTORY_BINS + HORIZON_BINS) < HISTORY_BINS, len(channels))
    future = np.linalg.inv(inverse[np.ix_(~past, ~past)])
    cross = future @ inverse[np.ix_(~past, past)]
    history = inverse[np.ix_(past, past)] - inverse[np.ix_(past, ~past)] @ cross
    weighed = by_start[past].T @ history
    ahead = by_start[~past] + cross @ by_start[past]
    return _Block(channels, weighed, cross, ahead, np.asarray(np.diag(future), np.float64)), weighed @ by_start[past]
