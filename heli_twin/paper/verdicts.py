"""How a claim of the paper is judged: rules on numbers with intervals, and nothing that knows of a flight.

A rule takes the whole 95 % interval, so that few seeds make it harder, not easier, to reproduce a claim; a number
without an interval, from a single seed of a random flight, is comparable with nothing.
"""

from collections.abc import Iterable
from typing import Literal, NamedTuple

import numpy as np

from controllers.signals import Array
from heli_twin.reporting.intervals import Interval, paired_interval

Verdict = Literal["reproduced", "not reproduced", "not comparable"]

ORDER = 2.0
"""Numbers that differ by less than this factor are of the same order: another helicopter, another room."""
APPROXIMATELY = 1.2
"""What the paper calls "approximately" is met within this factor."""
SIGNIFICANT = 0.1
"""A difference below this share of what it is a difference to is not "significant"."""
LITTLE = float(np.radians(5.0))
"""rad: on an axis of a whole turn a heading this far off cannot be told from its reference; the paper has no number."""
CLOSE = 1.05
"""An identified parameter within this factor of the truth is found."""


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
    """Whether a number is the paper's, give or take a factor."""
    if not _known(found):
        return "not comparable"
    return "reproduced" if paper / factor <= found.low and found.high <= paper * factor else "not reproduced"


def below(found: Interval, limit: float) -> Verdict:
    """Whether a number is below a limit."""
    if not _known(found):
        return "not comparable"
    return "reproduced" if found.high < limit else "not reproduced"


def apart(found: Interval, sign: float) -> Verdict:
    """Whether a number lies on one side of zero."""
    if not _known(found):
        return "not comparable"
    return "reproduced" if sign * (found.low if sign > 0 else found.high) > 0 else "not reproduced"


def smaller(a: Array, b: Array, share: float = SIGNIFICANT) -> tuple[Verdict, Interval]:
    """Whether a (n,) is significantly smaller than b (n,), flown with the same seeds; and the difference a - b.

    Args:
        a: Of which the claim is that it is smaller.
        b: Of the other one.
        share: Of the mean of b, by which a has to be smaller.
    """
    difference = paired_interval(a, b)
    if not _known(difference):
        return "not comparable", difference
    return "reproduced" if difference.high < -share * float(np.nanmean(b)) else "not reproduced", difference


def all_of(verdicts: Iterable[Verdict]) -> Verdict:
    """The verdict on a claim of several numbers."""
    order: tuple[Verdict, ...] = ("not comparable", "not reproduced", "reproduced")
    return min(verdicts, key=order.index)


def in_words(difference: Interval, other: Array) -> str:
    """What a paired difference from the values of another one says, by the rule of `smaller`."""
    if not _known(difference):
        return "one seed says nothing of the scatter"
    if difference.low <= 0.0 <= difference.high:
        return "undecided, the interval holds zero"
    if difference.low > 0.0:
        return "larger"
    share = SIGNIFICANT * float(np.nanmean(other))
    return "smaller" if difference.high < -share else f"smaller, but not surely by {100 * SIGNIFICANT:g} %"


def explains(effect: float, without: float) -> str:
    """Whether taking a suspected cause away takes at least half of an effect away."""
    if not np.isfinite([effect, without]).all() or effect <= 0.0:
        return "unknown"
    return "yes" if without <= 0.5 * effect else "no"


def _known(found: Interval) -> bool:
    return bool(np.isfinite(found[:3]).all())
