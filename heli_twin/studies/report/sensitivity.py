"""Sobol indices: which axes the variance of the score comes from."""

from collections.abc import Iterator

import numpy as np

from heli_twin.reporting.figure import Array, Dots, Figure, Panel
from heli_twin.reporting.intervals import Interval, Sensitivity, sobol
from heli_twin.reporting.words import number
from heli_twin.studies.report.results import INDEPENDENT_SENTENCE, Results


def sensitivity(results: Results) -> Iterator[Figure]:
    """First and total order indices of each axis."""
    if "matrix" not in results:
        return
    paths = list(results.axes)
    panels, sentences = [], []
    for alternative in results.alternatives:
        mine = results.of(alternative)
        samples = int(mine["sample"].max()) + 1
        A, B, *AB = (_scores(mine, name, samples) for name in ("A", "B", *paths))
        if not np.isfinite([A, B, *AB]).all():
            sentences.append(f"{alternative}: points are missing, run the study to its end")
            continue
        found = sobol(A, B, np.array(AB))
        panels.append(Panel(alternative, "share of the variance", "", _dots(found, paths)))
        order = np.argsort([-f.value for f in found.total])
        ranked = ", ".join(f"{paths[i]} {number(found.total[i].value, 2)}" for i in order[:3])
        sentences.append(f"{alternative}: total order {ranked}")
    kept = f"score with failures penalised, {len(results):,} flights; intervals over the drawn points"
    text = "; ".join(sentences) + f" ({kept}){results.one_seed}. {INDEPENDENT_SENTENCE}"
    yield Figure("sobol", "Sobol indices", text, panels)


def _scores(mine: Results, matrix: str, samples: int) -> Array:
    """The mean score over the seeds of each row of a matrix."""
    rows = mine.where(mine["matrix"] == matrix)
    place = rows["sample"].astype(np.int64)
    n = np.bincount(place, minlength=samples)
    with np.errstate(invalid="ignore"):
        return np.bincount(place, rows.penalised, samples) / n


def _dots(found: Sensitivity, paths: list[str]) -> list[Dots]:
    return [
        _dot("first order: alone", found.first, paths, 1),
        _dot("total order: with interactions", found.total, paths, 0),
    ]


def _dot(label: str, intervals: list[Interval], paths: list[str], color: int) -> Dots:
    value, low, high = (np.array([getattr(f, part) for f in intervals]) for part in ("value", "low", "high"))
    return Dots(label, paths, value, low, high, color=color)
