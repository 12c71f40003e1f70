"""Gains and damping of each axis of (1) from flight logs: least squares, intervals that know of gusts, and a refusal.

Per axis, along every stretch of every log, and through a smooth window (see `identification_data`),

    accel(t) = b (u + c u'')(t - delay) + k speed(t) + push + residual

The delay and the curvature c stand for everything between a command and its effect that (1) leaves out: radio, servo,
attitude, rotor. They are fitted and reported, not used. The push is a trim that is off, a draught, a slope of the
floor's calibration: one a stretch. Residuals are gusts that last, not noise that averages out: intervals are
Newey and West's, whose sums of lagged products reach over `MEMORY`, with critical values for that many lags.

Sources: Kunz, Huck, Summers, ECC 2013, (1), (27); Newey and West, Econometrica 1987; Kiefer and Vogelsang,
Econometric Theory 2005 (fixed-b critical values).
"""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from controllers.signals import Array
from heli_twin.errors import HeliTwinError
from heli_twin.identification_data import GRID, ROW, Equation, Stretch, stretches
from heli_twin.recording import Log

MEMORY = 3.0
"""Residuals further apart than this, s, are taken for independent: four times what a gust in a room lasts."""
LATEST = 0.3
"""Longest delay that is looked for, s."""
CURVED = 0.05
"""Half-width of the second difference of the input, s: the lags that it stands for are about as long."""


class IdentificationError(HeliTwinError):
    """Logs that do not say what was asked of them."""


class Parameter(NamedTuple):
    """An estimate and its 95 % interval."""

    value: float
    low: float
    high: float

    def as_json(self) -> dict[str, Any]:
        """For programs."""
        return {"value": self.value, "interval": [self.low, self.high]}


class Needs(NamedTuple):
    """The least that has to happen on an axis for an answer."""

    input: float
    """Standard deviation of the input, full stick."""
    input_name: str


NEEDS = {
    "x": Needs(0.1, "pitch input"),
    "y": Needs(0.1, "roll input"),
    "z": Needs(0.015, "thrust input"),
    "yaw": Needs(0.02, "yaw input"),
}
"""About a third of what the doublets of the default experiments do."""
DISTINCT = 0.05
"""Share of the input's variance that nothing else in the regression may explain."""
WIDEST = 0.2
"""Half-width of an interval over its value that still is an answer; for a k near 0, the same in 1/s over 2."""
REMEDY = "`heli-twin identify` without logs flies such doublets, and any flight of `trajectory=doublets` can be added"


class AxisFit(NamedTuple):
    """What the logs say of one axis."""

    b: Parameter
    k: Parameter | None
    """None in z."""
    delay: Parameter
    """From a command to its effect, s, lags included."""
    time: tuple[Array, ...]
    """Per stretch: s."""
    accel: tuple[Array, ...]
    """Per stretch: the left-hand side through the window."""
    residual: tuple[Array, ...]
    """Per stretch: what the fit leaves of it."""

    @property
    def explained(self) -> float:
        """Share of the acceleration's variance that the fit explains."""
        total = sum(float(np.sum((a - a.mean()) ** 2)) for a in self.accel)
        return 1.0 - sum(float(np.sum(r**2)) for r in self.residual) / total

    @property
    def residual_rms(self) -> float:
        """m/s^2 or rad/s^2."""
        return float(np.sqrt(np.mean(np.concatenate(self.residual) ** 2)))


class Identified(NamedTuple):
    """A helicopter as its logs show it."""

    fits: dict[str, AxisFit]
    logs: tuple[str, ...]
    seconds: float
    """Of flight that was used."""

    @property
    def parameters(self) -> dict[str, Parameter]:
        """By the names of controllers.model.Model."""
        found = {}
        for axis, fit in self.fits.items():
            found[f"b_{axis}"] = fit.b
            if fit.k is not None:
                found[f"k_{axis}"] = fit.k
        return found

    def as_json(self) -> dict[str, Any]:
        """The result as `heli-twin identify --json` prints it."""
        return {
            "parameters": {name: p.as_json() for name, p in self.parameters.items()},
            "delays": {axis: fit.delay.as_json() for axis, fit in self.fits.items()},
            "explained": {axis: fit.explained for axis, fit in self.fits.items()},
            "residual_rms": {axis: fit.residual_rms for axis, fit in self.fits.items()},
            "seconds": self.seconds,
            "logs": list(self.logs),
        }

    def as_toml(self) -> str:
        """A table for `heli-twin fly`: a file of its own, or `controller.model=FILE.toml`."""
        lines = ["# identified from flight logs; 95 % intervals behind", "[controller.model]"]
        for name, p in self.parameters.items():
            # (1) has no negative damping: an estimate of none may come out on either side of 0.
            value = min(p.value, 0.0) if name.startswith("k") else p.value
            lines.append(f"{name} = {value:.5g}  # {p.low:.5g} to {p.high:.5g}")
        return "\n".join(lines) + "\n"


def identify(logs: Iterable[tuple[str, Log]]) -> Identified:
    """Identify (27) from flights.

    Args:
        logs: Name and log of each flight.

    Raises:
        IdentificationError: They say too little of an axis; the message names it, what was found and what is needed.
    """
    names: list[str] = []
    pieces: list[Stretch] = []
    for name, log in logs:
        names.append(name)
        pieces += stretches(log, name)
    if not pieces:
        raise IdentificationError(
            f"no usable flight in {', '.join(names) or 'no logs'}: it takes 5 s with poses and sent commands, higher than "
            f"0.2 m; {REMEDY}"
        )
    fits = {axis: _fit(axis, pieces) for axis in NEEDS}
    return Identified(fits, tuple(names), sum(float(p.time[-1] - p.time[0]) for p in pieces))


