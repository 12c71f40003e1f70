"""Errors over the axes: curves along one, maps over two, clouds over many."""

import warnings
from collections import Counter
from collections.abc import Iterator
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heli_twin.reporting.figure import CONTOUR_RATE, Array, Curve, Dots, Figure, Heat, Panel, decades
from heli_twin.reporting.intervals import grouped_mean, grouped_percent
from heli_twin.reporting.words import LARGER_IS_BETTER, field, listed, metric, number
from heli_twin.studies.report.results import INDEPENDENT_SENTENCE, Results

MAX_CLOUD_POINTS = 3000
"""Points drawn at most; of more flights every n-th is drawn."""


def maps(results: Results) -> Iterator[Figure]:
    """Yield the figures that fit the study's design and axes."""
    kind = results.study.design.kind
    if not results.axes or kind in ("ladder", "one_at_a_time", "margin", "boundary", "morris", "rare_event"):
        return
    numbers = [path for path in results.axes if results.is_number(path)]
    if kind == "grid" and len(numbers) >= 2:
        yield from _maps(results, numbers[0], numbers[1])
    elif kind == "grid" or not numbers:
        yield _sweep(results, numbers[0] if numbers else results.axes[0])
    else:
        yield _clouds(results, numbers)


def _sweep(results: Results, path: str) -> Figure:
    """Every metric along one axis, alternatives and the other axes' values as curves; rows of dots for names."""
    series = _series(results, [p for p in results.axes if p != path])
    values, place = _places(results, path)
    chosen = [m for m in dict.fromkeys((results.study.score, *results.study.metrics)) if m in results]
    shown = {name: (metric(name), results.metric(name)) for name in chosen}
    panels = [
        _along(results, path, values, place, series, what.name, what.label, what.factor * column)
        for what, column in shown.values()
    ]
    if results.failed.any():
        panels.append(_along(results, path, values, place, series, "failed flights", "%", results.failed))
    title = f"Along {path}"
    return Figure(f"along-{_slug(path)}", title, _sweep_sentence(results, path, values, place, series, chosen), panels)


def _places(results: Results, path: str) -> tuple[NDArray[Any], NDArray[np.int64]]:
    """The values of an axis, numbers in their order and names in the study's, and where each row is among them."""
    if results.is_number(path):
        return np.unique(results[path], return_inverse=True)
    names, first, place = np.unique(results[path].astype(str), return_index=True, return_inverse=True)
    order = np.argsort(first)
    return np.array(_short(names[order].tolist())), np.argsort(order)[place]


def _short(names: list[str]) -> list[str]:
    """Specs such as `circle radius=0.5 rate=1.0` by their kinds, where those tell them apart."""
    kinds = [name.partition(" ")[0] for name in names]
    return kinds if any("=" in name for name in names) and len(set(kinds)) == len(names) else names


def _along(
    results: Results,
    path: str,
    values: NDArray[Any],
    place: NDArray[np.int64],
    series: dict[str, NDArray[np.bool_]],
    title: str,
    label: str,
    column: Array | NDArray[np.bool_],
) -> Panel:
    """Return the panel of one quantity, in its shown unit, along an axis; of true and false the share in %."""
    marks: list[Curve | Dots] = []
    numbers = results.is_number(path)
    scale = field(path, values.tolist() if numbers else [])
    for number_, (name, mask) in enumerate(series.items()):
        if column.dtype == np.bool_:
            mean = grouped_percent(place[mask], column[mask].astype(np.bool_), len(values))
        else:
            mean = grouped_mean(place[mask], column[mask].astype(np.float64), len(values))
        commands = _worst_of(results.where(mask), place[mask], len(values))
        band = (mean.low, mean.high) if (mean.n > 1).any() else (None, None)
        if numbers:
            x = values * scale.factor
            marks.append(Curve(name, x, mean.mean, *band, commands=commands, color=number_))
        else:
            low, high = (mean.mean if side is None else side for side in band)
            marks.append(Dots(name, values.tolist(), mean.mean, low, high, commands=commands, color=number_))
    if numbers:
        return Panel(title, scale.label, label, marks, x_log=decades(values))
    return Panel(title, label, "", marks)


