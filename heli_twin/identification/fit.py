"""Least squares on one axis of (1), with intervals that allow for gusts; logs that say too little are refused.

Along every stretch of every log, and through a smooth window (see `data`),

    accel(t) = b u(t - delay) + k speed(t) + push + residual

The input acts after a delay, part of which may be a first-order lag: radio, servo, attitude, rotor, everything that (1)
leaves out. Delay and lag are fitted, so that they do not bias b and k, and the delay is reported. The push is constant
within a stretch: a wrong trim or a draught.

Residuals are gusts, which are correlated in time: intervals are Newey and West's, whose sums of lagged products reach
over `MEMORY_S`, with critical values for that many lags; `MODEL_ERROR` of the value is added to each half-width for
other effects that (1) leaves out. Measured on 36 flights of 60 s in the plane and 12 of 40 s in height and yaw of the
default twin, each identified by itself: 94 % of the intervals contained the estimators' own mean before that was added,
and the means were within 1.1 % of (27), b_y furthest.

Sources: Kunz, Huck, Summers, ECC 2013, (1), (27); Newey and West, Econometrica 1987; Kiefer and Vogelsang,
Econometric Theory 2005 (fixed-b critical values).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from controllers.signals import Array
from heli_twin.errors import HeliTwinError
from heli_twin.identification.data import GRID_S, ROW_S, Equation, Stretch

MEMORY_S = 3.0
"""Residuals further apart than this are taken as independent: four times the correlation time of a gust in a room."""
MODEL_ERROR = 0.01
"""Bias of b and k, as a share of them, that tilting about two axes at once and overshooting attitude can cause."""
MAX_DELAY_S = 0.4
"""Longest delay that is searched."""


class IdentificationError(HeliTwinError):
    """The logs say too little, or what they say is wrong; the message is one sentence."""


class Parameter(NamedTuple):
    """An estimate and its 95 % interval."""

    value: float
    low: float
    high: float


class Needs(NamedTuple):
    """The least excitation of an axis that gives an answer."""

    input: float
    """Standard deviation of the input, fraction of full stick."""
    input_name: str


NEEDS = {
    "x": Needs(0.1, "pitch input"),
    "y": Needs(0.1, "roll input"),
    "z": Needs(0.015, "thrust input"),
    "yaw": Needs(0.02, "yaw input"),
}
"""About a third of the excitation by the doublets of the default experiments."""
MIN_OWN_VARIANCE = 0.02
"""Least share of the input's variance that the other regressors must leave unexplained."""
SMALLEST_DIRECTION = 0.1
"""Least singular value, over the greatest, of a direction of push that is fitted: about 0.2 rad of yaw."""
MAX_RELATIVE_HALF_WIDTH = 0.2
"""Greatest half-width of an interval, over the value; for k over 0.5 1/s at least."""
SMALLEST_K_SCALE = 0.5
"""1/s."""
REMEDY = "`heli-twin identify` without logs flies such doublets, and any flight of `trajectory=doublets` can be added"


class AxisFit(NamedTuple):
    """The identified parameters of one axis, and what the fit leaves."""

    b: Parameter
    k: Parameter | None
    """None in z, which has no damping in (1)."""
    delay: Parameter
    """From a command to its effect, s, lag included."""
    lag: float
    """The part of the delay that is a first-order lag, s."""
    time: tuple[Array, ...]
    """Per stretch: s."""
    accel: tuple[Array, ...]
    """Per stretch: the windowed left-hand side."""
    residual: tuple[Array, ...]
    """Per stretch: left-hand side minus fit."""

    @property
    def explained(self) -> float:
        """Share of the acceleration's variance that the fit explains."""
        total = sum(float(np.sum((a - a.mean()) ** 2)) for a in self.accel)
        return 1.0 - sum(float(np.sum(r**2)) for r in self.residual) / total

    @property
    def residual_rms(self) -> float:
        """Root mean square of the residuals, m/s^2 or rad/s^2."""
        return float(np.sqrt(np.mean(np.concatenate(self.residual) ** 2)))


