"""Step and frequency response to the reference: phase lag, settling time, overshoot of sampled signals."""

from itertools import pairwise

import numpy as np

from controllers.signals import Array

MAX_LAG_S = 1.0
"""Greatest lag that is searched for, in both directions; a flight must be at least three times as long."""
DISTINCT_RMS = 0.01
"""m or rad: the best lag must fit better than every other by this rms, or it is not unique."""
SETTLED_BAND_M = 0.1
"""A helicopter whose position error stays within this has settled."""
REST_DURATION_S = 0.5
"""A reference that stands still for this time is at rest."""
REST_RATE = 1e-3
"""m/s or rad/s: a slower reference stands still."""
MIN_STEP = 0.05
"""m or rad: a shorter move from rest to rest is not a step."""


def phase_lag(reference: Array, flown: Array, period: float, start: int = 0) -> float | None:
    """The delay of the flown path: the shift in time that fits the reference to it best.

    Least squares with a free constant offset, since a steady error is not a lag; a parabola refines the minimum. For a
    sinusoid of angular frequency w, w times the lag is the phase in rad.

    Args:
        reference: (n,) m or rad, one axis.
        flown: (n,) the same.
        period: Between samples, s.
        start: Samples of `flown` to leave out.

    Returns:
        s, negative if the helicopter is early; None if the best shift is `MAX_LAG_S`, or if another that is at least
        half of that away fits as well: the reference stands still, moves evenly or repeats itself.
    """
    most = round(MAX_LAG_S / period)
    first, end = max(start, most), len(flown) - most
    n = end - first
    if n < most:
        return None
    y = flown[first:end] - flown[first:end].mean()
    r = reference[first - most : end + most]
    r = r - r.mean()
    sums = np.concatenate([np.zeros((1, 2)), np.cumsum(np.column_stack([r, r * r]), axis=0)])
    total, squares = (sums[n:] - sums[:-n]).T
    # Of the window that begins at each sample: sum of (r - its mean - y)^2.
    misfit = squares - total**2 / n - 2.0 * np.correlate(r, y, "valid") + y @ y
    best = int(misfit.argmin())
    far = np.abs(np.arange(len(misfit)) - best) >= most / 2
    if best in (0, 2 * most) or misfit[far].min() - misfit[best] < n * DISTINCT_RMS**2:
        return None
    before, least, after = misfit[best - 1 : best + 2]
    return period * float(most - best - 0.5 * (before - after) / (before - 2.0 * least + after))


def settling_time(time: Array, distance: Array) -> float | None:
    """The time from which on the position error stays within `SETTLED_BAND_M`.

    Args:
        time: (n,) s from the start of the flight.
        distance: (n,) length of the position error, m.

    Returns:
        s from the start; None if the error is outside at the end, or for no samples.
    """
    outside = np.flatnonzero(~(distance <= SETTLED_BAND_M))
    if not len(time) or (len(outside) and outside[-1] == len(time) - 1):
        return None
    return float(time[outside[-1] + 1]) if len(outside) else 0.0


def overshoot(reference: Array, flown: Array, period: float) -> float | None:
    """The greatest overshoot of a step of the reference, as a share of the step.

    A step is a move of the reference by at least `MIN_STEP`, however smooth, from one rest to another, without turning
    back. A rest lasts at least `REST_DURATION_S`, or begins the flight. The overshoot is the greatest distance beyond
    the new rest, in the direction of the step, until that rest ends; wind that pushes the helicopter counts too.

    Args:
        reference: (n,) m or rad, one axis.
        flown: (n,) the same.
        period: Between samples, s.

    Returns:
        At least 0; None if there is no step.
    """
    rests = _rests(reference, period)
    shares: list[float] = []
    for (_, leaves), (arrives, end) in pairwise(rests):
        step = reference[arrives] - reference[leaves]
        if abs(step) >= MIN_STEP and np.ptp(reference[leaves : arrives + 1]) <= abs(step) + 1e-6:
            shares.append(float(((flown[leaves : end + 1] - reference[arrives]) / step).max()))
    return max(0.0, *shares) if shares else None


def _rests(reference: Array, period: float) -> list[tuple[int, int]]:
    """First and last sample of every rest."""
    stands = np.abs(np.diff(reference)) <= REST_RATE * period
    edges = np.flatnonzero(np.diff(np.concatenate([[False], stands, [False]]).astype(np.int8)))
    return [(a, b) for a, b in edges.reshape(-1, 2).tolist() if a == 0 or (b - a) * period >= REST_DURATION_S - 1e-9]
