"""Residual plots of an identification: one figure an axis, as values that `studies.report.drawing` draws."""

import numpy as np

from controllers.model import GRAVITY
from controllers.signals import Array
from heli_twin.identification.data import ROW
from heli_twin.identification.fit import MEMORY, AxisFit
from heli_twin.identification.identify import Identified
from heli_twin.reporting.figure import Curve, Figure, Panel

SHOWN = 25.0
"""Length of the piece of flight that is drawn, s."""
UNITS = {"x": "m/s²", "y": "m/s²", "z": "m/s²", "yaw": "rad/s²"}


def residual_figures(found: Identified) -> list[Figure]:
    """A figure of each axis: fit, residual, its distribution and its memory."""
    return [_figure(axis, fit) for axis, fit in found.fits.items()]


def _figure(axis: str, fit: AxisFit) -> Figure:
    shown = fit.time[0] < fit.time[0][0] + SHOWN
    time, accel, residual = fit.time[0][shown], fit.accel[0][shown], fit.residual[0][shown]
    # In z the equation has gravity in it, which nobody wants to see.
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
        sentence="What the identified model leaves of the acceleration: gusts last, so that it has a memory.",
        panels=[fitted, left, _distribution(fit, unit), _memory(fit)],
    )


def _distribution(fit: AxisFit, unit: str) -> Panel:
    """All residuals against the normal distribution of their size."""
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


def _memory(fit: AxisFit) -> Panel:
    """Autocorrelation, as far as the intervals look."""
    lags = np.arange(2.0 * MEMORY / ROW)
    of_residual = _autocorrelation(fit.residual)
    n = sum(map(len, fit.residual))
    noise = np.full(len(lags), 1.96 / np.sqrt(n))
    marks = [
        Curve("residual", ROW * lags, of_residual, style="steps", color=2),
        Curve("none, 95 %", ROW * lags, np.zeros(len(lags)), -noise, noise, style="dashes", color=7),
    ]
    return Panel(f"memory; intervals look back {MEMORY:g} s", "lag (s)", "autocorrelation", marks)


def _autocorrelation(pieces: tuple[Array, ...]) -> Array:
    lags = range(round(2.0 * MEMORY / ROW))
    power = sum(float(piece @ piece) for piece in pieces)
    return np.array([sum(float(p[lag:] @ p[: len(p) - lag]) for p in pieces) / power for lag in lags])
