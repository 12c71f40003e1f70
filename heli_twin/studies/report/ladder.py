"""The ladder: the error that each effect of the real world adds."""

from collections.abc import Iterator

import numpy as np

from heli_twin.reporting.figure import BARS_SENTENCE, Bars, Figure, Panel, Table
from heli_twin.reporting.intervals import Interval, mean_interval
from heli_twin.reporting.words import interval, metric, number
from heli_twin.studies.report.results import Results, error_bars


def ladder(results: Results) -> Iterator[Figure | Table]:
    """A waterfall of the score for each alternative, and the other metrics by rung."""
    if "rung" not in results:
        return
    heights = np.unique(results["height"])
    names = [str(results["rung"][results["height"] == h][0]) for h in heights]
    scale = metric(results.study.score)
    panels, sentences = [], []
    for place, alternative in enumerate(results.alternatives):
        mine = results.of(alternative)
        found, commands, shown = [], [], []
        for h, name in zip(heights, names, strict=True):
            rung = mine.where(mine["height"] == h)
            found.append(mean_interval(rung.metric(results.study.score)))
            commands.append(rung.command(int(np.argmax(rung.penalised))))
            lost = int(rung.failed.sum())
            shown.append(f"{name} ({lost} of {len(rung)} failed)" if lost else name)
        bars = _waterfall(alternative, shown, found, commands, scale.factor, place)
        panels.append(Panel(alternative, scale.label, "", [bars]))
        sentences.append(_sentence(alternative, names, found, scale.factor, scale.unit))
    text = f"{'; '.join(sentences)}{results.one_seed}. {BARS_SENTENCE}{error_bars(results)}."
    yield Figure("ladder", "Mismatch ladder", text, panels, same_x=True)
    yield _table(results, heights.tolist(), names)


def _waterfall(
    label: str, names: list[str], found: list[Interval], commands: list[str], factor: float, color: int
) -> Bars:
    value = factor * np.array([f.value for f in found])
    start = np.concatenate([[0.0], np.nan_to_num(value[:-1])])
    low, high = factor * np.array([f.low for f in found]), factor * np.array([f.high for f in found])
    return Bars(label, names, start, np.nan_to_num(value) - start, low, high, commands, color)


def _sentence(alternative: str, names: list[str], found: list[Interval], factor: float, unit: str) -> str:
    values = np.array([f.value for f in found])
    steps = np.diff(values)
    first, last = number(values[0] * factor), number(values[-1] * factor)
    text = f"{alternative}: from {first} {unit} on '{names[0]}' to {last} {unit} on '{names[-1]}'"
    if not np.isfinite(steps).any():
        return text
    most = int(np.nanargmax(np.abs(steps)))
    return f"{text}, the largest step {number(steps[most] * factor)} {unit} by '{names[most + 1]}'"


def _table(results: Results, heights: list[float], names: list[str]) -> Table:
    columns = [m for m in dict.fromkeys((results.study.score, *results.study.metrics)) if m in results]
    rows = []
    for alternative in results.alternatives:
        mine = results.of(alternative)
        for h, name in zip(heights, names, strict=True):
            rung = mine.where(mine["height"] == h)
            cells = [interval(mean_interval(rung.metric(m)), metric(m).factor, metric(m).unit) for m in columns]
            rows.append([alternative, name, f"{int(rung.failed.sum())} of {len(rung)}", *cells])
    header = ["", "rung", "failed", *(metric(m).name for m in columns)]
    means = "Means over the seeds with 95 % intervals" if results.seeds > 1 else "One seed"
    return Table("Ladder in numbers", f"{means}, of the flights that completed.", header, rows)
