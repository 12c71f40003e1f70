"""How well predictions agree with a flight: errors after some horizons, each with its measure and interval."""

from typing import Any, NamedTuple

import numpy as np
from scipy.stats import t as student

from controllers.signals import Array
from heli_twin.calibration.data import CHANNELS
from heli_twin.validation.forecast import BIN_S, Forecast

HORIZONS_S = (0.5, 1.0, 2.0)
"""After which predictions are compared with the flight."""
CONFIDENCE = 0.95


class Agreement(NamedTuple):
    """The error of predictions of one channel after one horizon: flown minus predicted, m or rad."""

    rms: float
    nrmse: float
    """Root mean square by the standard deviation of what was flown."""
    theil: float
    """Theil's inequality coefficient of the motion since the begin of the prediction: 0 perfect, 1 the worst."""
    bias: float
    bias_low: float
    """Lower end of the 95 % interval of the mean error."""
    bias_high: float
    expected: float
    """Root mean square that gusts and cameras alone give a right twin."""
    ratio: float
    """Root mean square of the errors, each by its expected deviation: about 1 for a right twin."""
    pieces: int

    def plain(self) -> dict[str, Any]:
        """The same for JSON; None where there is no number."""
        return {name: value if np.isfinite(value) else None for name, value in self._asdict().items()}


def agreements(forecast: Forecast) -> dict[float, dict[str, Agreement]]:
    """Return the agreement by horizon (s) and channel."""
    return {
        horizon: {channel: _agreement(forecast, horizon, i) for i, channel in enumerate(CHANNELS)}
        for horizon in HORIZONS_S
    }


def _agreement(forecast: Forecast, horizon: float, channel: int) -> Agreement:
    at = round(horizon / BIN_S) - 1
    flown, predicted = forecast.flown[:, at, channel], forecast.predicted[:, at, channel]
    last = forecast.last[:, channel]
    seen = np.isfinite(flown) & np.isfinite(last)
    flown, predicted, last = flown[seen], predicted[seen], last[seen]
    error, deviation = flown - predicted, forecast.deviation[seen, at, channel]
    rms = _rms(error)
    size = _rms(flown - last) + _rms(predicted - last)
    overlap = int(np.ceil(horizon / _spacing(forecast.begin)))
    low, high = _mean_interval(error, overlap)
    return Agreement(
        rms,
        rms / float(np.nanstd(forecast.flown[..., channel])),
        rms / size,
        float(error.mean()) if len(error) else np.nan,
        low,
        high,
        _rms(deviation),
        _rms(error / deviation),
        len(error),
    )


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else np.nan


def _spacing(begin: Array) -> float:
    return float(np.median(np.diff(begin))) if len(begin) > 1 else np.inf


def _mean_interval(error: Array, overlap: int) -> tuple[float, float]:
    """The interval of the mean of errors (n,), of which neighbours overlap.

    Source: Newey and West, Econometrica 55 (1987).
    """
    n = len(error)
    if n < 3:
        return np.nan, np.nan
    rest = error - error.mean()
    variance = float(rest @ rest)
    lags = min(overlap + 1, n - 1)
    for lag in range(1, lags + 1):
        variance += 2.0 * (1.0 - lag / (lags + 1)) * float(rest[lag:] @ rest[:-lag])
    spread = np.sqrt(max(variance, 0.0) / (n * max(n - 1, 1)))
    reach = float(student.ppf(0.5 + 0.5 * CONFIDENCE, max(n / (1.0 + overlap) - 1.0, 1.0))) * spread
    return float(error.mean() - reach), float(error.mean() + reach)
