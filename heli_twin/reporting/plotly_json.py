"""Figures for the page as JSON for plotly.js. The only module that imports plotly."""

import html
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from heli_twin.reporting.figure import (
    CELLS_WITH_NUMBERS,
    CONTOUR_RATE,
    Array,
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
    shades,
    spans_decades,
)

Trace = dict[str, Any]

WIDE_PX, NARROW_PX = 1100, 360
"""Widths of the two layouts."""
ROW_PX = 330
"""Height of a row of panels."""
DIVERGING_SCALE = [[0.0, "#2166ac"], [0.5, "#f7f7f7"], [1.0, "#b2182b"]]
"""Colours of differences: blue is less, red is more."""
LINE_DASHES = {"dashes": "dash"}
FEW_POINTS = 300
"""So many points have room to be large."""
LETTER_PX = 6.6
"""Width of a letter of the names beside bars and dots."""


def library() -> str:
    """The text of plotly.js."""
    from plotly.offline import get_plotlyjs

    return get_plotlyjs()


def spec(figure: Figure) -> dict[str, Any]:
    """A figure as JSON: traces, and a layout for wide and for narrow windows."""
    traces: list[Trace] = []
    seen: set[str] = set()
    for number, panel in enumerate(figure.panels, 1):
        for mark in panel.marks:
            for trace in _traces(panel, mark):
                label = trace.get("name", "")
                if trace.get("type") == "heatmap":
                    trace["coloraxis"] = f"coloraxis{_tail(number)}"
                trace |= {"xaxis": f"x{_tail(number)}", "yaxis": f"y{_tail(number)}", "legendgroup": label}
                trace["showlegend"] = bool(label) and trace.get("showlegend", True) and label not in seen
                seen |= {label} if trace["showlegend"] else set()
                traces.append(trace)
    columns = 1 if len(figure.panels) == 1 else 3 if len(figure.panels) > 4 else 2
    return {
        "data": traces,
        "layout": _layout(figure, columns, WIDE_PX),
        "narrow": _layout(figure, 1, NARROW_PX),
        "commands": any("customdata" in trace for trace in traces),
    }


def _traces(panel: Panel, mark: Mark) -> Iterator[Trace]:
    match mark:
        case Curve():
            yield from _curve(mark)
        case Bars():
            yield _bars(mark)
        case Dots():
            yield _dots(panel, mark)
        case Heat():
            yield from _heat(panel, mark)


def _curve(mark: Curve) -> Iterator[Trace]:
    if mark.low is not None and mark.high is not None:
        edge = {"x": _list(mark.x), "mode": "lines", "line": {"width": 0}, "hoverinfo": "skip", "showlegend": False}
        yield edge | {"y": _list(mark.low), "name": _plain(mark.label)}
        yield edge | {
            "y": _list(mark.high),
            "name": _plain(mark.label),
            "fill": "tonexty",
            "fillcolor": _faint(color(mark.color)),
        }
    trace: Trace = {"x": _list(mark.x), "y": _list(mark.y), "name": _plain(mark.label), "mode": "lines+markers"}
    trace["line"] = {"color": color(mark.color), "dash": LINE_DASHES.get(mark.style, "solid")}
    trace["marker"] = {"color": color(mark.color), "size": 6}
    # A point at zero is seen whole.
    trace["cliponaxis"] = False
    if mark.style == "points":
        trace |= {"mode": "markers", "type": "scattergl" if len(mark.x) > 1000 else "scatter"}
        trace["marker"] |= {"size": 7, "opacity": 0.75} if len(mark.x) <= FEW_POINTS else {"size": 4, "opacity": 0.6}
    elif mark.style in ("steps", "dashes"):
        trace["mode"] = "lines"
        trace["line"] |= {"shape": "hv"}
    yield _with_commands(trace, mark.commands)


def _bars(mark: Bars) -> Trace:
    end = mark.start + mark.length
    names = [_plain(name) for name in mark.names]
    trace: Trace = {"type": "bar", "orientation": "h", "y": names, "base": _list(mark.start), "x": _list(mark.length)}
    trace |= {"name": _plain(mark.label), "showlegend": False, "marker": {"color": shades(mark)}}
    trace["hovertext"] = [_plain(f"{name}: {value:.3g}") for name, value in zip(mark.names, end, strict=True)]
    trace["hoverinfo"] = "text"
    if mark.low is not None and mark.high is not None:
        trace["error_x"] = _error(end, mark.low, mark.high)
    return _with_commands(trace, mark.commands)


