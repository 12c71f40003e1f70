"""Confidence intervals over independent seeds, and Sobol indices; with rules for few, equal or missing values."""

import warnings
from collections.abc import Generator
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

CONFIDENCE = 0.95


class Interval(NamedTuple):
    """An estimate with its 95 % interval."""

    value: float
    """NaN if there is no value."""
    low: float
    """NaN if there are too few values for an interval; the same of `high`."""
    high: float
    n: int
    """Number of independent values."""


def mean_interval(values: Array) -> Interval:
    """Mean of independent values with Student's t interval; NaN among the values are left out.

    On 2 to 40 values, normal, exponential or log-normal, it covers the mean at least as often as a BCa bootstrap.

    Source: Student, Biometrika 6 (1908) 1.
    """
    mean, low, high, n = (column[0] for column in grouped_mean(np.zeros(len(values), np.int64), values, 1))
    return Interval(float(mean), float(low), float(high), int(n))


def seed_interval(values: Array, seeds: NDArray[Any]) -> Interval:
    """Mean over flights with an interval over their seeds: only those are drawn, the points of a study are chosen.

    Args:
        values: (n,) of flights; NaN are left out.
        seeds: (n,) of the flights.

    Returns:
        The mean over the seeds of the mean of each seed; `n` is the number of seeds.
    """
    drawn, place = np.unique(seeds, return_inverse=True)
    return mean_interval(grouped_mean(place, values, len(drawn)).mean)


