"""The learned boundary: the probability that a point fails, as a map of two axes or slices of more."""

from collections.abc import Iterator, Mapping
from itertools import combinations
from typing import NamedTuple

import numpy as np

from heli_twin.reporting.figure import Curve, Figure, Heat, Panel, decades
from heli_twin.reporting.intervals import Interval
from heli_twin.reporting.words import field, listed, metric, number
from heli_twin.studies.axes import Axis, axis_of, share_of
from heli_twin.studies.designs.boundary import Boundary, places_and_scores, response
from heli_twin.studies.report.results import Results
from heli_twin.studies.space import value_at, varied
from heli_twin.studies.straddle import CANDIDATES_LOG2, Surrogate, fitted, share_above, spread_places

CELLS = 61
"""Along each axis of a map."""
SURE = (0.025, 0.975)
"""Probabilities of failing between which a place is uncertain."""


class Learned(NamedTuple):
    """What the flights of one alternative tell."""

    surrogate: Surrogate
    axes: Mapping[str, Axis]
    middle: list[float]
    """Where slices are taken, as shares of the axes."""


def boundary(results: Results) -> Iterator[Figure]:
    """Yield one figure for all alternatives over two axes; one for each alternative over more."""
    learned = _learned(results)
    if not learned:
        return
    key = _key(results)
    axes, middle = next(iter(learned.values()))[1:]
    facts = {name: f"{name} {_fact(each)}" for name, each in learned.items()}
    if len(axes) == 2:
        across, up = axes
        panels = [_map(name, each, across, up, results.of(name)) for name, each in learned.items()]
        yield Figure("boundary", "Boundary", f"{'; '.join(facts.values())}. {key}", panels)
        return
    where = listed([_told(path, axis.quantile(s)) for (path, axis), s in zip(axes.items(), middle, strict=True)])
    for place, (name, each) in enumerate(learned.items()):
        panels = [_map("", each, across, up) for across, up in combinations(axes, 2)]
        text = f"{facts[name]}. Slices through {where}. {key}"
        yield Figure(f"boundary-{place}", f"Boundary of {name}", text, panels)


def told_boundary(results: Results) -> Iterator[str]:
    """The same in a line for each alternative, for a terminal."""
    for name, each in _learned(results).items():
        yield f"{name} {_fact(each)}"


def _learned(results: Results) -> dict[str, Learned]:
    """What each alternative's flights tell; empty for another design."""
    design = results.study.design
    if not isinstance(design, Boundary) or results.invalid or len(results.axes) < 2:
        return {}
    axes = {path: axis_of(path, written) for path, written in results.study.axes.items() if path in results.axes}
    middle = _middle(results, axes)
    return {name: Learned(_surrogate(results.of(name), design, axes), axes, middle) for name in results.alternatives}


def _surrogate(mine: Results, design: Boundary, axes: Mapping[str, Axis]) -> Surrogate:
    """The function that the flights of one alternative tell."""
    score = mine.study.score
    columns = {name: mine[name].tolist() for name in ("outcome", "asked", score, *axes)}
    rows = [
        {name: value if value == value else None for name, value in zip(columns, row, strict=True)}
        for row in zip(*columns.values(), strict=True)
    ]
    places, scores = places_and_scores(rows, axes, score, mine.study.penalty)
    return fitted(places, response(scores, design.limit))


def _fact(learned: Learned) -> str:
    axes = len(learned.axes)
    share = share_above(learned.surrogate, axes)
    chance = learned.surrogate.above(spread_places(axes, CANDIDATES_LOG2, 0))
    open_ = float(np.mean((chance > SURE[0]) & (chance < SURE[1])))
    return f"fails on {_percent(share)} of the ranges, and on {100 * open_:.2g} % it is uncertain whether it does"


def _percent(share: Interval) -> str:
    return f"{100 * share.value:.3g} % [{100 * share.low:.3g}, {100 * share.high:.3g}]"


def _key(results: Results) -> str:
    design = results.study.design
    assert isinstance(design, Boundary)
    scale = metric(results.study.score)
    limit = f"{number(design.limit * scale.factor)} {scale.unit}".strip()
    half = "" if results.seeds == 1 else " in half of the flights"
    return (
        f"Failing is a {scale.name} above {limit}{half}, or a crash. The colour is the probability of it, told by a"
        f" Gaussian process from {design.points} points; black: as likely as not; dashed: 2.5 % and 97.5 %"
        f"{_seed(results)}."
    )


def _seed(results: Results) -> str:
    return "" if results.seeds > 1 else " (one seed, so a further flight may differ)"


def _middle(results: Results, axes: Mapping[str, Axis]) -> list[float]:
    """The place of the base experiment, as shares of the axes; the middle of a range that the base is not in."""
    tree = varied(results.about["base"], {})
    shares = []
    for path, axis in axes.items():
        base = value_at(tree, path)
        low, high = sorted((axis.quantile(0.0), axis.quantile(1.0)))
        inside = isinstance(base, int | float) and low <= base <= high
        shares.append(share_of(axis, base) if inside else 0.5)
    return shares


def _told(path: str, value: float) -> str:
    scale = field(path, [value])
    return f"{path} {number(value * scale.factor)} {scale.unit}".rstrip()


def _map(title: str, learned: Learned, across: str, up: str, flown: Results | None = None) -> Panel:
    """The probability of failing over two axes, the others at their middle, with flights on it."""
    surrogate, axes, middle = learned
    names, shares = list(axes), np.linspace(0.0, 1.0, CELLS)
    places = np.tile(middle, (CELLS * CELLS, 1))
    places[:, names.index(across)] = np.tile(shares, CELLS)
    places[:, names.index(up)] = np.repeat(shares, CELLS)
    chance = surrogate.above(places).reshape(CELLS, CELLS)
    x, y = (np.array([axes[path].quantile(share) for share in shares]) for path in (across, up))
    x_scale, y_scale = field(across, x.tolist()), field(up, y.tolist())
    flip = (slice(None, None, -1 if y[0] > y[-1] else 1), slice(None, None, -1 if x[0] > x[-1] else 1))
    x, y, chance = x[flip[1]] * x_scale.factor, y[flip[0]] * y_scale.factor, chance[flip]
    heat = Heat(x, y, 100.0 * chance, "% fail", chance, limits=(0.0, 100.0), dashed=SURE)
    marks = [heat] if flown is None else [heat, *_points(flown, across, up, x_scale.factor, y_scale.factor)]
    return Panel(title, x_scale.label, y_scale.label, marks, decades(x), decades(y))


def _points(flown: Results, across: str, up: str, x_factor: float, y_factor: float) -> Iterator[Curve]:
    """The flights, those that failed in another colour."""
    design = flown.study.design
    assert isinstance(design, Boundary)
    above = flown.penalised > design.limit
    for label, mask, color in (("kept the limit", ~above, 5), ("failed", above, 1)):
        mine = flown.where(mask)
        commands = [mine.command(i) for i in range(len(mine))]
        x, y = mine[across].astype(float) * x_factor, mine[up].astype(float) * y_factor
        if len(mine):
            yield Curve(label, x, y, style="points", commands=commands, color=color)
