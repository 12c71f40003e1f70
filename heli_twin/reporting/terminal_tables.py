"""Tables and numbers on a terminal, the same in every command: lengths in cm, angles in deg, times in ms."""

import sys
from collections.abc import Mapping, Sequence
from typing import Any

from heli_twin.terminal_text import clean

CELL_LIMIT = 400
"""Characters of one cell."""
UNWRAPPED = 1000
"""Width of a table that is not printed on a terminal: one line a row, for programs such as grep."""
MISSING = "-"
STATISTICS = (("largest", "max_abs_error"), ("root mean square", "rmse"))
TIMES = (("control step", "control_step_ms"), ("QP solve", "solve_ms"))


def terminal_width() -> int:
    """Characters of a line that is not wrapped."""
    from rich.console import Console

    return Console().width if sys.stdout.isatty() else UNWRAPPED


def print_table(
    header: Sequence[str], rows: Sequence[Sequence[str]], title: str = "", left: Sequence[int] = (0,)
) -> None:
    """Print a table; columns are right-aligned but those of `left`, which alone wrap. A cell may have lines."""
    from rich import box
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(
        title=Text(clean(title)) if title else None, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False
    )
    for i, name in enumerate(header):
        wraps = i in left
        table.add_column(
            Text(name),
            justify="left" if wraps else "right",
            no_wrap=not wraps,
            overflow="fold" if wraps else "ellipsis",
        )
    for row in rows:
        table.add_row(*(Text("\n".join(clean(line, CELL_LIMIT) for line in cell.split("\n"))) for cell in row))
    Console(width=terminal_width()).print(table)


def length(metres: float | None) -> str:
    """A length for a person: `3.21 cm`."""
    return _number(metres, 100.0, " cm")


def angle(radians: float | None) -> str:
    """An angle for a person: `1.20 deg`."""
    return _number(radians, 57.29577951308232, " deg")


def milliseconds(value: float | None) -> str:
    """A time in ms for a person: `0.23 ms`."""
    return _number(value, 1.0, " ms")


def metric_text(name: str, value: Any, *, signed: bool = False) -> str:
    """The value of a metric with its unit, `4.23 cm` for `rmse.x`; with a sign for a difference."""
    from heli_twin.reporting.words import metric

    if isinstance(value, bool) or not isinstance(value, int | float):
        return MISSING if value is None else clean(value)
    scale = metric(name)
    if isinstance(value, int) and scale.factor == 1:
        return f"{value:+d}" if signed else f"{value}"
    shown = f"{value * scale.factor:{'+' if signed else ''}#.3g}".rstrip(".")
    return f"{shown} {scale.unit}".rstrip()


def _number(value: float | None, factor: float, unit: str) -> str:
    return MISSING if value is None or value - value != 0.0 else f"{factor * value:.2f}{unit}"


def print_errors(metrics: Mapping[str, Any]) -> None:
    """Print the errors of a flight and its measured times."""
    rows = [
        (name, *(length(metrics[key][axis]) for axis in "xyz"), angle(metrics[key]["yaw"])) for name, key in STATISTICS
    ]
    title = f"error against the truth, from {metrics['settling']:g} s on"
    print_table(("", "x", "y", "z", "yaw"), rows, title)
    times = [(name, *(milliseconds(metrics[key][p]) for p in ("p50", "p99", "max"))) for name, key in TIMES]
    print_table(("", "median", "99 %", "largest"), times, "measured times")


def control_problems(metrics: Mapping[str, Any]) -> str:
    """How the control problems of a flight were solved: `1499 solved, 1 step before the first pose`."""
    counts, blind = dict(metrics["qp_status"]), metrics.get("steps_before_first_pose", 0)
    counts["safe_hover"] = counts.get("safe_hover", 0) - blind
    told = [f"{count} {status}" for status, count in counts.items() if count]
    return ", ".join(told + [f"{blind} step{'s' if blind > 1 else ''} before the first pose"] * bool(blind)) or "none"
