"""The worst case found by a search, compared with the worst of as many random points."""

from collections.abc import Iterator

import numpy as np

from heli_twin.reporting.figure import Array, Curve, Figure, Panel, Style
from heli_twin.reporting.words import field, metric, number
from heli_twin.studies.designs.worst_case import Origin
from heli_twin.studies.report.results import Results

STYLES: dict[Origin, Style] = {"search": "steps", "random": "dashes"}


def search(results: Results) -> Iterator[Figure]:
    """The worst score so far against the number of points, for search and random baseline."""
    if "found_by" not in results:
        return
    scale = metric(results.study.score)
    panels, sentences = [], []
    for place, alternative in enumerate(results.alternatives):
        mine = results.of(alternative)
        curves, ends = [], {}
        for origin, style in STYLES.items():
            rows = mine.where(mine["found_by"] == origin)
            if not len(rows):
                continue
            trials, scores, commands = _by_trial(rows)
            worst = np.maximum.accumulate(scores) * scale.factor
            curves.append(
                Curve(
                    origin,
                    trials + 1.0,
                    worst,
                    style=style,
                    commands=commands,
                    color=place if origin == "search" else place + 7,
                )
            )
            ends[origin] = (worst[-1], place_of(rows, int(np.argmax(rows["trial"] == trials[int(np.argmax(scores))]))))
        panels.append(Panel(alternative, "points tried", f"worst {scale.label}", curves))
        sentences.append(_sentence(alternative, ends, scale.unit))
    yield Figure("worst-case", "Worst case", "; ".join(sentences) + f"{results.one_seed}.", panels)


def _by_trial(rows: Results) -> tuple[Array, Array, list[str]]:
    """Mean score over the seeds of each trial, with its worst flight."""
    trials, place = np.unique(rows["trial"], return_inverse=True)
    scores = np.bincount(place, rows.penalised) / np.bincount(place)
    commands = []
    for i in range(len(trials)):
        mine = np.flatnonzero(place == i)
        commands.append(rows.command(int(mine[np.argmax(rows.penalised[mine])])))
    return trials, scores, commands


def place_of(rows: Results, row: int) -> str:
    """The values of the axes of a row, in words."""
    words = []
    for path in rows.axes:
        scale = field(path, rows[path].tolist()) if rows.is_number(path) else None
        value = rows[path][row]
        words.append(f"{path} {number(value * scale.factor)} {scale.unit}".rstrip() if scale else str(value))
    return ", ".join(words)


def _sentence(alternative: str, ends: dict[str, tuple[float, str]], unit: str) -> str:
    if len(ends) < 2:
        return f"{alternative}: not finished"
    (found, where), (chance, _) = ends["search"], ends["random"]
    verdict = "more than" if found > chance * 1.001 else "no more than"
    return (
        f"{alternative}: the search found {number(found)} {unit} at {where}, {verdict} chance's {number(chance)} {unit}"
    )