def fit_axis(axis: str, pieces: Sequence[Stretch]) -> AxisFit:
    """Identify one axis from the stretches that excite it; on others its input only reacts to noise.

    Args:
        axis: x, y, z or yaw.
        pieces: Stretches of all flights.

    Raises:
        IdentificationError: They say too little; the message names the value and the limit.

    Source: Kunz, Huck, Summers, ECC 2013, (1), (27).
    """
    pieces = excited(axis, pieces)
    equations = [piece.axes[axis] for piece in pieces]
    accel = np.concatenate([e.accel for e in equations])
    ends = np.cumsum([len(e.accel) for e in equations])
    delay, lag = _delay_and_lag(equations, accel)
    X = _columns(equations, delay, lag)
    theta, residual = _solve(X, accel)
    slopes = _slopes(equations, delay, lag, theta[0])
    half = half_widths(np.column_stack([X, slopes[:, :1] if lag == 0.0 else slopes]), residual, ends)

    def parameter(i: int) -> Parameter:
        width = float(half[i] + MODEL_ERROR * abs(theta[i]))
        return Parameter(float(theta[i]), float(theta[i]) - width, float(theta[i]) + width)

    width = float(half[len(theta)])
    fit = AxisFit(
        b=parameter(0),
        k=None if equations[0].speed is None else parameter(1),
        delay=Parameter(delay, delay - width, delay + width),
        lag=lag,
        time=tuple(piece.time for piece in pieces),
        accel=tuple(e.accel for e in equations),
        residual=tuple(np.split(residual, ends[:-1])),
    )
    check_answer(axis, fit)
    return fit


def _delay_and_lag(equations: Sequence[Equation], accel: Array) -> tuple[float, float]:
    """Delay, s, and the part of it that is a lag, s, with the smallest residuals: Gauss-Newton from a grid search."""

    def misfit(delay: float) -> float:
        return float(np.sum(_solve(_columns(equations, delay, 0.0), accel)[1] ** 2))

    delay, lag = float(min(np.arange(0.0, MAX_DELAY_S, 0.02), key=misfit)), 0.02
    for _ in range(10):
        X = _columns(equations, delay, lag)
        theta, residual = _solve(X, accel)
        slopes = _slopes(equations, delay, lag, theta[0])
        step = _solve(np.column_stack([X, slopes]), residual)[0][-2:]
        if lag + step[1] < 0.0:
            # At its bound the lag is fixed, and only the delay is changed.
            step = np.append(_solve(np.column_stack([X, slopes[:, :1]]), residual)[0][-1], -lag)
        delay = float(np.clip(delay + step[0], -GRID_S, MAX_DELAY_S))
        lag = float(np.clip(lag + step[1], 0.0, max(delay, 0.0)))
        if abs(step).max() < 1e-6:
            break
    return delay, lag


def _slopes(equations: Sequence[Equation], delay: float, lag: float, b: float) -> Array:
    """Derivatives (n, 2) of the right-hand side with respect to the delay and the lag, per s."""
    at = [(delay + GRID_S, lag), (delay - GRID_S, lag), (delay, lag + GRID_S), (delay, max(lag - GRID_S, 0.0))]
    later, sooner, slower, quicker = (np.concatenate([e.input(*a) for e in equations]) for a in at)
    return b * np.column_stack([(later - sooner) / (2.0 * GRID_S), (slower - quicker) / (GRID_S + min(lag, GRID_S))])


def _solve(X: Array, y: Array) -> tuple[Array, Array]:
    """Least squares: coefficients and residuals."""
    theta = np.asarray(np.linalg.lstsq(X, y, rcond=None)[0], np.float64)
    return theta, y - X @ theta


def _columns(equations: Sequence[Equation], delay: float, lag: float) -> Array:
    """The regressors (n, p): input, speed if any, and the pushes of each stretch."""
    moving, pushes = [], []
    for e in equations:
        now = e.input(delay, lag)
        moving.append(now[:, None] if e.speed is None else np.column_stack([now, e.speed]))
        pushes.append(_directions(e.push))
    block, row, column = np.zeros((sum(map(len, pushes)), sum(push.shape[1] for push in pushes))), 0, 0
    for push in pushes:
        block[row : row + push.shape[0], column : column + push.shape[1]] = push
        row, column = row + push.shape[0], column + push.shape[1]
    return np.hstack([np.vstack(moving), block])