def _fit(axis: str, pieces: Sequence[Stretch]) -> AxisFit:
    """Least squares on one axis: linear but for the delay, which is found by Gauss-Newton from the best of a grid."""
    equations = [piece.axes[axis] for piece in pieces]
    accel = np.concatenate([e.accel for e in equations])
    ends = np.cumsum([len(e.accel) for e in equations])
    damped = equations[0].speed is not None

    def solve(delay: float) -> tuple[Array, Array, Array]:
        X = _columns(equations, delay)
        theta = np.linalg.lstsq(X, accel, rcond=None)[0]
        return X, theta, accel - X @ theta

    check_excitation(axis, _columns(equations, 0.1))
    delay = float(min(np.arange(0.0, LATEST, 0.02), key=lambda d: np.sum(solve(d)[2] ** 2)))
    for _ in range(6):
        X, theta, residual = solve(delay)
        later = (_columns(equations, delay + GRID) - _columns(equations, delay - GRID)) @ theta / (2.0 * GRID)
        X = np.column_stack([X, later])
        delay = float(np.clip(delay + np.linalg.lstsq(X, residual, rcond=None)[0][-1], -GRID, LATEST))
    spread = half_widths(X, residual, ends)
    values = [Parameter(v, v - h, v + h) for v, h in zip([*theta.tolist(), delay], spread.tolist(), strict=True)]
    fit = AxisFit(
        b=values[0],
        k=values[2] if damped else None,
        delay=values[-1],
        time=tuple(piece.time for piece in pieces),
        accel=tuple(e.accel for e in equations),
        residual=tuple(np.split(residual, ends[:-1])),
    )
    check_answer(axis, fit)
    return fit


def _columns(equations: Sequence[Equation], delay: float) -> Array:
    """The regressors for a delay, s: input, its curvature, speed if any, and the pushes of each stretch."""
    moving, pushes = [], []
    for e in equations:
        now = e.input(delay)
        curvature = (e.input(delay + CURVED) - 2.0 * now + e.input(delay - CURVED)) / CURVED**2
        moving.append(np.column_stack([now, curvature] if e.speed is None else [now, curvature, e.speed]))
        pushes.append(_directions(e.push))
    width = sum(push.shape[1] for push in pushes)
    block, at = np.zeros((sum(map(len, pushes)), width)), [0, 0]
    for push in pushes:
        rows, columns = push.shape
        block[at[0] : at[0] + rows, at[1] : at[1] + columns] = push
        at = [at[0] + rows, at[1] + columns]
    return np.hstack([np.vstack(moving), block])


def _directions(push: Array) -> Array:
    """The directions of a push that can be told apart: two only where the helicopter turned."""
    U, size, _ = np.linalg.svd(push, full_matrices=False)
    return U[:, size > 0.1 * size[0]] * size[0]


def half_widths(X: Array, residual: Array, ends: Array) -> Array:
    """Half-widths of the 95 % intervals of least squares whose residuals have a memory.

    Args:
        X: (n, p) regressors.
        residual: (n,).
        ends: Row after the last of each stretch; across these nothing is remembered.
    """
    n, lags = len(X), round(MEMORY / ROW)
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


def check_excitation(axis: str, X: Array) -> None:
    """Refuse logs that do not move an axis, or move it in one way only.

    Args:
        axis: Its name.
        X: (n, p) regressors, the input first.

    Raises:
        IdentificationError: What was found and what is needed.
    """
    needs, damped = NEEDS[axis], axis != "z"
    u = _beyond(X[:, 0], X[:, 2 + damped :])
    if u.std() < needs.input:
        raise IdentificationError(
            f"{axis} is hardly excited: its {needs.input_name} varies by {u.std():.3f} of full stick, {needs.input:g} is "
            f"needed to see gain and damping through gusts and noise; {REMEDY}"
        )
    own = float(np.mean(_beyond(X[:, 0], X[:, 1 + (not damped) :]) ** 2) / np.mean(u**2)) if damped else 1.0
    if own < DISTINCT:
        raise IdentificationError(
            f"gain and damping of {axis} cannot be told apart: its speed explains {100 * (1 - own):.0f} % of its "
            f"{needs.input_name}, at most {100 * (1 - DISTINCT):.0f} % is needed; {REMEDY}"
        )


def _beyond(column: Array, others: Array) -> Array:
    """What a column has that the others do not explain."""
    return column - others @ np.linalg.lstsq(others, column, rcond=None)[0]


def check_answer(axis: str, fit: AxisFit) -> None:
    """Refuse an answer with the wrong sign, or too vague to fly on.

    Raises:
        IdentificationError: What was found and what is needed.
    """
    b, k = fit.b, fit.k
    if b.value <= 0.0:
        raise IdentificationError(
            f"{axis} accelerates against its input (b_{axis} = {b.value:.3g}): check the signs of the logged commands and "
            "the frame of the poses (x north, y west, z up)"
        )
    least = {f"b_{axis}": (b, b.value)} | ({f"k_{axis}": (k, max(-k.value, 0.5))} if k else {})
    for name, (found, scale) in least.items():
        width = 0.5 * (found.high - found.low)
        if width > WIDEST * scale:
            raise IdentificationError(
                f"{name} is too vague: {found.value:.3g} +- {width:.2g} was found, +- {WIDEST * scale:.2g} is needed; "
                f"add longer flights that move {axis} more: {REMEDY}"
            )