def _dots(panel: Panel, mark: Dots) -> Trace:
    marks = [m for m in panel.marks if isinstance(m, Dots)]
    offset = (marks.index(mark) - 0.5 * (len(marks) - 1)) * 0.7 / max(1, len(marks))
    trace: Trace = {"x": _list(mark.value), "y": [i + offset for i in range(len(mark.names))]}
    trace |= {"name": _plain(mark.label), "mode": "markers", "marker": {"color": color(mark.color), "size": 9}}
    trace["error_x"] = _error(mark.value, mark.low, mark.high)
    texts = mark.texts or [f"{value:.3g}" for value in mark.value]
    trace["hovertext"] = [_plain(f"{mark.label}, {name}: {text}") for name, text in zip(mark.names, texts, strict=True)]
    trace["hoverinfo"] = "text"
    if mark.texts:
        # The interval is drawn already.
        short = [_plain(text.partition(" [")[0].partition(" (")[0]) for text in mark.texts]
        trace |= {"mode": "markers+text", "cliponaxis": False, "text": short}
        trace |= {"textposition": "top center", "textfont": {"size": 11}}
    return _with_commands(trace, mark.commands)


def _heat(panel: Panel, mark: Heat) -> Iterator[Trace]:
    z = [_list(row) for row in mark.values]
    x, y = edges(mark.x, panel.x_log), edges(mark.y, panel.y_log)
    trace: Trace = {"type": "heatmap", "x": _list(x), "y": _list(y), "z": z, "showlegend": False}
    trace["hovertemplate"] = f"%{{x:.4g}}, %{{y:.4g}}: %{{z:.3g}} {mark.unit}<extra></extra>"
    if mark.commands:
        trace["customdata"] = [list(row) for row in mark.commands]
    yield trace
    if max(mark.values.shape) <= CELLS_WITH_NUMBERS:
        yield _numbers(mark)
    if mark.failure is not None:
        z = [_list(row) for row in mark.failure]
        for level in crossed(mark.failure, CONTOUR_RATE, *mark.dashed):
            is_main = level == CONTOUR_RATE
            yield {
                "type": "contour", "x": _list(mark.x), "y": _list(mark.y), "z": z,
                "contours": {"coloring": "none", "start": level, "end": level, "size": 1},
                "line": {"color": "black", "width": 3} if is_main else {"color": "black", "width": 1.5, "dash": "dash"},
                "hoverinfo": "skip", "showlegend": False, "showscale": False,
            }  # fmt: skip


def _numbers(mark: Heat) -> Trace:
    """The value in each cell, dark on light and light on dark."""
    x, y = np.meshgrid(mark.x, mark.y)
    values = mark.values.ravel()
    low, high = mark.limits or (np.nanmin(values, initial=0.0), np.nanmax(values, initial=0.0))
    most = max(float(np.nanmax(np.abs(values), initial=0.0)), 1e-30)
    is_dark = np.abs(values) > 0.6 * most if mark.diverging else values < 0.5 * (low + high)
    return {
        "type": "scatter", "mode": "text", "x": _list(x.ravel()), "y": _list(y.ravel()), "hoverinfo": "skip",
        "text": [f"{value:.3g}" if np.isfinite(value) else "" for value in values], "showlegend": False,
        "textfont": {"size": 10, "color": ["#fff" if dark else "#222" for dark in is_dark]},
    }  # fmt: skip