def _directions(push: Array) -> Array:
    """The independent directions (n, 1 or 2) of a push: two only where the helicopter turned enough."""
    U, size, _ = np.linalg.svd(push, full_matrices=False)
    return U[:, size > SMALLEST_DIRECTION * size[0]] * size[0]


def half_widths(X: Array, residual: Array, ends: Array) -> Array:
    """Half-widths (p,) of the 95 % intervals of least squares whose residuals are correlated in time.

    Args:
        X: (n, p) regressors.
        residual: (n,).
        ends: Row after the last of each stretch; residuals of different stretches are independent.

    Source: Newey and West, Econometrica 1987; Kiefer and Vogelsang, Econometric Theory 2005 (critical value).
    """
    n, lags = len(X), round(MEMORY_S / ROW_S)
    moments = X * residual[:, None]
    S = moments.T @ moments
    for begin, end in zip([0, *ends[:-1]], ends, strict=True):
        for lag in range(1, min(lags, end - begin - 1) + 1):
            product = moments[begin + lag : end].T @ moments[begin : end - lag]
            S += (1.0 - lag / (lags + 1)) * (product + product.T)
    bread = np.linalg.pinv(X.T @ X)
    share = lags / n
    critical = 1.96 + 2.9694 * share + 0.416 * share**2 - 0.5324 * share**3
    return critical * np.sqrt(np.maximum(np.diag(bread @ S @ bread), 0.0) * n / max(n - X.shape[1], 1))


def excited(axis: str, pieces: Sequence[Stretch]) -> list[Stretch]:
    """The stretches that excite an axis.

    Raises:
        IdentificationError: There is none; the message names the value and the limit.
    """
    needs, best, same = NEEDS[axis], 0.0, 0.0
    usable: list[Stretch] = []
    for piece in pieces:
        e = piece.axes[axis]
        steady, u = _directions(e.push), e.input(0.1, 0.0)
        own = _solve(steady, u)[1]
        best = max(best, float(own.std()))
        if own.std() < needs.input:
            continue
        if e.speed is not None:
            alone = _solve(np.column_stack([steady, e.speed]), u)[1]
            same = 1.0 - float(alone.var() / own.var())
            if same > 1.0 - MIN_OWN_VARIANCE:
                continue
        usable.append(piece)
    if usable:
        return usable
    if best < needs.input:
        raise IdentificationError(
            f"{axis} is hardly excited: its {needs.input_name} varies by {best:.3f} of full stick, {needs.input:g} is "
            f"needed to see its response through gusts and noise; {REMEDY}"
        )
    raise IdentificationError(
        f"gain and damping of {axis} cannot be told apart: its speed explains {100 * same:.1f} % of its "
        f"{needs.input_name}, at most {100 * (1 - MIN_OWN_VARIANCE):.0f} % is allowed; {REMEDY}"
    )


def check_answer(axis: str, fit: AxisFit) -> None:
    """Refuse an answer with the wrong sign, or with too wide an interval.

    Raises:
        IdentificationError: The message names the value and the limit.
    """
    b, k = fit.b, fit.k
    if b.value <= 0.0:
        raise IdentificationError(
            f"{axis} accelerates against its input (b_{axis} = {b.value:.3g}): check the signs of the logged commands "
            "and the frame of the poses (x north, y west, z up)"
        )
    least = {f"b_{axis}": (b, b.value)} | ({f"k_{axis}": (k, max(-k.value, SMALLEST_K_SCALE))} if k else {})
    for name, (parameter, scale) in least.items():
        width = 0.5 * (parameter.high - parameter.low)
        if width > MAX_RELATIVE_HALF_WIDTH * scale:
            raise IdentificationError(
                f"{name} is too uncertain: it is {parameter.value:.3g} +- {width:.2g}, and +- "
                f"{MAX_RELATIVE_HALF_WIDTH * scale:.2g} is allowed; "
                f"add longer flights that move {axis} more: {REMEDY}"
            )
