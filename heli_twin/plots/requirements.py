"""The moments at which a flight comes nearest to breaking its requirements, with their names and margins."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from heli_twin.metrics.motion import motion
from heli_twin.plots.runs import Run
from heli_twin.terminal_text import clean

HOLDS, BROKEN = "#117733", "#CC3311"
NAME_LIMIT = 40
"""Characters of a requirement's name in a legend."""
FLIGHT_LIMIT = 24
"""The same of a flight's name after it."""
NUMBER_INCHES = 0.08
"""Width of a number beside its line."""
_BOX = {"boxstyle": "round,pad=0.15", "facecolor": "white", "linewidth": 0.5}


def mark_tightest(axes: Any, run: Run, *, alone: bool, numbered: bool) -> None:
    """Draw a line at the tightest moment of each requirement, and say in the legend which it is.

    Args:
        axes: Of matplotlib, with time in s along x.
        run: The flight.
        alone: Whether it is the only one there: its lines are then green, or red where a requirement is broken; else
            they have its colour.
        numbered: Whether the numbers of the legend stand at the lines.
    """
    places: list[tuple[float, str, str]] = []
    for number, verdict in enumerate(run.verdicts, 1):
        shade, t = _shade(run, verdict.holds, alone), verdict.tightest_at
        label = _label(number, run, alone)
        if t is None or not run.start <= t <= run.end + 1e-9:
            axes.plot([], [], linestyle="none", label=label)
            continue
        axes.axvline(t, color=shade, linewidth=0.8, zorder=1.1, label=label)
        places.append((t, str(number), shade))
    if not numbered:
        return
    width = axes.get_position().width * axes.get_figure(root=True).get_figwidth()
    for t, text, shade in _grouped(sorted(places), NUMBER_INCHES * (run.end - run.start) / width):
        axes.annotate(
            text,
            (t, 0.0),
            xycoords=axes.get_xaxis_transform(),
            xytext=(0, 3),
            textcoords="offset points",
            ha="right" if t > run.end - 0.03 * (run.end - run.start) else "left",
            va="bottom",
            fontsize=5,
            color=shade,
            bbox=_BOX | {"edgecolor": shade},
            zorder=5,
        )


def place_tightest(axes: Any, run: Run, across: int, up: int, *, alone: bool) -> None:
    """Draw a diamond where the helicopter was at the tightest moment of each requirement.

    Args:
        axes: Of matplotlib, with two coordinates of the position.
        run: The flight.
        across: Coordinate along x.
        up: Coordinate along y.
        alone: As for `mark_tightest`.
    """
    moved = motion(run.log)
    for number, verdict in enumerate(run.verdicts, 1):
        t = verdict.tightest_at
        if t is None or not run.start <= t <= run.end + 1e-9:
            continue
        at = [float(np.interp(t, moved.time, moved.state[:, i])) for i in (across, up)]
        style = {"color": _shade(run, verdict.holds, alone), "markersize": 4, "linestyle": "none", "zorder": 5}
        axes.plot(*at, marker="D", label=_label(number, run, alone), **style)
        axes.annotate(str(number), at, xytext=(3, 3), textcoords="offset points", fontsize=5)


def rows(shown: Sequence[Run]) -> int:
    """Return how many entries the legend gets."""
    return sum(len(run.verdicts) for run in shown)


def _label(number: int, run: Run, alone: bool) -> str:
    verdict = run.verdicts[number - 1]
    whose = "" if alone else f", {clean(run.name, FLIGHT_LIMIT)}"
    when = "" if verdict.tightest_at is None or verdict.margin is None else f" at {verdict.tightest_at:.2f} s"
    return f"{number} {clean(verdict.requirement.name, NAME_LIMIT)}{whose}: {verdict.told}{when}"


def _shade(run: Run, holds: bool, alone: bool) -> str:
    return (HOLDS if holds else BROKEN) if alone else run.color


def _grouped(places: list[tuple[float, str, str]], apart: float) -> Iterator[tuple[float, str, str]]:
    """Join the numbers of lines that are too near each other for two boxes."""
    group: list[tuple[float, str, str]] = []
    for place in places:
        if group and place[0] > group[0][0] + apart * (1 + 2 * len(group)):
            yield group[0][0], ", ".join(text for _, text, _ in group), _of_group(group)
            group = []
        group.append(place)
    if group:
        yield group[0][0], ", ".join(text for _, text, _ in group), _of_group(group)


def _of_group(group: list[tuple[float, str, str]]) -> str:
    shades = {shade for _, _, shade in group}
    return BROKEN if BROKEN in shades else group[0][2]
