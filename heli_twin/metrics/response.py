"""How the helicopter answers its reference: phase lag, settling, overshoot. Pure functions of sampled signals."""

from itertools import pairwise

import numpy as np

from controllers.signals import Array

MAX_LAG = 1.0
"""s: the greatest shift that is looked for, either way; a flight has to be longer than three of it."""
TELLING = 0.01
"""m or rad, rms: a shift that fits worse than the best by less fits as well."""
BAND = 0.1
"""m: a helicopter that stays as near to its reference has settled."""
REST = 0.5
"""s: a reference that stands for so long has come to rest."""
STANDING = 1e-3
"""m/s or rad/s: a reference that is slower stands."""
STEP = 0.05
"""m or rad: a move from rest to rest over less is no step."""


def phase_lag(reference: Array, flown: Array, period: float, start: int = 0) -> float | None:
    """By how much the flown path is late: the shift in time that fits the reference to it best.

    The fit is by least squares with a constant offset left free, since a steady error is no lag; the minimum is refined
    by a parabola. For a sinusoid of angular frequency w, w times the lag is the phase in rad.

    Args:
        reference: (n,) m or rad, one axis.
        flown: (n,) the same.
        period: Between samples, s.
        start: Samples of `flown` to leave out.

    Returns:
        s, negative where the helicopter is early; None where the best shift is `MAX_LAG`, or another that is at least
        half of that away fits as well: the reference stands, moves evenly or repeats itself.
    """
    most = round(MAX_LAG / period)
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
    if best in (0, 2 * most) or misfit[far].min() - misfit[best] < n * TELLING**2:
        return None
    before, least, after = misfit[best - 1 : best + 2]
    return period * float(most - best - 0.5 * (before - after) / (before - 2.0 * least + after))


def settling_time(time: Array, distance: Array) -> float | None:
    """When the position error comes within `BAND` for good.

    Args:
        time: (n,) s from the start of the flight.
        distance: (n,) length of the position error, m.

    Returns:
        s from the start; None where it is outside at the end, or where there is no flight.
    """
    outside = np.flatnonzero(~(distance <= BAND))
    if not len(time) or (len(outside) and outside[-1] == len(time) - 1):
        return None
    return float(time[outside[-1] + 1]) if len(outside) else 0.0


def overshoot(reference: Array, flown: Array, period: float) -> float | None:
    """How far the helicopter goes beyond where the reference comes to rest, as a share of the way there.

    A step is a move of the reference by at least `STEP`, however smooth, that leaves a rest, never turns back and
    arrives at another; a rest lasts `REST` at least, or begins the flight. The helicopter overshoots it by its greatest
    excess over the new rest, in the direction of the move, until that rest is over; wind that pushes it counts too.

    Args:
        reference: (n,) m or rad, one axis.
        flown: (n,) the same.
        period: Between samples, s.

    Returns:
        Of the step that was overshot most, at least 0; None where there is no step.
    """
    rests = _rests(reference, period)
    shares: list[float] = []
    for (_, leaves), (arrives, end) in pairwise(rests):
        step = reference[arrives] - reference[leaves]
        if abs(step) >= STEP and np.ptp(reference[leaves : arrives + 1]) <= abs(step) + 1e-6:
            shares.append(float(((flown[leaves : end + 1] - reference[arrives]) / step).max()))
    return max(0.0, *shares) if shares else None


def _rests(reference: Array, period: float) -> list[tuple[int, int]]:
    """First and last sample of every time for which a reference stands."""
    stands = np.abs(np.diff(reference)) <= STANDING * period
    edges = np.flatnonzero(np.diff(np.concatenate([[False], stands, [False]]).astype(np.int8)))
    return [(a, b) for a, b in edges.reshape(-1, 2).tolist() if a == 0 or (b - a) * period >= REST - 1e-9]
