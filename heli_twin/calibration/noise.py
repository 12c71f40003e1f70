"""The covariance of what the twin cannot predict in a window: gusts through drag and attitude, cameras, timing.

A Kalman filter along each window whitens residuals and their derivatives; its state is what chance adds to the
prediction. Wind is an Ornstein-Uhlenbeck process on both axes of the room; it moves the helicopter as the twin's
equations say, linearised along the window. Small white accelerations stand for lost frames and the timing of servos.
The cameras have white noise and a slow error of 5 s.

    s' = T s + chance,   residual = Z s + white noise

The variances and the gust's time are estimated by REML: maximum likelihood of what remains after the projection of each
window's own first state and of the parameters, which would take slow wind for their own, by Newton steps with Fisher's
information.

Sources: Patterson and Thompson, Biometrika 58 (1971) (REML); Harvey, Forecasting, Structural Time Series Models and the
Kalman Filter (1989), chapter 3.4 (likelihood and information from innovations).
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from controllers.signals import Array
from heli_twin.calibration.data import BIN_STEPS, STEP_S
from heli_twin.calibration.motion import Transitions

BIN_S = BIN_STEPS * STEP_S
SLOW_TIME_S = 5.0
"""In which the slow error of the cameras changes: taken as known."""
COMPONENTS = (
    "gust_strength",
    "gust_time",
    "attitude_jitter",
    "slow_position_noise",
    "position_noise",
    "orientation_noise",
    "height_jitter",
    "yaw_jitter",
    "yaw_noise",
)
"""Standard deviations (and the gust's time): wind m/s, s, rad/s^2, m, m, rad, m/s^2, rad/s^2, rad."""
PRIOR = np.array([0.2, 0.7, 0.5, 0.0005, 0.0003, 0.005, 0.1, 2.0, 0.005])
PRIOR_SPREAD = np.array([1.5, 0.5, 2.0, 0.7, 0.7, 0.7, 2.0, 2.0, 0.7])
"""Standard deviation of the prior of each logarithm."""
FIRST_WIND = 3.0
"""Standard deviation of the wind at a window's start, m/s, for the parameters: as good as unknown. What the controller
did about it before the window shows in the first commands, which are no chance then. For the variances it is that of
any other moment: what an unknown one leaves depends on the gust's time itself, which then comes out a sixth short."""
POSE, RATE, WIND, SLOW = slice(0, 6), slice(6, 12), slice(12, 14), slice(14, 17)
N, N_FIRST = 17, 12
"""States of the filter, and of a window's start."""
SLOPE_STEP, LONGEST_STEP = 1e-3, 0.7
"""Of the logarithm of a component: for a slope, and from one step to the next."""


def start_precision(columns: int) -> Array:
    """Return the prior's precision of what belongs to a window, a diagonal matrix.

    Args:
        columns: Of its first state, as good as unknown, and of the frames in doubt, in standard deviations.
    """
    return np.diag([1e-9] * N_FIRST + [1.0] * (columns - N_FIRST))


class Windage(NamedTuple):
    """Covariance of gusts and cameras in each window; it changes slowly with the parameters."""

    transitions: Transitions
    frames: Array
    """(w, bins) poses in each bin."""


class _Filter:
    """The Kalman filter along all windows, for several columns of rows that share the covariance.

    Args:
        air: The responses.
        eta: (9,) logarithms of `COMPONENTS`.
        columns: Of the rows.
        first_wind: Standard deviation of the wind at the start, m/s.
    """

    def __init__(self, air: Windage, eta: Array, columns: int, first_wind: float = FIRST_WIND) -> None:
        s, w = np.exp(2.0 * eta), len(air.frames)
        self._air, self._white = air, np.array([s[4], s[4], s[4], s[8], s[5], s[5]])
        self._transition, self._seen = np.zeros((w, N, N)), np.zeros((w, 6, N))
        self._transition[:, WIND, WIND] = np.exp(-BIN_S / np.exp(eta[1])) * np.eye(2)
        self._transition[:, SLOW, SLOW] = np.exp(-BIN_S / SLOW_TIME_S) * np.eye(3)
        self._chance, begin = _chance(eta, first_wind)
        # The covariance and the rows' states beside it: one product moves both.
        self._both = np.zeros((w, N, N + columns))
        self._both[:, range(N), range(N)] = begin

    def _poses(self, k: int) -> Array:
        """The pose (w, 6, N) of a bin by the state."""
        t = self._air.transitions
        self._seen[:, :, :12], self._seen[:, :, WIND] = t.pose[:, k], t.pose_by_wind[:, k]
        self._seen[:, :, SLOW] = np.eye(6, 3)
        return self._seen

    def learn(self, k: int, rows: Array) -> tuple[Array, Array]:
        """Take the rows (w, 6, c) of a bin; return them whitened, and the roots (w, 6, 6) of their covariance."""
        is_seen = self._air.frames[:, k] > 0
        seen = self._poses(k)
        seen *= is_seen[:, None, None]
        noise = np.where(is_seen[:, None], self._white / np.maximum(self._air.frames[:, k], 1.0)[:, None], np.ones(6))
        at_poses = seen @ self._both
        innovation = at_poses[..., :N] @ seen.transpose(0, 2, 1)
        innovation[:, range(6), range(6)] += noise
        root = np.linalg.cholesky(innovation)
        at_poses[..., N:] -= rows
        # Many small systems: the inverse takes an eighth of the time of a solution.
        white = np.linalg.inv(root) @ at_poses
        self._both -= white[..., :N].transpose(0, 2, 1) @ white
        return -white[..., N:], np.asarray(root, np.float64)

    def foresee(self, k: int) -> tuple[Array, Array]:
        """Return the rows (w, 6, c) to be expected in a bin, and the variance (w, 6) of a pose about them."""
        seen = self._poses(k)
        variance = np.einsum("wij,wjk,wik->wi", seen, self._both[..., :N], seen, optimize=True)
        return seen @ self._both[..., N:], variance + self._white / np.maximum(self._air.frames[:, k], 1.0)[:, None]

    def advance(self, k: int) -> None:
        """Go on from a bin to the next."""
        t, transition = self._air.transitions, self._transition
        transition[:, :12, :12], transition[:, :12, WIND] = t.state[:, k], t.state_by_wind[:, k]
        self._both = transition @ self._both
        self._both[..., :N] = self._both[..., :N] @ transition.transpose(0, 2, 1) + self._chance


def whiten(air: Windage, eta: Array, rows: Array, first_wind: float = FIRST_WIND) -> tuple[Array, Array]:
    """Make residuals and derivatives independent of those before them.

    Args:
        air: The responses.
        eta: (9,) logarithms of `COMPONENTS`.
        rows: (w, bins, 6, c), 0 where there is no pose.
        first_wind: Standard deviation of the wind at the start, m/s.

    Returns:
        The rows, whitened, and the roots (w, bins, 6, 6) of the innovations' covariances.
    """
    w, bins, _, c = rows.shape
    filtered, out, roots = _Filter(air, eta, c, first_wind), np.empty_like(rows), np.empty((w, bins, 6, 6))
    for k in range(bins):
        out[:, k], roots[:, k] = filtered.learn(k, rows[:, k])
        filtered.advance(k)
    return out, roots


class Foreseen(NamedTuple):
    """What the first bins of each window say of the others."""

    past: Array
    """(w, history, 6, c) rows of the first bins, whitened."""
    mean: Array
    """(w, bins - history, 6, c) rows to be expected in the others."""
    variance: Array
    """(w, bins - history, 6) of a pose about them."""


def foresee(air: Windage, eta: Array, rows: Array, history: int) -> Foreseen:
    """Return what chance does next, after the first `history` bins; arguments as in `whiten`."""
    filtered, past = _Filter(air, eta, rows.shape[-1]), np.empty_like(rows[:, :history])
    mean, variance = np.empty_like(rows[:, history:]), np.empty_like(rows[:, history:, :, 0])
    for k in range(rows.shape[1]):
        if k < history:
            past[:, k], _ = filtered.learn(k, rows[:, k])
        else:
            mean[:, k - history], variance[:, k - history] = filtered.foresee(k)
        filtered.advance(k)
    return Foreseen(past, mean, variance)


def _chance(eta: Array, first_wind: float) -> tuple[Array, Array]:
    """Covariance (N, N) of what each bin adds, and variances (N,) at the start of a window."""
    s = np.exp(2.0 * eta)
    chance, begin = np.zeros((N, N)), np.zeros(N)
    for i, variance in {2: s[6], 3: s[7], 4: s[2], 5: s[2]}.items():
        # A white acceleration that is constant in the bin.
        effect = np.array([0.5 * BIN_S**2, BIN_S])
        chance[np.ix_([i, 6 + i], [i, 6 + i])] = variance * np.outer(effect, effect)
    chance[WIND, WIND] = s[0] * (1.0 - np.exp(-2.0 * BIN_S / np.exp(eta[1]))) * np.eye(2)
    chance[SLOW, SLOW] = s[3] * (1.0 - np.exp(-2.0 * BIN_S / SLOW_TIME_S)) * np.eye(3)
    begin[WIND], begin[SLOW] = first_wind**2, s[3]
    return chance, begin


class Explained(NamedTuple):
    """What residuals lose to the parameters that are fitted to them."""

    jacobian: Array
    """(w, bins, 6, n) derivative of the prediction by the parameters, 0 where there is no pose."""
    taken: Callable[[Array, Array], tuple[float, float]]
    """From the information (w, n, n) of each window on the parameters, and J' P r (w, n), to the logarithm of the
    determinant of all information, and to how much less the weighted square is with the parameters fitted to it."""


def next_variances(
    air: Windage, eta: Array, residual: Array, first: Array, explained: Explained | None = None
) -> tuple[Array, Array]:
    """Return the variances after one REML step, and the covariance of their logarithms.

    Args:
        air: The responses.
        eta: (9,) logarithms of `COMPONENTS`.
        residual: (w, bins, 6) poses minus prediction, 0 where there is no pose.
        first: (w, bins, 6, .) derivative of the prediction by what belongs to each window.
        explained: By parameters that were fitted; None if they are known.
    """
    parts = [first, explained.jacobian] if explained else [first]
    rows = np.concatenate([*parts, residual[..., None]], axis=-1)

    def at(eta: Array) -> _Restricted:
        white, roots = whiten(air, eta, rows, float(np.exp(eta[0])))
        return _Restricted(white, roots, first.shape[-1], explained)

    here = at(eta)
    started = here.started
    score, changes = np.zeros(len(eta)), []
    for i, each in enumerate(np.eye(len(eta))):
        there = at(eta + SLOPE_STEP * each)
        score[i] = (there.likelihood - here.likelihood) / SLOPE_STEP
        # Change of the innovations' covariance and of the innovations, both whitened: Fisher's information.
        scale = np.linalg.solve(here.roots, there.roots)
        by_mean = (scale @ there.less(here.start)[..., None])[..., 0] - started
        by_root = scale - np.eye(6)
        spread = by_root + by_root.transpose(0, 1, 3, 2)
        changes.append(np.concatenate([spread.ravel() / np.sqrt(2.0), by_mean.ravel()]) / SLOPE_STEP)
    change, prior = np.stack(changes), np.diag(PRIOR_SPREAD**-2.0)
    covariance = np.asarray(np.linalg.inv(change @ change.T + prior), np.float64)
    step = covariance @ (score - prior @ (eta - np.log(PRIOR)))
    return eta + np.clip(step, -LONGEST_STEP, LONGEST_STEP), covariance


class _Restricted:
    """The restricted likelihood of whitened rows (w, bins, 6, c).

    They are derivatives by what belongs to a window, `own` columns, then by the parameters, and the residual.
    """

    def __init__(self, rows: Array, roots: Array, own: int, explained: Explained | None) -> None:
        self.rows, self.roots, self._own = rows, roots, own
        flat = rows.reshape(len(rows), -1, rows.shape[-1])
        gram = flat.transpose(0, 2, 1) @ flat
        of_first = gram[:, :own, :own] + start_precision(own)
        back = np.linalg.solve(of_first, gram[:, :own, own:])
        local = gram[:, own:, own:] - gram[:, own:, :own] @ back
        self.start = np.asarray(back[..., -1], np.float64)
        """(w, own) first states and frames."""
        log_det = 2.0 * np.log(np.diagonal(roots, axis1=2, axis2=3)).sum() + np.linalg.slogdet(of_first)[1].sum()
        square = local[:, -1, -1].sum()
        if explained:
            more, taken = explained.taken(local[:, :-1, :-1], local[:, :-1, -1])
            log_det, square = log_det + more, square - taken
        self.likelihood = -0.5 * float(log_det + square)

    def less(self, start: Array) -> Array:
        """Return the residual (w, bins, 6) less what first states and frames (w, own) explain."""
        return self.rows[..., -1] - np.einsum("wbic,wc->wbi", self.rows[..., : self._own], start)

    @property
    def started(self) -> Array:
        """The residual (w, bins, 6) less what its own first states explain."""
        return self.less(self.start)
