"""Formulas of signal temporal logic and their robustness: by how much a flight keeps them, at each sample.

A signal is sampled at a constant period and holds its value up to the next sample. Rules:

- A comparison is worth the difference between its sides, a Boolean signal plus or minus infinity; `<` is read as `<=`,
  so that a robustness of exactly 0 holds. A value that is not a number breaks a comparison.
- The limits of an interval are rounded to the nearest sample; both belong to it.
- An interval that reaches beyond the end of the flight counts the recorded samples. An empty one makes `always` true
  and `eventually` and `until` false.
- `a until[s,t] b`: at a sample of the interval b holds, and a holds at every sample from now to before it.

Source: Donze and Maler, Robust satisfaction of temporal logic over real-valued signals, FORMATS 2010; rules as in
RTAMT, Nickovic and Yamaguchi, ATVA 2020.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from controllers.signals import Array

Scale = Callable[["Below"], float]
"""Divisor of the robustness of a comparison."""


class Trace(NamedTuple):
    """Signals of one flight."""

    period: float
    """s."""
    length: int
    """n, samples, at least one."""
    signals: Mapping[str, Array]
    """(n,) by name; those that are true or false are 1 or 0."""


class Tightest(NamedTuple):
    """The sample and the comparison or Boolean signal that decide about a formula."""

    sample: int
    leaf: "Below | Holds"


@dataclass(frozen=True)
class Interval:
    """Seconds from now; an end of None is the end of the flight."""

    start: float = 0.0
    end: float | None = None

    def samples(self, trace: Trace) -> tuple[int, int]:
        """First and last sample from now; the last is before the first if the interval is empty for every sample."""
        first = int(self.start / trace.period + 0.5)
        last = trace.length - 1 if self.end is None else min(int(self.end / trace.period + 0.5), trace.length - 1)
        return first, last


class Formula(ABC):
    """A formula; `robustness` gives its value at every sample."""

    @abstractmethod
    def robustness(self, trace: Trace, scale: Scale) -> Array:
        """(n,) values, in the unit of the signals divided by `scale`."""

    @abstractmethod
    def tightest(self, at: int, trace: Trace, scale: Scale) -> Tightest | None:
        """Return what decides at sample `at`, or None if it is an interval without samples."""

    @abstractmethod
    def leaves(self) -> Iterator["Below | Holds"]:
        """Yield the comparisons and Boolean signals."""


@dataclass(frozen=True)
class Side:
    """A signal or its size; or a number, if it has no signal."""

    signal: str = ""
    size: bool = False
    number: float = 0.0
    """In the unit of the signals that it is compared with."""
    unit: str = ""
    """Unit that the number was written with."""

    def value(self, trace: Trace) -> Array | float:
        """(n,) values of a signal, or the number."""
        if not self.signal:
            return self.number
        values = np.asarray(trace.signals[self.signal], np.float64)
        return np.abs(values) if self.size else values


@dataclass(frozen=True)
class Below(Formula):
    """`low < high`."""

    low: Side
    high: Side
    unit: str = ""
    """Unit of the values."""

    @property
    def shown_unit(self) -> str:
        """The unit that the limit was written with; that of the signals if there is no limit."""
        return self.low.unit or self.high.unit or self.unit

    @property
    def limit(self) -> float:
        """Size of the number that a signal is compared with; 1 if there is none or it is 0."""
        return abs(self.low.number) + abs(self.high.number) or 1.0

    def signals(self) -> tuple[str, ...]:
        """Names of the signals that it compares."""
        return tuple(side.signal for side in (self.low, self.high) if side.signal)

    def robustness(self, trace: Trace, scale: Scale) -> Array:
        """`high - low`."""
        with np.errstate(invalid="ignore"):
            room = (self.high.value(trace) - self.low.value(trace)) / scale(self)
        return np.where(np.isnan(room), -np.inf, room)

    def tightest(self, at: int, trace: Trace, scale: Scale) -> Tightest:
        """Itself."""
        return Tightest(at, self)

    def leaves(self) -> Iterator["Below | Holds"]:
        """Yield itself."""
        yield self


@dataclass(frozen=True)
class Holds(Formula):
    """A Boolean signal."""

    signal: str

    def signals(self) -> tuple[str, ...]:
        """Its name."""
        return (self.signal,)

    def robustness(self, trace: Trace, scale: Scale) -> Array:
        """Plus or minus infinity."""
        return np.where(trace.signals[self.signal] > 0.5, np.inf, -np.inf)

    def tightest(self, at: int, trace: Trace, scale: Scale) -> Tightest:
        """Itself."""
        return Tightest(at, self)

    def leaves(self) -> Iterator["Below | Holds"]:
        """Yield itself."""
        yield self


@dataclass(frozen=True)
class Not(Formula):
    """`not inner`."""

    inner: Formula

    def robustness(self, trace: Trace, scale: Scale) -> Array:
        """The negative."""
        return -self.inner.robustness(trace, scale)

    def tightest(self, at: int, trace: Trace, scale: Scale) -> Tightest | None:
        """Return what decides about the inner formula."""
        return self.inner.tightest(at, trace, scale)

    def leaves(self) -> Iterator["Below | Holds"]:
        """Yield those of the inner formula."""
        yield from self.inner.leaves()


@dataclass(frozen=True)
class Every(Formula):
    """`left and right`: the least value; with `some`, `left or right`: the greatest."""

    left: Formula
    right: Formula
    some: bool = False

    def robustness(self, trace: Trace, scale: Scale) -> Array:
        """The least or the greatest."""
        of = np.maximum if self.some else np.minimum
        return of(self.left.robustness(trace, scale), self.right.robustness(trace, scale))

    def tightest(self, at: int, trace: Trace, scale: Scale) -> Tightest | None:
        """Return what decides about the side that decides."""
        left, right = (float(side.robustness(trace, scale)[at]) for side in (self.left, self.right))
        decides = self.right if (right > left if self.some else right < left) else self.left
        return decides.tightest(at, trace, scale)

    def leaves(self) -> Iterator["Below | Holds"]:
        """Yield those of both sides."""
        yield from self.left.leaves()
        yield from self.right.leaves()


@dataclass(frozen=True)
class Always(Formula):
    """`always[start,end] inner`; with `some`, `eventually[start,end] inner`."""

    inner: Formula
    interval: Interval = Interval()
    some: bool = False

    def robustness(self, trace: Trace, scale: Scale) -> Array:
        """The extreme of a window that moves along."""
        # A heavy import, which studies without requirements and formulas without time do without.
        from scipy.ndimage import maximum_filter1d, minimum_filter1d

        first, last = self.interval.samples(trace)
        nothing = -np.inf if self.some else np.inf
        n, width = trace.length, last - first + 1
        if width < 1:
            return np.full(n, nothing)
        ahead = np.concatenate([self.inner.robustness(trace, scale)[first:], np.full(last, nothing)])
        extreme = maximum_filter1d if self.some else minimum_filter1d
        # The filter centres its window; the origin moves its beginning to the sample.
        return extreme(ahead, width, mode="constant", cval=nothing, origin=-(width // 2))[:n]

    def tightest(self, at: int, trace: Trace, scale: Scale) -> Tightest | None:
        """Return what decides at the sample of the extreme."""
        first, last = self.interval.samples(trace)
        window = self.inner.robustness(trace, scale)[at + first : at + last + 1]
        if not len(window):
            return None
        where = int(np.argmax(window) if self.some else np.argmin(window))
        return self.inner.tightest(at + first + where, trace, scale)

    def leaves(self) -> Iterator["Below | Holds"]:
        """Yield those of the inner formula."""
        yield from self.inner.leaves()


@dataclass(frozen=True)
class Until(Formula):
    """`left until[start,end] right`."""

    left: Formula
    right: Formula
    interval: Interval = Interval()

    def robustness(self, trace: Trace, scale: Scale) -> Array:
        """The best moment for the right side, with the least value of the left side before it."""
        first, last = self.interval.samples(trace)
        left, right = self.left.robustness(trace, scale), self.right.robustness(trace, scale)
        n = trace.length
        kept, best = np.full(n, np.inf), np.full(n, -np.inf)
        for ahead in range(last + 1):
            now = n - ahead
            if ahead >= first:
                best[:now] = np.maximum(best[:now], np.minimum(kept[:now], right[ahead:]))
            kept[:now] = np.minimum(kept[:now], left[ahead:])
        return best

    def tightest(self, at: int, trace: Trace, scale: Scale) -> Tightest | None:
        """Return what decides at the best moment: the right side there, or the left side on the way."""
        first, last = self.interval.samples(trace)
        left = self.left.robustness(trace, scale)[at : at + last + 1]
        right = self.right.robustness(trace, scale)[at : at + last + 1]
        kept = np.minimum.accumulate(np.concatenate([[np.inf], left[:-1]]))
        value = np.minimum(kept, right)[first:]
        if not len(value):
            return None
        best = first + int(np.argmax(value))
        if right[best] <= kept[best]:
            return self.right.tightest(at + best, trace, scale)
        return self.left.tightest(at + int(np.argmin(left[:best])), trace, scale)

    def leaves(self) -> Iterator["Below | Holds"]:
        """Yield those of both sides."""
        yield from self.left.leaves()
        yield from self.right.leaves()
