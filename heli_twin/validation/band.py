"""The band in which the statistics of a sound helicopter stay, for a stated rate of false alarms.

The greatest value of each statistic in some seconds of quiet flight follows a Gumbel distribution, which says how often
a limit is exceeded that was never reached in the flights it was learned from.

Source: Coles, An Introduction to Statistical Modeling of Extreme Values (2001), chapter 3 (block maxima).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from controllers.signals import Array
from heli_twin.errors import HeliTwinError
from heli_twin.validation.watch import STATISTICS, Watched

BLOCK_S = 5.0
LEAST_BLOCKS = 12
"""A minute of quiet flight."""
EULER = 0.5772156649


class Band(NamedTuple):
    """The distribution of the greatest values in `BLOCK_S`."""

    location: Array
    """(10,) in the order of `STATISTICS`."""
    scale: Array
    """(10,)."""

    def limits(self, rate: float) -> Array:
        """Return the limits (10,) that a sound helicopter exceeds `rate` times an hour, all statistics together."""
        share = rate * BLOCK_S / 3600.0 / len(STATISTICS)
        return self.location - self.scale * np.log(-np.log1p(-share))


DEFAULT = Band(
    np.array([1.66, 1.63, 1.55, 1.35, 1.33, 1.35, 0.0010, 0.31, 0.020, 0.016]),
    np.array([0.10, 0.09, 0.09, 0.10, 0.07, 0.09, 0.0007, 0.31, 0.009, 0.008]),
)
"""Of twelve flights of 30 s in `lab` (hover, circle, lemniscate) of a hidden helicopter, watched with what its own
calibration says. In `lab_simple`, without gusts that tilt and servos with play, the band is narrower throughout."""


def learned(flights: Sequence[Sequence[Watched]]) -> Band:
    """Return the band of flights that are known to be sound.

    Raises:
        HeliTwinError: They are too short.
    """
    blocks = np.concatenate([_blocks(flight) for flight in flights]) if flights else np.empty((0, len(STATISTICS)))
    if len(blocks) < LEAST_BLOCKS:
        raise HeliTwinError(
            f"the quiet flights hold {BLOCK_S * len(blocks):.0f} s that can be learned from: give"
            f" {BLOCK_S * LEAST_BLOCKS:.0f} s at least, better ten minutes; the first six of each flight do not count"
        )
    # By moments: a mean is off by 0.577 scales, a deviation is 1.28 scales.
    scale = np.sqrt(6.0) / np.pi * blocks.std(axis=0, ddof=1)
    return Band(blocks.mean(axis=0) - EULER * scale, scale)


def _blocks(flight: Sequence[Watched]) -> Array:
    """The greatest sizes (n, 10) in each whole block in which all statistics are known."""
    rows = [(1e-9 * w.time, w.values) for w in flight if np.isfinite(w.values).all()]
    if not rows:
        return np.empty((0, len(STATISTICS)))
    time, values = np.array([t for t, _ in rows]), np.abs([v for _, v in rows])
    number = ((time - time[0]) // BLOCK_S).astype(int)
    whole = range(int((time[-1] - time[0]) // BLOCK_S))
    return np.array([values[number == i].max(axis=0) for i in whole if (number == i).any()]).reshape(
        -1, len(STATISTICS)
    )
