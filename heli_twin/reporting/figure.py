"""Figures as values: the data, not the drawing. One description makes the interactive picture and the printed one."""

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Style = Literal["line", "points", "steps", "dashes"]


class Curve(NamedTuple):
    """Points, or a line through them, with a band."""

    label: str
    x: Array
    y: Array
    low: Array | None = None
    high: Array | None = None
    style: Style = "line"
    commands: Sequence[str] = ()
    """For each point the command that flies it again."""
    color: int = 0


class Bars(NamedTuple):
    """Bars by name, from `start` to `start + length`, with intervals about their ends; bars that go down are grey."""

    label: str
    names: Sequence[str]
    start: Array
    length: Array
    low: Array | None = None
    high: Array | None = None
    commands: Sequence[str] = ()
    color: int = 0


class Dots(NamedTuple):
    """A value with its interval for each name; a text beside it."""

    label: str
    names: Sequence[str]
    value: Array
    low: Array
    high: Array
    texts: Sequence[str] = ()
    commands: Sequence[str] = ()
    color: int = 0


class Heat(NamedTuple):
    """A map, with the contour where half of the flights fail."""

    x: Array
    y: Array
    values: Array
    """(len(y), len(x)); NaN where nothing completed."""
    unit: str
    failure: Array | None = None
    """Failure rate, the same shape."""
    diverging: bool = False
    """Centred on zero."""
    limits: tuple[float, float] | None = None
    commands: Sequence[Sequence[str]] = ()
    dashed: Sequence[float] = ()
    """Further levels of the failure rate, whose contours are dashed."""


Mark = Curve | Bars | Dots | Heat


class Panel(NamedTuple):
    """A pair of axes with its marks."""

    title: str
    x_label: str
    y_label: str
    marks: Sequence[Mark]
    x_log: bool = False
    y_log: bool = False


class Figure(NamedTuple):
    """A figure of the report."""

    name: str
    """The name of its file, without an ending."""
    title: str
    sentence: str
    """One sentence on what it shows."""
    panels: Sequence[Panel]
    same_x: bool = False
    """Whether all panels have one x scale, so that they can be compared."""


class Table(NamedTuple):
    """A table of the report."""

    title: str
    sentence: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    codes: Sequence[int] = ()
    """Columns that hold commands."""


COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#999999")
"""Okabe and Ito's, which colour-blind readers can tell apart."""
DECREASE_COLOR = "#999999"
"""The colour of bars that go down."""
CONTOUR_RATE = 0.5
"""The failure rate that the contour of a map marks."""


def shades(bars: Bars) -> list[str]:
    """The colour of each bar."""
    return [color(bars.color) if length >= 0 else DECREASE_COLOR for length in bars.length]


def color(number: int) -> str:
    """The colour of the n-th alternative."""
    return COLORS[number % len(COLORS)]


def decades(values: Array) -> bool:
    """Return whether values are better shown on a logarithmic axis."""
    values = values[np.isfinite(values)]
    return bool(len(values) and values.min() > 0 and values.max() > 30 * values.min())


def edges(centres: Array, log: bool) -> Array:
    """The n + 1 borders of the cells of a map about these n ascending values; none is negative if no value is."""
    at = np.log(centres) if log else np.asarray(centres, float)
    if len(at) == 1:
        at = at + np.array([-0.5, 0.5])
    else:
        between = 0.5 * (at[1:] + at[:-1])
        at = np.concatenate([[2 * at[0] - between[0]], between, [2 * at[-1] - between[-1]]])
    if log:
        return np.exp(at)
    return np.maximum(at, 0.0) if centres[0] >= 0.0 else at


def crossed(values: Array, *levels: float) -> list[float]:
    """Return the levels that some values reach and others do not, so that a contour can be drawn."""
    if not np.isfinite(values).any():
        return []
    return [level for level in levels if np.nanmax(values) >= level > np.nanmin(values)]


BARS_SENTENCE = "Coloured bars raise it, grey ones lower it"
"""Explains the colours of bars."""
CELLS_WITH_NUMBERS = 12
"""A map with more columns or rows has no room for numbers in its cells."""


def is_negative(mark: Mark) -> bool:
    """Return whether some value along x is negative; an interval alone does not make it so."""
    match mark:
        case Curve() | Heat():
            values = mark.x
        case Bars():
            values = np.concatenate([mark.start, mark.start + mark.length])
        case Dots():
            values = mark.value
    return bool(np.nanmin(values, initial=0.0) < 0.0)


def spans_decades(values: Sequence[Array]) -> bool:
    """Return whether values span so many decades that an axis has powers of ten as its ticks."""
    every = np.concatenate([np.ravel(part) for part in values]) if len(values) else np.zeros(0)
    every = every[np.isfinite(every) & (every > 0.0)]
    return bool(len(every) and every.max() >= 99 * every.min())


def power(value: float) -> str:
    """A power of ten as `10⁻³`."""
    return f"10{str(round(np.log10(value))).translate(str.maketrans('-0123456789', '⁻⁰¹²³⁴⁵⁶⁷⁸⁹'))}"
