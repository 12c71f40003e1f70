"""The public side of the figures of flights: draw one, and write it to a file."""

import warnings
from collections.abc import Mapping, Sequence
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

from heli_twin.errors import HeliTwinError
from heli_twin.experiment.scenarios import MOST_SHIPS
from heli_twin.plots import distance, estimate, inputs, path, timing, tracking
from heli_twin.plots.requirements import rows
from heli_twin.plots.runs import Run, runs
from heli_twin.reporting.svg import RC_PARAMETERS
from heli_twin.requirements import requirements_of
from heli_twin.terminal_text import instead
from heli_twin.whole_file import write_whole

_KINDS = {
    "tracking": tracking,
    "inputs": inputs,
    "path": path,
    "estimate": estimate,
    "timing": timing,
    "distance": distance,
}
KINDS = (*_KINDS, "all")
FORMATS = ("svg", "pdf", "png")
PAGE_WIDTH_INCHES, COLUMN_WIDTH_INCHES = 7.16, 3.5
"""Width of a page and of a column of a paper with two columns."""
MOST_OVERLAID, MOST_BESIDE = 8, 4
"""Flights that can be told apart in one pair of axes, and columns that can be read beside each other."""
ROW_INCHES = 0.12
"""Height that an entry of the legend adds: two stand side by side unless they are long."""
DPI = 200
STYLE: dict[Any, Any] = RC_PARAMETERS | {
    # Type 42: publishers refuse matplotlib's default, Type 3.
    "pdf.fonttype": 42,
    "axes.titlesize": 8,
    "legend.fontsize": 7,
    "lines.linewidth": 1.0,
    "axes.formatter.useoffset": False,
    "figure.dpi": DPI,
}


class FlightFigure(Figure):
    """A figure of matplotlib's that notebooks show, though no window and no `pyplot` stands behind it."""

    def _repr_png_(self) -> bytes:
        return rendered(self, "png")


def plot(
    *logs: Any,
    what: str = "tracking",
    start: float | None = None,
    end: float | None = None,
    names: Sequence[str] | None = None,
    width: float = PAGE_WIDTH_INCHES,
    requirements: Path | str | Mapping[str, Any] | None = None,
) -> FlightFigure:
    """Draw recorded flights as a figure for a paper; no window opens, and a notebook shows it.

    Several flights lie over each other in their own colours; `inputs` and `estimate` stand side by side.

    Args:
        logs: Paths of logs, logs that `read_log` has read, or results of `fly`.
        what: `tracking` (flown, reference and error of x, y, z and yaw), `inputs` (sent and acting, with their limits),
            `path` (from above and from the side), `estimate` (its error with two standard deviations), `timing`
            (measured times of control step and solver), `distance` (the least of several helicopters), or `all` of
            them on one long page.
        start: First moment that is shown, s; None for the beginning.
        end: Last moment, s; None for the end of the longest flight.
        names: For the legend; None: the fields in which the experiments differ.
        width: Of the figure, inches: 7.16 fills a page of two columns, 3.5 one column.
        requirements: A file, the name of a shipped one or a mapping: the tightest moment of each is marked, with its
            margin.

    Returns:
        A figure of matplotlib's, to change or to save; `figure.savefig("f.pdf")`, or `heli_twin.plots.save`, whose
        files are the same byte for byte if the logs are.

    Raises:
        HeliTwinError: A log cannot be read or has nothing of the kind, or an argument is out of its limits.
    """
    if what not in KINDS:
        raise HeliTwinError(f"what: unknown figure {instead(what, KINDS)}")
    if not 2.5 <= width <= 30:
        raise HeliTwinError(f"width = {width:g} inches: give 2.5 to 30 inches, such as {PAGE_WIDTH_INCHES}")
    shown = runs(logs, names, start, end, () if requirements is None else requirements_of(requirements))
    kinds = [*_KINDS.values()] if what == "all" else [_KINDS[what]]
    beside = any(kind.BESIDE for kind in kinds)
    most = MOST_SHIPS if kinds == [distance] else MOST_BESIDE if beside else MOST_OVERLAID
    if len(shown) > most:
        how = "side by side" if beside else "in one figure"
        raise HeliTwinError(f"{len(shown)} flights {how} cannot be read: give at most {most} for what = {what}")
    if what == "all":
        # A log without a truth, or without a controller, has no figure of some kinds.
        kinds = [kind for kind in kinds if not kind.lacks(shown)]
    for kind in kinds:
        if trouble := kind.lacks(shown):
            raise HeliTwinError(trouble)
    if not kinds:
        raise HeliTwinError("the logs hold nothing that can be drawn: no positions, inputs or measured times")
    with mpl.rc_context(STYLE), warnings.catch_warnings():
        _quiet()
        return _drawn(kinds, shown, width)


def _drawn(kinds: Sequence[Any], shown: Sequence[Run], width: float) -> FlightFigure:
    heights = [kind.height(shown, width) + ROW_INCHES * rows(shown) for kind in kinds]
    figure = FlightFigure(figsize=(width, sum(heights)), layout="constrained")
    parts = figure.subfigures(len(kinds), 1, height_ratios=heights, squeeze=False).ravel()
    for kind, part in zip(kinds, parts, strict=True):
        kind.draw(part, shown, width)
    return figure


def rendered(figure: Figure, form: str) -> bytes:
    """The bytes of a figure as svg, pdf or png: without a date and random names, so the same data give the same."""
    metadata = {"svg": {"Date": None}, "pdf": {"CreationDate": None}, "png": {}}[form]
    stream = BytesIO()
    with mpl.rc_context(STYLE), warnings.catch_warnings():
        _quiet()
        figure.savefig(stream, format=form, dpi=DPI, metadata=metadata)
    return stream.getvalue()


def _quiet() -> None:
    # A letter that the font does not have is drawn as a box.
    partial(warnings.filterwarnings, "ignore", "Glyph .* missing from font")()


def form_of(file: Path) -> str:
    """The format that a file's name asks for.

    Raises:
        HeliTwinError: It is none that is written.
    """
    form = file.suffix.removeprefix(".").lower()
    if form not in FORMATS:
        raise HeliTwinError(f"cannot write {file}: give it a name that ends in .svg, .pdf or .png")
    return form


def save(figure: Figure, file: Path | str) -> None:
    """Write a figure to `NAME.svg`, `NAME.pdf` or `NAME.png`, whole or not at all.

    Raises:
        HeliTwinError: The name has another ending, or the file cannot be written.
    """
    path = Path(file)
    data = rendered(figure, form_of(path))
    try:
        write_whole(path, data)
    except OSError as error:
        raise HeliTwinError(f"cannot write {path}: {error.strerror}") from None
