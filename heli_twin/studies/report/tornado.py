"""A tornado plot: the effect of each axis by itself on the score."""

from collections.abc import Iterator

import numpy as np

from heli_twin.reporting.figure import BARS_SENTENCE, Bars, Figure, Panel
from heli_twin.reporting.intervals import mean_interval
from heli_twin.reporting.words import field, metric, number
from heli_twin.studies.report.results import Results, error_bars


def tornado(results: Results) -> Iterator[Figure]:
    """The score at each value of each axis, from the score of the base; the widest on top."""
    if "varied" not in results:
        return
    scale = metric(results.study.score)
    panels, sentences = [], []
    for place, alternative in enumerate(results.alternatives):
        mine = results.of(alternative)
        base = mine.where(mine["level"] != mine["level"])
        center = float(base.penalised.mean())
        swings = sorted(
            ((_swing(mine, path, center), path) for path in results.axes), key=lambda swing: -np.abs(swing[0]).max()
        )
        panels.append(Panel(alternative, f"{scale.label} (failures penalised)", "", _bars(mine, swings, base, place)))
        widest, path = swings[0]
        low, high, middle = (number(value * scale.factor) for value in (widest.min(), widest.max(), center))
        sentences.append(f"{alternative}: {path} matters most, {low} to {high} {scale.unit} on the base's {middle}")
    text = f"{'; '.join(sentences)}{results.one_seed}. {BARS_SENTENCE}{error_bars(results)}."
    yield Figure("tornado", "One at a time", text, panels, same_x=True)


def _swing(mine: Results, path: str, center: float) -> np.ndarray:
    rows = mine.where(mine["varied"] == path)
    levels = np.unique(rows["level"])
    return np.array([rows.where(rows["level"] == level).penalised.mean() - center for level in levels])


def _bars(mine: Results, swings: list[tuple[np.ndarray, str]], base: Results, place: int) -> list[Bars]:
    factor = metric(mine.study.score).factor
    center = float(base.penalised.mean())
    names, start, length, low, high, commands = [], [], [], [], [], []
    for _, path in swings:
        rows = mine.where(mine["varied"] == path)
        for level in np.unique(rows["level"]):
            at = rows.where(rows["level"] == level)
            seeds, order = np.intersect1d(at["seed"], base["seed"], return_indices=True)[1:]
            change = mean_interval(at.penalised[seeds] - base.penalised[order])
            names.append(f"{path} = {_level(at, path)}")
            start.append(center * factor)
            length.append(change.value * factor)
            low.append((center + change.low) * factor)
            high.append((center + change.high) * factor)
            commands.append(at.command(int(np.argmax(at.penalised))))
    ends = np.array(low), np.array(high)
    return [Bars("", names, np.array(start), np.array(length), *ends, commands=commands, color=place)]


def _level(rows: Results, path: str) -> str:
    value = rows[path][0]
    if not rows.is_number(path):
        return str(value)
    scale = field(path, [value])
    return f"{number(value * scale.factor, 4)} {scale.unit}".rstrip()
