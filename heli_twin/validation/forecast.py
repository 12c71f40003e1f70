"""Open-loop predictions of a flight: from a second of its poses, the next two seconds from the sent commands alone.

    y = h(theta, x0) + e,   e ~ N(0, C)

x0, the state at the begin of the second, is fitted to it; the prediction is the mean of y under the condition of the
poses seen so far, by the Kalman filter of the calibration: what is known of the wind fades with the gust's time. The
filter also says how large the error of a right twin is.

Source: Harvey, Forecasting, Structural Time Series Models and the Kalman Filter (1989), chapter 3.2 and 3.4.
"""

from typing import NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from controllers.signals import Array
from heli_twin.calibration import noise
from heli_twin.calibration.data import BIN_STEPS, STEP_S, Cut, Flight
from heli_twin.calibration.fit import Fit, fit
from heli_twin.calibration.frames import begun
from heli_twin.calibration.problem import Problem
from heli_twin.calibration.unknowns import FIXED, N_START, State
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
    return fit(problem, begun(problem, twin.theta, twin.eta), limit=3)


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
    predicted, _, first = problem.linearise(state)
    air = problem.windage(state)
    # The start is nearly linear in the poses: one step to it here, and the rest in the mean.
    step = _expected(air, twin.eta, first, problem.residual(predicted)).step
    predicted = problem.predict(state._replace(start=state.start + step[:, :N_START]))
    expected = _expected(air, twin.eta, first, problem.residual(predicted))
    ahead, seen = slice(HISTORY_BINS, None), problem.present[..., None]
    return Forecast(
        np.asarray(pieces.origin + STEP_S * pieces.windows.first + HISTORY_BINS * BIN_S, np.float64),
        np.where(seen, problem.y, np.nan)[:, ahead],
        np.where(seen, predicted, np.nan)[:, ahead] + expected.future,
        np.sqrt(expected.variance),
        np.where(seen, predicted, np.nan)[:, HISTORY_BINS] + expected.future[:, 0],
    )


class _Expected(NamedTuple):
    """What the history of each window says."""

    step: Array
    """(w, .) of the start, and of the frames in doubt."""
    future: Array
    """(w, HORIZON_BINS, 6) residual, after that step."""
    variance: Array
    """(w, HORIZON_BINS, 6) of the error of a right twin."""


def _expected(air: noise.Windage, eta: Array, first: Array, residual: Array) -> _Expected:
    """Return what the history says, from derivatives (w, bins, 6, .) by a window's own and residuals (w, bins, 6)."""
    n = first.shape[-1]
    seen = noise.foresee(air, eta, np.concatenate([first, residual[..., None]], axis=-1), HISTORY_BINS)
    past = seen.past.reshape(len(first), -1, n + 1)
    gram = past.transpose(0, 2, 1) @ past
    covariance = np.linalg.inv(gram[:, :n, :n] + noise.start_precision(n))
    step = np.einsum("wij,wj->wi", covariance, gram[:, :n, n])
    by_start = first[:, HISTORY_BINS:] - seen.mean[..., :n]
    future = seen.mean[..., n] + np.einsum("wkci,wi->wkc", by_start, step)
    of_start = np.einsum("wkci,wij,wkcj->wkc", by_start, covariance, by_start, optimize=True)
    return _Expected(step, future, seen.variance + of_start)