def _layout(figure: Figure, columns: int, width: int) -> dict[str, Any]:
    rows = -(-len(figure.panels) // columns)
    names = max((len(_names(panel)) for panel in figure.panels), default=0)
    height = max(ROW_PX if width == WIDE_PX else 280, 34 * names + 120)
    total = rows * height
    layout: dict[str, Any] = {
        "height": total + 130,
        "margin": {"l": 60, "r": 20, "t": 40, "b": 90},
        "legend": {"orientation": "h", "y": -55 / total, "yanchor": "top"},
        "font": {"family": "system-ui, sans-serif", "size": 12},
        "plot_bgcolor": "#fff",
        "hovermode": "closest",
        "annotations": [],
    }
    letters = max((len(name) for panel in figure.panels for name in _names(panel)), default=0)
    of_names = LETTER_PX * letters / (width / columns)
    left = min(max(of_names, 0.15), 0.6) if columns > 1 else 0.0
    gap = 95 / total
    tall = (1 - (rows - 1) * gap) / rows
    for number, panel in enumerate(figure.panels):
        row, column = divmod(number, columns)
        x0, x1 = (column + left * (column > 0)) / columns, (column + 1) / columns - (0.02 if columns > 1 else 0)
        y1 = 1 - row * (tall + gap)
        tail = _tail(number + 1)
        heat = next((mark for mark in panel.marks if isinstance(mark, Heat)), None)
        if heat is not None:
            layout[f"coloraxis{tail}"] = _color_axis(heat, x1 - 0.06, y1 - tall, tall)
            x1 -= 0.07
        layout[f"xaxis{tail}"] = _x_axis(panel, [x0, x1], tail)
        if figure.same_x and number:
            layout[f"xaxis{tail}"]["matches"] = "x"
        layout[f"yaxis{tail}"] = _y_axis(panel, [max(0.0, y1 - tall), y1], tail)
        layout["annotations"].append(_title(panel, x0, y1))
    return layout


def _color_axis(mark: Heat, x: float, y: float, length: float) -> dict[str, Any]:
    """A map's colours, with their bar to the right of it."""
    bar = {
        "title": {"text": mark.unit},
        "thickness": 10,
        "x": x,
        "xanchor": "left",
        "y": y,
        "yanchor": "bottom",
        "len": length,
    }
    if mark.diverging:
        return {"colorscale": DIVERGING_SCALE, "cmid": 0, "colorbar": bar}
    ends = {"cmin": mark.limits[0], "cmax": mark.limits[1]} if mark.limits else {}
    return {"colorscale": "Cividis", "colorbar": bar, **ends}


def _x_axis(panel: Panel, domain: list[float], tail: str) -> dict[str, Any]:
    axis = _axis(panel.x_label, domain, f"y{tail}") | {"type": "log" if panel.x_log else "linear"}
    if panel.x_log:
        axis |= _log_ticks([mark.x for mark in panel.marks if isinstance(mark, Curve | Heat)])
    elif not any(is_negative(mark) for mark in panel.marks):
        axis["rangemode"] = "nonnegative"
    if ends := _ends(panel, 0):
        axis["range"] = ends
    elif any(isinstance(mark, Dots) for mark in panel.marks) and not panel.x_log:
        axis["rangemode"] = "tozero"
    return axis


def _axis(label: str, domain: list[float], anchor: str) -> dict[str, Any]:
    look = {"zeroline": False, "gridcolor": "#eee", "linecolor": "#888", "ticks": "outside"}
    return {"domain": domain, "anchor": anchor, "title": {"text": _plain(label)}, **look}


def _y_axis(panel: Panel, domain: list[float], tail: str) -> dict[str, Any]:
    axis = _axis(panel.y_label, domain, f"x{tail}")
    if any(isinstance(mark, Bars) for mark in panel.marks):
        return axis | {"autorange": "reversed", "automargin": True, "type": "category"}
    if names := _names(panel):
        ticks = {"tickvals": list(range(len(names))), "ticktext": [_plain(name) for name in names]}
        return axis | ticks | {"range": [len(names) - 0.4, -0.6], "automargin": True}
    if panel.y_log:
        axis |= {"type": "log", **_log_ticks([mark.y for mark in panel.marks if isinstance(mark, Curve | Heat)])}
    else:
        axis["rangemode"] = "tozero"
    ends = _ends(panel, 1)
    return axis | ({"range": ends} if ends else {})


def _log_ticks(values: Sequence[Array]) -> dict[str, Any]:
    """Ticks of a logarithmic axis: powers of ten, or 1, 2 and 5 where there are few."""
    return {"dtick": 1, "exponentformat": "power"} if spans_decades(values) else {"dtick": "D2"}


def _ends(panel: Panel, side: int) -> list[float]:
    """The whole of a map, its empty cells too; plotly wants logarithms on a logarithmic axis."""
    log = panel.y_log if side else panel.x_log
    for mark in panel.marks:
        if isinstance(mark, Heat):
            low, *_, high = edges(mark.y if side else mark.x, log)
            return [float(np.log10(end)) for end in (low, high)] if log else [float(low), float(high)]
    return []


def _title(panel: Panel, x: float, y: float) -> dict[str, Any]:
    return {
        "text": f"<b>{_plain(panel.title)}</b>", "x": x, "y": y, "xref": "paper", "yref": "paper", "xanchor": "left",
        "yanchor": "bottom", "showarrow": False,
    }  # fmt: skip


def _plain(text: str) -> str:
    """Text that plotly shows as it is: it reads some HTML."""
    return html.escape(text, quote=False)


def _names(panel: Panel) -> Sequence[str]:
    return next((mark.names for mark in panel.marks if isinstance(mark, Bars | Dots)), ())


def _error(value: Array, low: Array, high: Array) -> dict[str, Any]:
    up, down = _list(np.maximum(high - value, 0)), _list(np.maximum(value - low, 0))
    return {"type": "data", "symmetric": False, "array": up, "arrayminus": down, "color": "#444", "thickness": 1.2}


def _with_commands(trace: Trace, commands: Sequence[str]) -> Trace:
    return trace | {"customdata": list(commands)} if commands else trace


def _list(values: Array) -> list[float | None]:
    """Numbers with six digits, which a picture does not exceed; None for NaN, which JSON does not have."""
    return [float(f"{value:.6g}") if np.isfinite(value) else None for value in np.asarray(values, float)]


def _faint(code: str) -> str:
    red, green, blue = (int(code[i : i + 2], 16) for i in (1, 3, 5))
    return f"rgba({red},{green},{blue},0.15)"


def _tail(number: int) -> str:
    return "" if number == 1 else str(number)
