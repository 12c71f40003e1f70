"""Morris screening: how much each axis changes the score, and how differently from place to place."""

from collections.abc import Iterator

import numpy as np

from heli_twin.reporting.figure import Array, Dots, Figure, Panel
from heli_twin.reporting.intervals import Interval, Screening, screening
from heli_twin.reporting.words import listed, metric, number
from heli_twin.studies.report.results import INDEPENDENT_SENTENCE, Results

SMALL = 0.1
"""Share of the greatest mu* below which an axis may be left out of what follows."""


def morris(results: Results) -> Iterator[Figure]:
    """The mean size of the elementary effects of each axis, and their standard deviation."""
    if "moved" not in results:
        return
    scale, paths = metric(results.study.score), list(results.axes)
    panels = [
        Panel(
            alternative,
            f"effect on the {scale.label}",
            "",
            [_dots("mu*: mean size", found.mu_star, paths, 0), _dots("sigma: scatter", found.sigma, paths, 1)],
        )
        for alternative, found in _screened(results).items()
        if found is not None
    ]
    text = (
        f"{'; '.join(told_morris(results))}{results.one_seed}. Changes of the score, failures penalised, with intervals"
        " over the trajectories; a sigma as great as mu* means that the effect depends on the place: it is curved, or"
        f" another axis changes it. {INDEPENDENT_SENTENCE}"
    )
    yield Figure("morris", "Morris screening", text, panels, same_x=True)


def told_morris(results: Results) -> Iterator[str]:
    """The order of the axes in a line for each alternative."""
    if "moved" not in results:
        return
    unit, paths = metric(results.study.score).unit, list(results.axes)
    for alternative, found in _screened(results).items():
        told = "points are missing, run the study to its end" if found is None else _ranked(found, paths, unit)
        yield f"{alternative}: {told}"


def _screened(results: Results) -> dict[str, Screening | None]:
    """Each alternative's measures, in the shown unit; None where flights are missing."""
    factor, paths = metric(results.study.score).factor, list(results.axes)
    effects = {name: elementary_effects(results.of(name), paths) for name in results.alternatives}
    return {name: screening(each * factor) if np.isfinite(each).all() else None for name, each in effects.items()}


def elementary_effects(mine: Results, paths: list[str]) -> Array:
    """Return the change of the score by each move of an axis, as if over its whole range.

    Args:
        mine: Rows of one alternative.
        paths: The axes.

    Returns:
        (trajectories, axes); NaN where a flight is missing. Scores are means over the seeds.
    """
    trajectory, move = mine["trajectory"].astype(int), mine["move"].astype(int)
    shape = (int(trajectory.max()) + 1, len(paths) + 1)
    cell = trajectory * shape[1] + move
    n = np.bincount(cell, minlength=shape[0] * shape[1])
    with np.errstate(invalid="ignore"):
        scores = (np.bincount(cell, mine.penalised, shape[0] * shape[1]) / n).reshape(shape)
    effects = np.full((shape[0], len(paths)), np.nan)
    axis_of_row = np.array([paths.index(path) if path in paths else -1 for path in mine["moved"]])
    moved = axis_of_row >= 0
    t, m, axis = trajectory[moved], move[moved], axis_of_row[moved]
    effects[t, axis] = (scores[t, m] - scores[t, m - 1]) / mine["by"][moved].astype(float)
    return effects


def _ranked(found: Screening, paths: list[str], unit: str) -> str:
    """The order of the axes, and which of them may be left out."""
    order = sorted(range(len(paths)), key=lambda i: -found.mu_star[i].value)
    top = found.mu_star[order[0]].value
    ranked = ", ".join(f"{paths[i]} {number(found.mu_star[i].value)} {unit}".rstrip() for i in order)
    small = [paths[i] for i in order if found.mu_star[i].high < SMALL * top]
    if not small:
        return f"mu* {ranked}"
    return f"mu* {ranked}; a Sobol study may leave out {listed(small)}, below {100 * SMALL:.0f} % of the first"


def _dots(label: str, intervals: list[Interval], paths: list[str], color: int) -> Dots:
    value, low, high = (np.array([getattr(f, part) for f in intervals]) for part in ("value", "low", "high"))
    return Dots(label, paths, value, low, high, color=color)