def _series(results: Results, rest: list[str]) -> dict[str, NDArray[np.bool_]]:
    """A name for each alternative with each combination of the other axes, and its rows."""
    labels = results["alternative"].astype(object)
    for path in rest:
        values, place = _places(results, path)
        names = [f"{v:g}" if results.is_number(path) else str(v) for v in values]
        labels = labels + f", {path} " + np.array(names, object)[place]
    names, first = np.unique(labels.astype(str), return_index=True)
    return {str(names[i]): labels == names[i] for i in np.argsort(first)}


def _sweep_sentence(
    results: Results,
    path: str,
    values: NDArray[Any],
    place: NDArray[Any],
    series: dict[str, NDArray[Any]],
    chosen: list[str],
) -> str:
    """Say which alternative is best at which values, and how many flights failed."""
    facts = []
    scale = field(path, values.tolist()) if results.is_number(path) else None
    shown = [f"{number(value * scale.factor)} {scale.unit}".rstrip() if scale else str(value) for value in values]
    for name in chosen[:5]:
        what = metric(name)
        if len(series) > 1:
            smaller_is_better = results.metric(name) * (-1.0 if name in LARGER_IS_BETTER else 1.0)
            leaders = _leaders(results, smaller_is_better, place, len(values), series)
            facts.append(f"{what.name}: {_told(leaders, shown, list(series))}")
        else:
            mean = what.factor * grouped_mean(place, results.metric(name), len(values)).mean
            facts.append(f"{what.name} {number(mean[0])} {what.unit} at {shown[0]}, {number(mean[-1])} at {shown[-1]}")
    return f"{'; '.join(facts)}; {int(results.failed.sum()):,} of {len(results):,} flights failed{results.one_seed}."


def _leaders(
    results: Results, metric_: Array, place: NDArray[Any], groups: int, series: dict[str, NDArray[Any]]
) -> list[tuple[str, ...]]:
    """At each value, the best and those that the shared seeds cannot tell from it."""
    scores = {name: _by_seed(results.where(mask), metric_[mask], place[mask], groups) for name, mask in series.items()}
    found = []
    for i in range(groups):
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            means = {name: np.nanmean(score[i]) for name, score in scores.items()}
        there = [name for name, mean in means.items() if np.isfinite(mean)]
        if not there:
            found.append(())
            continue
        best = min(there, key=means.__getitem__)
        found.append(tuple(n for n in there if n == best or not _worse(scores[n][i] - scores[best][i])))
    return found


def _by_seed(rows: Results, values: Array, place: NDArray[Any], groups: int) -> Array:
    """(groups, replicates) of values; NaN where there is none."""
    table = np.full((groups, rows.study.replicates), np.nan)
    replicate = np.clip(rows["replicate"].astype(np.int64), 0, rows.study.replicates - 1)
    table[place, replicate] = values
    return table


def _worse(differences: Array) -> bool:
    """Return whether the interval of paired differences is above zero; a single difference counts by its sign."""
    mean = grouped_mean(np.zeros(len(differences), np.int64), differences, 1)
    return bool(mean.low[0] > 0 if mean.n[0] > 1 else mean.mean[0] > 0)


def _told(leaders: list[tuple[str, ...]], shown: list[str], names: list[str]) -> str:
    """`a best up to 1, b from 2 to 3, a beyond`."""
    runs = [(key, [i for i, _ in group]) for key, group in groupby(enumerate(leaders), key=lambda item: item[1])]
    if len(runs) == 1:
        return "no difference" if set(runs[0][0]) == set(names) else f"{_best(runs[0][0], names)} throughout"
    if len(runs) > 4:
        counts = Counter(leaders).most_common(2)
        return ", ".join(f"{_best(key, names)} at {count} of {len(leaders)} values" for key, count in counts)
    words = []
    for key, where in runs:
        span = shown[where[0]] if len(where) == 1 else f"{shown[where[0]]} to {shown[where[-1]]}"
        words.append(f"{_best(key, names)} at {span}")
    return ", ".join(words)


def _best(key: tuple[str, ...], names: list[str]) -> str:
    if not key:
        return "nobody completes"
    if set(key) == set(names):
        return "no difference"
    return f"{listed(list(key))} best"