def median_interval(values: Array) -> Interval:
    """Lower median of independent values with an interval between two of them; NaN among the values are left out.

    The interval is the shortest pair of order statistics that holds the median with at least 95 %; fewer than six
    values have none.

    Source: Thompson, Annals of Mathematical Statistics 7 (1936) 122.
    """
    from scipy.stats import binom

    values = np.sort(values[np.isfinite(values)])
    n = len(values)
    if n == 0:
        return Interval(np.nan, np.nan, np.nan, 0)
    # The k-th smallest value is above the median when fewer than k of n values are below it.
    k = int(binom.ppf(0.5 - 0.5 * CONFIDENCE, n, 0.5))
    low, high = (values[k - 1], values[n - k]) if k else (np.nan, np.nan)
    return Interval(float(values[(n - 1) // 2]), float(low), float(high), n)


def paired_interval(a: Array, b: Array) -> Interval:
    """Mean of a - b over independent pairs with Student's t interval; pairs with a NaN are left out."""
    return mean_interval(a - b)


@contextmanager
def _degenerate_allowed() -> Generator[None]:
    """Ignore SciPy's division by zero for indices without scatter; they give NaN."""
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        yield


def failure_interval(failed: NDArray[np.bool_], seeds: NDArray[Any]) -> Interval:
    """Failure rate of flights with its Wilson interval; a single seed has no interval, however many its flights.

    Args:
        failed: (n,) of the flights.
        seeds: (n,) of the flights.
    """
    drawn = len(np.unique(seeds))
    rate = wilson(int(failed.sum()), len(failed))
    return rate._replace(n=drawn) if drawn > 1 else Interval(rate.value, np.nan, np.nan, drawn)


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

    Source: Saltelli et al., Computer Physics Communications 181 (2010) 259, table 2 (b) and (f).
    """
    from scipy.stats import bootstrap

    n = len(A)
    if np.ptp(np.concatenate([A, B])) == 0:
        nothing = [Interval(0.0, 0.0, 0.0, n)] * len(AB)
        return Sensitivity(nothing, nothing)

    def indices(rows: NDArray[np.int64]) -> Array:
        a, b, mixed = A[rows] - mean, B[rows] - mean, AB[:, rows] - mean
        return np.stack([(b * (mixed - a)).mean(axis=1), 0.5 * ((mixed - a) ** 2).mean(axis=1)]) / np.var([a, b])

    rows, mean = np.arange(n), np.concatenate([A, B]).mean()
    values = indices(rows)
    with _degenerate_allowed():
        # SciPy's `sobol_indices` has a bootstrap that cannot be seeded: the same scores have the same interval.
        limits = bootstrap([rows], indices, confidence_level=CONFIDENCE, n_resamples=999, rng=0).confidence_interval
    first, total = (
        [Interval(float(v), float(low), float(high), n) for v, low, high in zip(*columns, strict=True)]
        for columns in zip(values, limits.low, limits.high, strict=True)
    )
    return Sensitivity(first, total)


class Screening(NamedTuple):
    """Morris' measures of each axis."""

    mu_star: list[Interval]
    """Mean size of the elementary effects."""
    sigma: list[Interval]
    """Their standard deviation."""


def screening(effects: Array) -> Screening:
    """Mean size and standard deviation of elementary effects with intervals over the trajectories.

    Student's t for the mean, the chi-square distribution for the deviation. An effect that shows itself in few places
    only, a crash in one corner, may be in none of the trajectories, and then in no interval either.

    Args:
        effects: (trajectories, axes).

    Source: Campolongo, Cariboni and Saltelli, Environmental Modelling & Software 22 (2007) 1509.
    """
    from scipy.stats import chi2

    n = len(effects)
    deviations = effects.std(axis=0, ddof=1)
    low, high = (float(np.sqrt((n - 1) / chi2.ppf(p, n - 1))) for p in (0.5 + 0.5 * CONFIDENCE, 0.5 - 0.5 * CONFIDENCE))
    sigma = [Interval(float(s), float(s * low), float(s * high), n) for s in deviations]
    means = [mean_interval(np.abs(column)) for column in effects.T]
    return Screening([found._replace(low=max(found.low, 0.0)) for found in means], sigma)


class GroupedMean(NamedTuple):
    """Means of groups that are numbered 0, 1, ..."""

    mean: Array
    low: Array
    high: Array
    n: NDArray[np.int64]


def grouped_mean(group: NDArray[np.int64], values: Array, groups: int) -> GroupedMean:
    """Means of many groups with Student's t intervals.

    Args:
        group: (n,) number of each value's group, from 0 on.
        values: (n,) NaN are left out.
        groups: How many groups.

    Returns:
        NaN where a group has too few values.
    """
    from scipy.stats import t

    there = np.isfinite(values)
    group, values = group[there], values[there]
    n = np.bincount(group, minlength=groups)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.bincount(group, values, groups) / n
        variance = np.bincount(group, (values - mean[group]) ** 2, groups) / (n - 1)
        # Rounding scatters equal values.
        variance = np.where(variance <= (1e-10 * mean) ** 2, 0.0, variance)
        half = t.ppf(0.5 + 0.5 * CONFIDENCE, np.maximum(n - 1, 1)) * np.sqrt(variance / n)
    return GroupedMean(mean, mean - half, mean + half, n)


def grouped_percent(group: NDArray[np.int64], happened: NDArray[np.bool_], groups: int) -> GroupedMean:
    """How often something happened in each of many groups, %, with Wilson's intervals.

    Args:
        group: (n,) number of each flight's group, from 0 on; the flights of a group are independent.
        happened: (n,).
        groups: How many groups.
    """
    n = np.bincount(group, minlength=groups)
    found = [wilson(int(k), int(of)) for k, of in zip(np.bincount(group[happened], minlength=groups), n, strict=True)]
    value, low, high = (100.0 * np.array([getattr(each, part) for each in found]) for part in ("value", "low", "high"))
    return GroupedMean(value, low, high, n)


def shown_share(failures: int, n: int) -> float:
    """The share of all flights that do not fail at least, with 95 % confidence, when so many of n failed.

    Of 59 flights without a failure 95 %: Wilks's bound; with failures the exact limit of Clopper and Pearson.

    Source: Wilks, Annals of Mathematical Statistics 12 (1941) 91; Clopper and Pearson, Biometrika 26 (1934) 404.
    """
    from scipy.special import betaincinv

    return 0.0 if failures >= n else float(betaincinv(n - failures, failures + 1.0, 1.0 - CONFIDENCE))


def flights_to_show(share: float) -> int:
    """The number of flights without a failure that show this share with 95 % confidence."""
    return int(np.ceil(np.log(1.0 - CONFIDENCE) / np.log(share) - 1e-9))


def tolerance_bound(values: Array, share: float = 0.95) -> float:
    """The least of independent values that at least this share of all values does not exceed, with 95 % confidence.

    Args:
        values: (n,) infinite for a flight that crashed.
        share: Of all values.

    Returns:
        Infinite if there are too few values: 59 are needed for 95 %.

    Source: Wilks, Annals of Mathematical Statistics 12 (1941) 91.
    """
    from scipy.stats import binom

    # The r-th smallest is below that quantile when r values or more are: it must not happen in more than 5 % of cases.
    rank = int(binom.ppf(CONFIDENCE, len(values), share)) + 1
    return float(np.sort(values)[rank - 1]) if rank <= len(values) else float("inf")
