"""Residual plots of an identification, one figure per axis, as values that `reporting` draws."""

import numpy as np

from controllers.model import GRAVITY
from controllers.signals import Array
from heli_twin.identification.data import ROW_S
from heli_twin.identification.fit import MEMORY_S, AxisFit
from heli_twin.identification.identify import Identified
from heli_twin.reporting.figure import Curve, Figure, Panel

SHOWN_S = 25.0
"""Length of the piece of flight that is plotted."""
UNITS = {"x": "m/s²", "y": "m/s²", "z": "m/s²", "yaw": "rad/s²"}


def residual_figures(identified: Identified) -> list[Figure]:
    """One figure per axis: fit, residual, distribution and autocorrelation of the residual."""
    return [_figure(axis, fit) for axis, fit in identified.fits.items()]


def _figure(axis: str, fit: AxisFit) -> Figure:
    shown = fit.time[0] < fit.time[0][0] + SHOWN_S
    time, accel, residual = fit.time[0][shown], fit.accel[0][shown], fit.residual[0][shown]
    # The equation of z contains gravity, which would hide the rest.
    accel = accel - (GRAVITY if axis == "z" else 0.0)
    unit = UNITS[axis]
    fitted = Panel(
        f"{axis}: measured and explained, {100 * fit.explained:.1f} %",
        "time (s)",
        unit,
        [
            Curve("measured", time, accel, style="steps", color=0),
            Curve("explained", time, accel - residual, style="dashes", color=1),
        ],
    )
    left = Panel("residual", "time (s)", unit, [Curve("residual", time, residual, style="steps", color=2)])
    return Figure(
        name=f"residuals-{axis}",
        title=f"Residuals of {axis}",
        sentence="Acceleration that the model does not explain: gusts last, so that it is correlated in time.",
        panels=[fitted, left, _distribution(fit, unit), _correlation(fit)],
    )


def _distribution(fit: AxisFit, unit: str) -> Panel:
    """The distribution of all residuals, beside the normal distribution with their rms."""
    residual, size = np.concatenate(fit.residual), fit.residual_rms
    edges = np.linspace(-4.0 * size, 4.0 * size, 41)
    density = np.histogram(residual, edges, density=True)[0].astype(np.float64)
    x = np.linspace(-4.0 * size, 4.0 * size, 161)
    normal = np.exp(-0.5 * (x / size) ** 2) / (size * np.sqrt(2.0 * np.pi))
    middles = (0.5 * (edges[:-1] + edges[1:])).astype(np.float64)
    marks = [
        Curve("residual", middles, density, style="steps", color=2),
        Curve("normal", x, normal, style="dashes", color=7),
    ]
    return Panel("distribution", unit, "density", marks)


def _correlation(fit: AxisFit) -> Panel:
    """Autocorrelation of the residuals, up to twice the lag that the intervals take into account."""
    lags = np.arange(2.0 * MEMORY_S / ROW_S)
    of_residual = _autocorrelation(fit.residual)
    n = sum(map(len, fit.residual))
    noise = np.full(len(lags), 1.96 / np.sqrt(n))
    marks = [
        Curve("residual", ROW_S * lags, of_residual, style="steps", color=2),
        Curve("none, 95 %", ROW_S * lags, np.zeros(len(lags)), -noise, noise, style="dashes", color=7),
    ]
    title = f"autocorrelation; intervals take it into account up to {MEMORY_S:g} s"
    return Panel(title, "lag (s)", "autocorrelation", marks)


def _autocorrelation(pieces: tuple[Array, ...]) -> Array:
    lags = range(round(2.0 * MEMORY_S / ROW_S))
    power = sum(float(piece @ piece) for piece in pieces)
    return np.array([sum(float(p[lag:] @ p[: len(p) - lag]) for p in pieces) / power for lag in lags])
