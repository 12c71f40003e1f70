"""The structure test: do the whitened residuals say that the form of the twin is wrong?

If twin and covariance are right, the residuals of a window, whitened in the order of time, are independent of their
past (Ljung and Box) and of every command up to their time. What is left over says where the form is wrong.

Source: Ljung and Box, Biometrika 65 (1978); Ljung, System Identification, 2nd ed., chapter 16.4 (residual analysis).
"""

from typing import NamedTuple

import numpy as np
from scipy.stats import chi2
from threadpoolctl import threadpool_limits

from controllers.signals import Array
from heli_twin.calibration import noise
from heli_twin.calibration.data import BIN_STEPS, BINS, CHANNELS, STEP_S
from heli_twin.calibration.fit import Fit
from heli_twin.calibration.unknowns import N_START

SKIPPED_BINS = 15
"""Bins after the start of a window, in which its fitted first state hides the residual."""
LAGS = 20
"""Of the residual, in bins, and of the commands: 0.4 s."""
LEVEL = 0.95
WORST_MEMORY, WORST_CORRELATION = 4.0, 2.0
"""Largest statistics of a right twin, in units of their 95 % values: twice those of seven right twins, 1.9 and 1.05. A
load of 0.5 g on a string has a memory of 9, a stabiliser bar of 9.6. No test judges one of these twins."""


class Structure(NamedTuple):
    """The statistics of each channel, each divided by its 95 % value for white residuals."""

    memory: dict[str, float]
    """Ljung and Box's, over lags up to 0.4 s."""
    correlation: dict[str, float]
    """Joint regression on the commands of the last 0.4 s."""
    variance: dict[str, float]
    """Of the whitened residuals; 1 for a right covariance."""
    curves: dict[str, Array]
    """(LAGS + 1,) autocorrelation of each channel."""

    @property
    def worst(self) -> tuple[str, str, float]:
        """Channel, statistic and its ratio to the limit for the statistic that is furthest beyond it."""
        ratios = [(c, "memory", v / WORST_MEMORY) for c, v in self.memory.items()]
        ratios += [(c, "correlation", v / WORST_CORRELATION) for c, v in self.correlation.items()]
        return max(ratios, key=lambda row: row[2])


def whitened(fit: Fit) -> Array:
    """Return the residuals (w, BINS, 6), each made independent of those before it; NaN where there is no pose."""
    rows = np.concatenate([fit.first[..., N_START:], fit.residual[..., None]], axis=-1)
    white = noise.whiten(fit.air, fit.state.eta, rows)[0].reshape(len(rows), -1, rows.shape[-1])
    # Frames in doubt add to the covariance; its root, like the filter, keeps the order of time.
    frames, residual = white[..., :-1], white[..., -1:]
    root = np.linalg.cholesky(np.eye(white.shape[1]) + frames @ frames.transpose(0, 2, 1))
    independent = np.linalg.solve(root, residual).reshape(fit.residual.shape)
    return np.where(fit.problem.present[..., None], independent, np.nan)


def structure(fit: Fit) -> Structure:
    """Return the statistics of the whitened residuals of a fit."""
    with threadpool_limits(limits=1):
        return _structure(fit)


def _structure(fit: Fit) -> Structure:
    e = whitened(fit)[:, SKIPPED_BINS:]
    inputs = _inputs(fit)
    memory, correlation, variance, curves = {}, {}, {}, {}
    for i, channel in enumerate(CHANNELS):
        values = e[..., i] - np.nanmean(e[..., i])
        variance[channel] = float(np.nanvar(values))
        scaled = np.nan_to_num(values / np.sqrt(variance[channel]))
        n = int(np.isfinite(values).sum())
        curve = np.array(
            [(scaled[:, lag:] * scaled[:, : BINS - SKIPPED_BINS - lag]).sum() / n for lag in range(LAGS + 1)]
        )
        pairs = np.array([n * (1.0 - lag / (BINS - SKIPPED_BINS)) for lag in range(1, LAGS + 1)])
        # The correlation of a lag has a variance of pairs / n^2.
        memory[channel] = float((curve[1:] ** 2 * n * n / pairs).sum() / chi2.ppf(LEVEL, LAGS))
        curves[channel] = curve
        correlation[channel] = _explained(scaled[np.isfinite(values)], inputs[np.isfinite(values)])
    return Structure(memory, correlation, variance, curves)


def _explained(values: Array, inputs: Array) -> float:
    """Joint regression of values (n,) with variance 1 on inputs (n, m), by its 95 % value."""
    x = inputs - inputs.mean(axis=0)
    u, s, _ = np.linalg.svd(x, full_matrices=False)
    u = u[:, s > 1e-3 * s[0]]
    return float(((u.T @ values) ** 2).sum() / chi2.ppf(LEVEL, u.shape[1]))


def _inputs(fit: Fit) -> Array:
    """The commands (w, bins, 4 * lags) of the last 0.4 s before each bin that is tested."""
    rows: list[Array] = []
    lags = np.arange(0, LAGS + 1, 2)
    for flight in fit.problem.flights:
        middle = STEP_S * BIN_STEPS * (np.arange(SKIPPED_BINS, BINS) + 0.5)
        t = flight.origin + STEP_S * flight.windows.first[:, None] + middle
        u = flight.sent.held.at(t[..., None] - BIN_STEPS * STEP_S * lags)
        rows.append(u.reshape(*t.shape, -1))
    return np.concatenate(rows)