def _maps(results: Results, across: str, up: str) -> Iterator[Figure]:
    """The score over two axes for each alternative, and the difference from the first."""
    shown = metric(results.study.score)
    xs, ix = np.unique(results[across], return_inverse=True)
    ys, iy = np.unique(results[up], return_inverse=True)
    cell, shape = iy * len(xs) + ix, (len(ys), len(xs))
    x_scale, y_scale = field(across, xs.tolist()), field(up, ys.tolist())
    found = {}
    for name in results.alternatives:
        mask = results["alternative"] == name
        mine = results.where(mask)
        mean = grouped_mean(cell[mask], mine.metric(results.study.score), len(xs) * len(ys)).mean.reshape(shape)
        failure = grouped_mean(cell[mask], mine.failed.astype(float), len(xs) * len(ys)).mean.reshape(shape)
        commands = np.array(_worst_of(mine, cell[mask], len(xs) * len(ys)), object).reshape(shape).tolist()
        found[name] = (shown.factor * mean, failure, commands)
    every = np.concatenate([mean.ravel() for mean, _, _ in found.values()])
    limits = tuple(np.nanpercentile(every, [0, 98]).tolist()) if np.isfinite(every).any() else None
    place = (x_scale.factor * xs, y_scale.factor * ys)
    logs = (decades(xs), decades(ys))
    panels = [
        Panel(
            name,
            x_scale.label,
            y_scale.label,
            [Heat(*place, mean, shown.unit, failure, False, limits, commands)],
            *logs,
        )
        for name, (mean, failure, commands) in found.items()
    ]
    first, *others = found
    for name in others:
        difference = found[name][0] - found[first][0]
        panels.append(
            Panel(
                f"{name} minus {first}",
                x_scale.label,
                y_scale.label,
                [Heat(*place, difference, shown.unit, diverging=True)],
                *logs,
            )
        )
    rest = [p for p in results.axes if p not in (across, up)]
    also = f", averaged over {listed(rest)}" if rest else ""
    yield Figure(f"map-{_slug(across)}-{_slug(up)}", f"{across} and {up}", _map_sentence(results, found, also), panels)


def _map_sentence(results: Results, found: dict[str, Any], also: str) -> str:
    shown = metric(results.study.score)
    facts = []
    for name, (mean, failure, _) in found.items():
        lost = 100 * float((failure >= CONTOUR_RATE).mean())
        kept = mean[np.isfinite(mean) & (failure < CONTOUR_RATE)]
        span = (
            f", elsewhere its {shown.name} is {number(kept.min())} to {number(kept.max())} {shown.unit}"
            if len(kept)
            else ""
        )
        facts.append(f"{name} fails in half of its flights or more on {lost:.0f} % of the map{span}")
    return "; ".join(facts) + f" (black line: half of the flights fail; white: all of them{also}){results.one_seed}."


def _clouds(results: Results, paths: list[str]) -> Figure:
    """The score against each axis, every flight a point."""
    shown = metric(results.study.score)
    kept = results.where(np.arange(len(results)) % max(1, -(-len(results) // MAX_CLOUD_POINTS)) == 0)
    panels = []
    for path in paths:
        scale = field(path, results[path].tolist())
        clouds = []
        for number_, name in enumerate(results.alternatives):
            mine = kept.of(name)
            commands = [mine.command(i) for i in range(len(mine))]
            x, y = mine[path] * scale.factor, mine.penalised * shown.factor
            clouds.append(Curve(name, x, y, style="points", commands=commands, color=number_))
        panels.append(Panel(path, scale.label, shown.label, clouds, y_log=decades(kept.penalised)))
    rates = [f"{name} fails in {int(results.of(name).failed.sum())}" for name in results.alternatives]
    sentence = (
        f"Every flight a point, a failed one at the penalty of {results.study.penalty * shown.factor:g} {shown.unit}: "
    )
    drawn = results.study.design.kind == "latin_hypercube" and len(results.axes) > 1
    text = f"{sentence}{listed(rates)} of {len(results):,} flights.{f' {INDEPENDENT_SENTENCE}' if drawn else ''}"
    return Figure("clouds", "Over all axes", text, panels)


def _worst_of(rows: Results, group: NDArray[np.int64], groups: int) -> list[str]:
    """For each group, the command of its worst flight."""
    order = np.lexsort((rows.penalised, group))
    last = np.flatnonzero(np.diff(np.append(group[order], -1)))
    commands = [""] * groups
    for i in order[last]:
        commands[group[i]] = rows.command(int(i))
    return commands


def _slug(path: str) -> str:
    return path.replace(".", "-").replace("_", "-")
