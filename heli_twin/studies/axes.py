"""Axes of a study: the values of one field of the experiment. A class here is one kind of axis.

In a study file an axis is a list, or one kind with its numbers: `{ linspace = [0.024, 0.034, 5] }`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from statistics import NormalDist
from typing import Any, Literal, Protocol

from heli_twin.experiment.families import members
from heli_twin.studies.ensemble import is_ensemble
from heli_twin.studies.errors import StudyError
from heli_twin.terminal_text import clean

EXTREME_QUANTILES = 0.05, 0.95
"""The quantiles that stand for the ends of a distribution."""


class Axis(Protocol):
    """The values that a field takes."""

    def levels(self) -> Sequence[Any]:
        """Its values in order; empty for a distribution."""
        ...

    def count(self) -> int:
        """Return the number of levels without making them; 0 for a distribution."""
        ...

    def quantile(self, p: float) -> Any:
        """The value that a share p in [0, 1) of the draws stays below."""
        ...


@dataclass(frozen=True, slots=True)
class Values:
    """A list of values, each as likely as the others."""

    values: tuple[Any, ...]
    kind: Literal["values"] = "values"

    def levels(self) -> Sequence[Any]:
        """The values as written."""
        return self.values

    def count(self) -> int:
        """The length of the list."""
        return len(self.values)

    def quantile(self, p: float) -> Any:
        """The value at this share of the list."""
        return self.values[min(int(p * len(self.values)), len(self.values) - 1)]


@dataclass(frozen=True, slots=True)
class Ensemble:
    """Whole parts, each as likely as the others: the parameters of one go together."""

    names: tuple[str, ...]
    values: tuple[dict[str, Any], ...]
    kind: Literal["ensemble"] = "ensemble"

    def levels(self) -> Sequence[dict[str, Any]]:
        """All of them."""
        return self.values

    def count(self) -> int:
        """How many."""
        return len(self.values)

    def quantile(self, p: float) -> dict[str, Any]:
        """The one at this share."""
        return self.values[min(int(p * len(self.values)), len(self.values) - 1)]

    def name_of(self, value: object) -> str:
        """The name of one of them."""
        return self.names[self.values.index(value)]  # pyright: ignore[reportArgumentType]


@dataclass(frozen=True, slots=True)
class Linspace:
    """Values from start to stop in equal steps."""

    start: float
    stop: float
    number: int
    kind: Literal["linspace"] = "linspace"

    def __post_init__(self) -> None:
        """Refuse a step count that makes no axis."""
        _whole(self.number)

    def levels(self) -> Sequence[float]:
        """The values, both ends included."""
        return [_tidy(self.quantile(i / max(1, self.number - 1))) for i in range(int(self.number))]

    def count(self) -> int:
        """As many as were asked for."""
        return int(self.number)

    def quantile(self, p: float) -> float:
        """The value at this share of the range."""
        return self.start + p * (self.stop - self.start)


@dataclass(frozen=True, slots=True)
class Logspace:
    """Values from start to stop with a constant ratio. Start and stop are values, not exponents."""

    start: float
    stop: float
    number: int
    kind: Literal["logspace"] = "logspace"

    def __post_init__(self) -> None:
        """Refuse values that have no logarithm."""
        _whole(self.number)
        if self.start <= 0 or self.stop <= 0:
            raise StudyError("a logspace goes from one positive value to another")

    def levels(self) -> Sequence[float]:
        """The values, both ends included."""
        return [_tidy(self.quantile(i / max(1, self.number - 1))) for i in range(int(self.number))]

    def count(self) -> int:
        """As many as were asked for."""
        return int(self.number)

    def quantile(self, p: float) -> float:
        """The value at this share of the range of logarithms."""
        return self.start * math.exp(p * math.log(self.stop / self.start))


@dataclass(frozen=True, slots=True)
class Normal:
    """A normal distribution, cut off at four standard deviations."""

    mean: float
    deviation: float
    kind: Literal["normal"] = "normal"

    def __post_init__(self) -> None:
        """Refuse numbers that make no distribution."""
        if self.deviation <= 0:
            raise StudyError("the second number of a normal distribution is its standard deviation, above 0")

    def levels(self) -> Sequence[float]:
        """An empty sequence: a distribution has no levels."""
        return ()

    def count(self) -> int:
        """None."""
        return 0

    def quantile(self, p: float) -> float:
        """The quantile of the normal distribution, cut off at four standard deviations."""
        return NormalDist(self.mean, self.deviation).inv_cdf(min(max(p, 3.2e-5), 1 - 3.2e-5))


@dataclass(frozen=True, slots=True)
class Uniform:
    """A uniform distribution between two values."""

    low: float
    high: float
    kind: Literal["uniform"] = "uniform"

    def __post_init__(self) -> None:
        """Refuse numbers that make no distribution."""
        if self.low >= self.high:
            raise StudyError("a uniform distribution goes from the lower value to the higher one")

    def levels(self) -> Sequence[float]:
        """An empty sequence: a distribution has no levels."""
        return ()

    def count(self) -> int:
        """None."""
        return 0

    def quantile(self, p: float) -> float:
        """The value at this share of the range."""
        return self.low + p * (self.high - self.low)


def axis_of(path: str, written: Any) -> Axis:
    """The axis that a study file describes.

    Args:
        path: The field it sweeps, for the message.
        written: A list, or a table with one kind of axis and its numbers.

    Raises:
        StudyError: It is empty or no axis.
    """
    kinds = members(__name__)
    if isinstance(written, list | tuple):
        if not written:
            raise StudyError(f"axis '{path}' is empty: give it at least one value")
        if len({repr(value) for value in written}) < len(written):
            raise StudyError(f"axis '{path}' has the same value twice: {clean(list(written), 60)}")
        return Values(tuple(written))
    if is_ensemble(written):
        return _ensemble(path, written["ensemble"])
    names = [name for name in kinds if name not in ("values", "ensemble")]
    if not isinstance(written, dict) or len(written) != 1 or next(iter(written)) not in names:
        valid = f"write a list, or one of {', '.join(names)} with its numbers"
        raise StudyError(f"axis '{path}' = {clean(written, 60)}: {valid}")
    ((name, numbers),) = written.items()
    wanted = [f.name for f in fields(kinds[name]) if f.name != "kind"]
    if not isinstance(numbers, list | tuple) or len(numbers) != len(wanted) or not all(map(_is_number, numbers)):
        raise StudyError(f"axis '{path}': {name} takes [{', '.join(wanted)}], not {clean(numbers, 60)}")
    try:
        return kinds[name](*numbers)
    except StudyError as error:
        raise StudyError(f"axis '{path}' = {clean(written, 60)}: {error}") from None


def _ensemble(path: str, draws: Any) -> Ensemble:
    if not isinstance(draws, dict) or not draws or not all(isinstance(value, dict) for value in draws.values()):
        raise StudyError(
            f"axis '{path}': an ensemble is the name of a file that `heli-twin calibrate --out DIR` writes, not"
            f" {clean(draws, 60)}"
        )
    return Ensemble(tuple(draws), tuple(draws.values()))


def extremes(axis: Axis) -> list[Any]:
    """The values to try one at a time: all of a list or an ensemble, the two ends of a range or distribution."""
    if isinstance(axis, Values | Ensemble):
        return list(axis.values)
    ends = (0.0, 1.0) if axis.count() > 1 else (0.0,) if axis.count() else EXTREME_QUANTILES
    return [_tidy(axis.quantile(p)) for p in ends]


def share_of(axis: Axis, value: float) -> float:
    """Return the share of a range (`linspace`, `logspace`, `uniform`) below a value, whose `quantile` it is."""
    if isinstance(axis, Logspace):
        return math.log(value / axis.start) / math.log(axis.stop / axis.start)
    low, high = axis.quantile(0.0), axis.quantile(1.0)
    return (value - low) / (high - low)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _whole(number: float) -> None:
    if number != int(number) or number < 1:
        raise StudyError("the last number says how many values, 1 or more")


def _tidy(value: float) -> float:
    """Without the last digits that only rounding put there, so that 0.03 is 0.03 and ids stay the same."""
    return float(f"{value:.12g}")
