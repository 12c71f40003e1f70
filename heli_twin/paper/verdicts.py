"""Rules that judge the paper's claims from numbers with intervals; they do not depend on flights.

A rule takes the whole 95 % interval, so that few seeds make it harder, not easier, to reproduce a claim; a number
without an interval, from a single seed of a random flight, is comparable with nothing.
"""

from collections.abc import Iterable
from typing import Literal, NamedTuple

import numpy as np

from controllers.signals import Array
from heli_twin.reporting.intervals import Interval, paired_interval

Verdict = Literal["reproduced", "fitted", "not reproduced", "not comparable"]
"""`fitted`: as the paper's number, because a value that the paper does not print was chosen for it."""
Answer = Literal["yes", "no", "turns round", "unknown"]

SAME_ORDER_FACTOR = 2.0
"""Numbers within this factor are of the same order: the helicopter and the room are not the paper's."""
APPROXIMATE_FACTOR = 1.2
"""A number that the paper calls "approximate" is reproduced within this factor."""
SIGNIFICANT_SHARE = 0.1
"""A difference below this share of the value compared with is not "significant"."""
SMALL_HEADING_RAD = float(np.radians(5.0))
"""A heading error that cannot be seen in a plot over a whole turn; the paper has no number."""
SMALL_SCATTER_RAD = float(np.radians(1.0))
"""A heading that scatters more about its mean, rms in flight, swings: it is not tracked very well."""
IDENTIFIED_FACTOR = 1.05
"""A parameter within this factor of the truth counts as identified."""


class Claim(NamedTuple):
    """A row of the table."""

    claim: str
    paper: str
    ours: str
    verdict: Verdict
    why: str
    """One sentence."""


def exact(value: float) -> Interval:
    """A number without scatter: that of a flight without chance."""
    return Interval(value, value, value, 1)


def within(found: Interval, paper: float, factor: float) -> Verdict:
    """Judge whether a whole interval is within a factor of the paper's number."""
    if not _known(found):
        return "not comparable"
    return "reproduced" if paper / factor <= found.low and found.high <= paper * factor else "not reproduced"


def below(found: Interval, limit: float) -> Verdict:
    """Judge whether a whole interval is below a limit."""
    if not _known(found):
        return "not comparable"
    return "reproduced" if found.high < limit else "not reproduced"


def apart(found: Interval, sign: float) -> Verdict:
    """Judge whether a whole interval has the sign of another number."""
    if not _known(found):
        return "not comparable"
    return "reproduced" if sign * (found.low if sign > 0 else found.high) > 0 else "not reproduced"


def smaller(a: Array, b: Array, share: float = SIGNIFICANT_SHARE) -> tuple[Verdict, Interval]:
    """Judge whether a is significantly smaller than b, flown with the same seeds.

    Args:
        a: (n,) values that are claimed to be smaller.
        b: (n,) values compared with.
        share: Share of the mean of b by which a has to be smaller.

    Returns:
        The verdict, and the paired difference a - b.
    """
    difference = paired_interval(a, b)
    if not _known(difference):
        return "not comparable", difference
    return "reproduced" if difference.high < -share * float(np.nanmean(b)) else "not reproduced", difference


def all_of(verdicts: Iterable[Verdict]) -> Verdict:
    """The verdict on a claim of several numbers."""
    order: tuple[Verdict, ...] = ("not comparable", "not reproduced", "fitted", "reproduced")
    return min(verdicts, key=order.index)


def in_words(difference: Interval, other: Array) -> str:
    """Say in words what a paired difference from other values means, by the rule of `smaller`."""
    if not _known(difference):
        return "one seed says nothing of the scatter"
    if difference.low <= 0.0 <= difference.high:
        return "undecided, the interval holds zero"
    if difference.low > 0.0:
        return "larger"
    share = SIGNIFICANT_SHARE * float(np.nanmean(other))
    return "smaller" if difference.high < -share else f"smaller, but not surely by {100 * SIGNIFICANT_SHARE:g} %"


def fitted(verdict: Verdict) -> Verdict:
    """The verdict on a number that a value was chosen for: it cannot be reproduced any more."""
    return "fitted" if verdict == "reproduced" else verdict


def explains(effect: float, *left: float) -> Answer:
    """Say whether a suspected cause explains a difference between two controllers.

    Args:
        effect: The difference that is to be explained.
        left: What is left of it where the cause is taken away, and where the rival has the cause too.

    Returns:
        `yes` if each time the two come together: at most half of the difference is left, with either sign. `turns
        round` if one overtakes the other by more than that: something else is at work too.
    """
    if not np.isfinite([effect, *left]).all() or effect <= 0.0:
        return "unknown"
    if min(left) < -0.5 * effect:
        return "turns round"
    return "yes" if max(left) <= 0.5 * effect else "no"


def _known(found: Interval) -> bool:
    return bool(np.isfinite(found[:3]).all())
