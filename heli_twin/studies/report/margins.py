"""Stability margins: the greatest acceptable value of each axis."""

from collections.abc import Iterator

import numpy as np

from heli_twin.reporting.figure import Array, Dots, Figure, Panel, Table
from heli_twin.reporting.intervals import median_interval
from heli_twin.reporting.words import Scale, few_seeds, field, metric, number
from heli_twin.studies.axes import Axis, axis_of
from heli_twin.studies.designs.margin import Margin, bracket
from heli_twin.studies.report.results import Results


def margins(results: Results) -> Iterator[Figure | Table]:
    """The margin of each axis by each criterion and alternative: median over the seeds with its interval."""
    design = results.study.design
    if not isinstance(design, Margin):
        return
    rows, panels, sentences = [], [], []
    for path in results.study.axes:
        axis = axis_of(path, results.study.axes[path])
        scale = field(path, [axis.quantile(1.0)])
        dots = []
        for place, alternative in enumerate(results.alternatives):
            mine = results.of(alternative)
            mine = mine.where(mine["axis"] == path)
            found = {criterion: _margin(mine, axis, criterion, design) for criterion in design.criteria}
            texts = [_text(values, axis, scale) for values, _ in found.values()]
            dots.append(_dots(alternative, found, texts, axis, scale.factor)._replace(color=place))
            commands = [command for _, command in found.values()]
            for criterion, text, command in zip(found, texts, commands, strict=True):
                rows.append([path, alternative, _criterion(criterion, design), text, command])
            sentences.append(f"{alternative}: {path} {texts[0]} by its {metric(next(iter(found))).name}")
        panels.append(Panel(path, scale.label, "", dots))
    yield Figure("margins", "Margins", "How far each axis may go: " + "; ".join(sentences) + ".", panels)
    median = f"Median over {results.seeds} shared seeds" if results.seeds > 1 else "One seed"
    sentence = (
        f"{median}{' with its 95 % interval' if results.seeds > 5 else ''}, found by bisection; "
        "a value beyond the range is one that was never reached; the command flies the first flight beyond the margin."
    )
    yield Table("Margins in numbers", sentence, ["axis", "", "criterion", "margin", "beyond it"], rows, codes=(4,))


def _margin(mine: Results, axis: Axis, criterion: str, design: Margin) -> tuple[Array, str]:
    """The margin of each seed (inf: never reached, -inf: none at all), and a flight beyond it."""
    values, command = [], ""
    for seed in np.unique(mine["seed"]):
        rows = np.flatnonzero(mine["seed"] == seed)
        flown = [
            {"share": mine["share"][i], "outcome": mine["outcome"][i], criterion: _number(mine[criterion][i])}
            for i in rows
        ]
        low, high = bracket(flown, criterion, design.criteria)
        if high is not None and not command:
            command = mine.command(int(rows[np.argmin(np.abs(mine["share"][rows] - high))]))
        if low is None or high is None:
            values.append(np.inf if high is None else -np.inf)
        else:
            values.append(axis.quantile(0.5 * (low + high)))
    return np.array(values), command


def _number(value: float) -> float | None:
    return None if np.isnan(value) else float(value)


def _text(values: Array, axis: Axis, scale: Scale) -> str:
    """`31 [28, 34] ms`; `> 100 ms` where most seeds reach no limit."""
    ends = axis.quantile(0.0), axis.quantile(1.0)
    found = median_interval(np.clip(values, *ends))

    def told(value: float) -> str:
        beyond = "> " if value >= ends[1] and np.isposinf(values).any() else "< " if np.isneginf(values).any() else ""
        return (beyond if value in ends else "") + number(value * scale.factor)

    spread = f" [{told(found.low)}, {told(found.high)}]" if found.low < found.high else ""
    return f"{told(found.value)}{spread} {scale.unit}".rstrip() + few_seeds(found)


def _dots(label: str, found: dict[str, tuple[Array, str]], texts: list[str], axis: Axis, factor: float) -> Dots:
    """A margin beyond the range stands at its end."""
    ends = axis.quantile(0.0), axis.quantile(1.0)
    intervals = [median_interval(np.clip(values, *ends)) for values, _ in found.values()]
    middle, low, high = (factor * np.array([getattr(i, part) for i in intervals]) for part in ("value", "low", "high"))
    names = [metric(criterion).name for criterion in found]
    return Dots(label, names, middle, low, high, texts, [command for _, command in found.values()])


def _criterion(name: str, design: Margin) -> str:
    scale = metric(name)
    return f"{scale.name} \u2264 {number(design.criteria[name] * scale.factor)} {scale.unit}"
