"""Confidence intervals and Sobol indices, by SciPy; with rules for few, equal or missing values."""

import warnings
from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

RESAMPLES = 2000
CONFIDENCE = 0.95
NORMAL_COUNT = 2000
"""From this number of values on, the mean is normal enough and is not resampled."""


class Interval(NamedTuple):
    """An estimate with its 95 % interval; NaN where there is not enough to say."""

    value: float
    low: float
    high: float
    n: int


def mean_interval(values: Array) -> Interval:
    """Mean with a BCa bootstrap interval. NaN among the values are left out."""
    return _bootstrapped(values, np.mean)


def median_interval(values: Array) -> Interval:
    """Lower median with a percentile bootstrap interval: BCa's jackknife is undefined for a median."""
    return _bootstrapped(values, _lower_median, "percentile")


def _lower_median(values: Array, axis: int = -1) -> Array:
    """The middle value, of an even number the lower one: always one of the values."""
    return np.quantile(values, 0.5, axis=axis, method="lower")


def paired_interval(a: Array, b: Array) -> Interval:
    """Mean of a - b with a BCa bootstrap interval over the pairs; pairs with a NaN are left out.

    Source: Efron, Journal of the American Statistical Association 82 (1987) 171.
    """
    return mean_interval(a - b)


def _bootstrapped(values: Array, statistic: Callable[..., Any], method: str = "BCa") -> Interval:
    values = values[np.isfinite(values)]
    n = len(values)
    if n == 0:
        return Interval(np.nan, np.nan, np.nan, 0)
    estimate = float(statistic(values))
    if n < 2 or np.ptp(values) <= 1e-10 * np.abs(values).max():
        # One value says nothing about its scatter; equal values have none.
        return Interval(estimate, *((estimate, estimate) if n > 1 else (np.nan, np.nan)), n)
    if n >= NORMAL_COUNT and statistic is np.mean:
        half = 1.959964 * float(values.std(ddof=1)) / np.sqrt(n)
        return Interval(estimate, estimate - half, estimate + half, n)
    return Interval(estimate, *_resampled(values, statistic, method), n)


def _resampled(values: Array, statistic: Callable[..., Any], method: str) -> tuple[float, float]:
    """Bootstrap limits; by percentiles where BCa is undefined."""
    from scipy.stats import bootstrap

    for way in (method, "percentile"):
        with _degenerate_allowed():
            options: dict[str, Any] = {
                "confidence_level": CONFIDENCE,
                "n_resamples": RESAMPLES,
                "method": way,
                "vectorized": True,
                "rng": 0,
            }
            limits = bootstrap((values,), statistic, **options).confidence_interval
        if np.isfinite([limits.low, limits.high]).all():
            break
    return float(limits.low), float(limits.high)


@contextmanager
def _degenerate_allowed() -> Generator[None]:
    """Ignore SciPy's division by zero for a jackknife without scatter; it gives NaN."""
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        yield


def wilson(failures: int, n: int) -> Interval:
    """A failure rate with its Wilson interval, which is useful even when nothing failed.

    Source: Wilson, Journal of the American Statistical Association 22 (1927) 209.
    """
    from scipy.stats import binomtest

    if n == 0:
        return Interval(np.nan, np.nan, np.nan, 0)
    limits = binomtest(int(failures), int(n)).proportion_ci(CONFIDENCE, "wilson")
    return Interval(failures / n, float(limits.low), float(limits.high), n)


class Sensitivity(NamedTuple):
    """Sobol indices of each axis."""

    first: list[Interval]
    total: list[Interval]


def sobol(A: Array, B: Array, AB: Array) -> Sensitivity:
    """First and total order indices with bootstrap intervals.

    Args:
        A: (n,) scores of the rows of A.
        B: (n,) of B.
        AB: (d, n) of A with column i from B.
    """
    from scipy.stats import sobol_indices

    n = len(A)
    if np.ptp(np.concatenate([A, B])) == 0:
        nothing = [Interval(0.0, 0.0, 0.0, n)] * len(AB)
        return Sensitivity(nothing, nothing)
    indices = sobol_indices(func={"f_A": A[None], "f_B": B[None], "f_AB": AB[:, None, :]}, n=n)
    with _degenerate_allowed():
        spread = indices.bootstrap(confidence_level=CONFIDENCE, n_resamples=999)

    def intervals(values: Array, limits: Any) -> list[Interval]:
        low, high = np.ravel(limits.confidence_interval.low), np.ravel(limits.confidence_interval.high)
        return [Interval(float(v), float(a), float(b), n) for v, a, b in zip(np.ravel(values), low, high, strict=True)]

    return Sensitivity(
        intervals(indices.first_order, spread.first_order), intervals(indices.total_order, spread.total_order)
    )


class GroupedMean(NamedTuple):
    """Means of groups that are numbered 0, 1, ..."""

    mean: Array
    low: Array
    high: Array
    n: NDArray[np.int64]


def grouped_mean(group: NDArray[np.int64], values: Array, groups: int) -> GroupedMean:
    """Means with intervals for many groups at once: Student's t, NaN left out, NaN where a group is empty."""
    from scipy.stats import t

    there = np.isfinite(values)
    group, values = group[there], values[there]
    n = np.bincount(group, minlength=groups)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.bincount(group, values, groups) / n
        variance = np.bincount(group, (values - mean[group]) ** 2, groups) / (n - 1)
        half = t.ppf(0.5 + 0.5 * CONFIDENCE, np.maximum(n - 1, 1)) * np.sqrt(variance / n)
    return GroupedMean(mean, mean - half, mean + half, n)
