"""Figures of reports, drawn by matplotlib: the same data give the same bytes."""

import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from heli_twin.reporting.figure import (
    CELLS_WITH_NUMBERS,
    CONTOUR_RATE,
    Bars,
    Curve,
    Dots,
    Figure,
    Heat,
    Mark,
    Panel,
    color,
    crossed,
    edges,
    is_negative,
    power,
    shades,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

RC_PARAMETERS: dict[Any, Any] = {
    "svg.hashsalt": "heli_twin",
    "font.size": 8,
    # A name may hold a dollar sign.
    "text.parse_math": False,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#eeeeee",
    "axes.axisbelow": True,
    "legend.frameon": False,
    "lines.linewidth": 1.2,
    "lines.markersize": 3,
}
PANEL_WIDTH_INCHES = 3.5
"""Width of a column in a paper."""
MANY_CELLS = 40
"""A map with more columns or rows is an image."""
LINE_STYLES = {"line": "-", "steps": "-", "dashes": "--"}


def write_svg(figure: Figure, path: Path) -> None:
    """Draw a figure; it has no date and no random ids."""
    import matplotlib as mpl
    from matplotlib.figure import Figure as Canvas

    with mpl.rc_context(RC_PARAMETERS), warnings.catch_warnings():
        # A letter that the font does not have is drawn as a box.
        warnings.filterwarnings("ignore", "Glyph .* missing from font")
        panels = figure.panels
        columns = 1 if len(panels) == 1 else 3 if len(panels) > 4 else 2
        rows = -(-len(panels) // columns)
        names = [mark.names for p in panels for mark in p.marks if isinstance(mark, Bars | Dots)]
        height = max(2.4, *(0.26 * len(rows_) + 0.8 for rows_ in names), 0.0)
        # Room for names that are longer than numbers.
        longest = max((len(name) for rows_ in names for name in rows_), default=0)
        width = PANEL_WIDTH_INCHES + 0.06 * max(longest - 12, 0)
        canvas = Canvas(figsize=(width * columns, height * rows), layout="constrained")
        places = canvas.subplots(rows, columns, squeeze=False).ravel()
        for axes, panel in zip(places, panels, strict=False):
            _panel(axes, panel)
        for axes in places[len(panels) :]:
            axes.set_visible(False)
        if figure.same_x:
            ends = np.array([axes.get_xlim() for axes in places[: len(panels)]])
            for axes in places[: len(panels)]:
                axes.set_xlim(ends.min(), ends.max())
        _legend(canvas, figure)
        canvas.savefig(path, format="svg", metadata={"Date": None}, dpi=200)


def _panel(axes: "Axes", panel: Panel) -> None:
    axes.set_title(panel.title, loc="left", fontweight="bold", fontsize=8)
    axes.set_xlabel(panel.x_label)
    axes.set_ylabel(panel.y_label)
    dots = [mark for mark in panel.marks if isinstance(mark, Dots)]
    for mark in panel.marks:
        match mark:
            case Curve():
                _curve(axes, mark)
            case Bars():
                _bars(axes, mark)
            case Dots():
                _dots(axes, mark, (dots.index(mark) - 0.5 * (len(dots) - 1)) * 0.7 / len(dots))
            case Heat():
                _heat(axes, mark, panel)
    if panel.x_log:
        _log_scale(axes, "x")
    elif dots and axes.dataLim.x0 >= 0:
        # Room for the text over the last dot.
        axes.set_xlim(0, 1.1 * axes.dataLim.x1)
    elif not any(is_negative(mark) for mark in panel.marks):
        axes.set_xlim(left=max(axes.get_xlim()[0], 0.0))
    if panel.y_log:
        _log_scale(axes, "y")
    if any(isinstance(mark, Heat | Bars | Dots) for mark in panel.marks):
        axes.grid(False)
    elif not panel.y_log and axes.dataLim.y0 >= 0:
        axes.set_ylim(bottom=0)


def _log_scale(axes: "Axes", name: Literal["x", "y"]) -> None:
    """A logarithmic axis that has numbers even where it is shorter than a decade."""
    from matplotlib.ticker import LogLocator, NullFormatter

    axis: Any = axes.xaxis if name == "x" else axes.yaxis
    axes.set(**{f"{name}scale": "log"})
    low, high = axis.get_view_interval()
    subs = (1.0, 2.0, 5.0) if high < 10 * low else (1.0, 3.0) if high < 100 * low else (1.0,)
    axis.set_major_locator(LogLocator(subs=subs))
    axis.set_major_formatter("{x:g}" if len(subs) > 1 else _power_of_ten)
    axis.set_minor_formatter(NullFormatter())


def _power_of_ten(value: float, place: object) -> str:
    return power(value)


def _curve(axes: "Axes", mark: Curve) -> None:
    shade = color(mark.color)
    if mark.low is not None and mark.high is not None:
        axes.fill_between(mark.x, mark.low, mark.high, color=shade, alpha=0.15, linewidth=0)
    if mark.style == "points":
        size = 5 if len(mark.x) <= 300 else 2
        axes.plot(mark.x, mark.y, ".", color=shade, markersize=size, label=mark.label, rasterized=len(mark.x) > 5000)
    elif mark.style == "line":
        # A point at zero is seen whole.
        axes.plot(mark.x, mark.y, "o-", color=shade, label=mark.label, clip_on=False)
    else:
        axes.step(mark.x, mark.y, LINE_STYLES[mark.style], where="post", color=shade, label=mark.label)


def _bars(axes: "Axes", mark: Bars) -> None:
    y = np.arange(len(mark.names))
    axes.barh(y, mark.length, left=mark.start, color=shades(mark), height=0.7)
    if mark.low is not None and mark.high is not None:
        end = mark.start + mark.length
        axes.errorbar(
            end, y, xerr=_error(end, mark.low, mark.high), fmt="none", ecolor="#444444", elinewidth=0.8, capsize=1.5
        )
    axes.set_yticks(y, mark.names)
    axes.set_ylim(len(mark.names) - 0.4, -0.6)


def _dots(axes: "Axes", mark: Dots, offset: float) -> None:
    y = np.arange(len(mark.names)) + offset
    error = _error(mark.value, mark.low, mark.high)
    axes.errorbar(
        mark.value, y, xerr=error, fmt="o", color=color(mark.color), label=mark.label, elinewidth=1, capsize=2
    )
    for x, place, text in zip(mark.value, y, mark.texts, strict=False):
        short = text.partition(" [")[0].partition(" (")[0]
        axes.annotate(short, (x, place), xytext=(0, 4), textcoords="offset points", ha="center", fontsize=6)
    axes.set_yticks(range(len(mark.names)), mark.names)
    axes.set_ylim(len(mark.names) - 0.4, -0.6)


def _heat(axes: "Axes", mark: Heat, panel: Panel) -> None:
    options: dict[str, Any] = {"cmap": "RdBu_r" if mark.diverging else "cividis"}
    if mark.diverging:
        top = float(np.nanmax(np.abs(mark.values))) if np.isfinite(mark.values).any() else 1.0
        options |= {"vmin": -top, "vmax": top}
    elif mark.limits:
        options |= {"vmin": mark.limits[0], "vmax": mark.limits[1]}
    x, y = edges(mark.x, panel.x_log), edges(mark.y, panel.y_log)
    # Between many drawn cells there are seams.
    options["rasterized"] = max(mark.values.shape) > MANY_CELLS
    picture = axes.pcolormesh(x, y, np.ma.masked_invalid(mark.values), **options)
    axes.set_xlim(x[0], x[-1])
    axes.set_ylim(y[0], y[-1])
    axes.figure.colorbar(picture, ax=axes, label=mark.unit)
    if max(mark.values.shape) <= CELLS_WITH_NUMBERS // 2:
        _numbers(axes, mark, picture)
    if mark.failure is not None:
        for level in crossed(mark.failure, CONTOUR_RATE, *mark.dashed):
            dashes: Any = "solid" if level == CONTOUR_RATE else "dashed"
            width = 1.5 if level == CONTOUR_RATE else 0.8
            axes.contour(mark.x, mark.y, mark.failure, [level], colors="black", linewidths=width, linestyles=dashes)


def _numbers(axes: "Axes", mark: Heat, picture: Any) -> None:
    """Write its value into each cell, dark on light and light on dark."""
    shade = picture.cmap(picture.norm(mark.values))[..., :3].mean(axis=-1)
    for j, y in enumerate(mark.y):
        for i, x in enumerate(mark.x):
            if np.isfinite(mark.values[j, i]):
                ink = "black" if shade[j, i] > 0.5 else "white"
                axes.text(x, y, f"{mark.values[j, i]:.3g}", ha="center", va="center", fontsize=5, color=ink)


def _error(value: Any, low: Any, high: Any) -> Any:
    return np.nan_to_num(np.maximum(np.array([value - low, high - value]), 0))


def _legend(canvas: Any, figure: Figure) -> None:
    """Draw one legend for all panels below them."""
    labels: dict[str, Mark] = {}
    for panel in figure.panels:
        labels |= {mark.label: mark for mark in panel.marks if isinstance(mark, Curve | Dots) and mark.label}
    if len(labels) < 2:
        return
    entries: dict[str, Any] = {}
    for axes in canvas.axes:
        handles, names = axes.get_legend_handles_labels()
        entries |= {name: handle for handle, name in zip(handles, names, strict=True) if name not in entries}
    for columns in range(min(4, len(entries)), 0, -1):
        legend = canvas.legend(entries.values(), entries.keys(), loc="outside lower center", ncols=columns)
        if columns == 1 or legend.get_window_extent().width <= canvas.bbox.width:
            break
        legend.remove()
