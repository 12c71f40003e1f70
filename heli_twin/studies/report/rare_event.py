"""How often a rare event happens, and the least change from nominal that brings it about."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from heli_twin.reporting.figure import Array, Curve, Figure, Panel, Table
from heli_twin.reporting.intervals import wilson
from heli_twin.reporting.words import metric, number, percent
from heli_twin.studies.columns import SCORED, excess
from heli_twin.studies.designs.rare_event import RareEvent, estimate_of
from heli_twin.studies.least_failure import Change, length
from heli_twin.studies.report.results import INDEPENDENT_SENTENCE, Results
from heli_twin.studies.report.search import place_of
from heli_twin.studies.subset_simulation import Estimate
from heli_twin.studies.worst import command_of

HEADER = ("", "probability", "95 % interval", "flights", "levels", "worst of the search", "worst of the random flights")
LEAST_HEADER = ("", "least change that fails", "what happens", "as far in random directions", "see it")
ALONE: dict[Change, str] = {"noise": "noise alone", "axes": "axes alone"}


class Least(NamedTuple):
    """The least change from nominal that fails."""

    noise: float
    """Share of the usual noise."""
    axes: float
    """Standard deviations from the middle of the scatter."""
    row: int
    """Of the results of its alternative."""


class Found(NamedTuple):
    """What a search found about one alternative."""

    alternative: str
    estimate: Estimate | None
    """None if it is not finished."""
    flights: Results
    least: dict[Change, Least]
    """By what was changed: all, noise alone, axes alone."""
    random: Array
    """Scores of flights as far from nominal as the least failure, in random directions."""


def searches(results: Results) -> list[Found]:
    """What the searches of a rare event found; none if the study has another design."""
    design = results.study.design
    return [_found(results, name, design) for name in results.alternatives] if isinstance(design, RareEvent) else []


def rare_event(results: Results) -> Iterator[Figure | Table]:
    """The probability of each alternative, how often each score is exceeded, and the least failures."""
    found, design = searches(results), results.study.design
    if not found or not isinstance(design, RareEvent):
        return
    scale = metric(results.study.score)
    limit = f"{number(design.limit * scale.factor)} {scale.unit}".strip()
    text = (
        f"A flight has failed if {_failure(results, limit)}, or if it crashes. Subset simulation over all noise"
        f"{' and the axes' if results.axes else ''}, {design.samples} flights a level; the first level is plain random"
        " flights. The probability is that of one flight, in its 95 % interval in 95 of 100 studies."
        f"{f' {INDEPENDENT_SENTENCE}' if len(results.axes) > 1 else ''}"
    )
    yield Table("How often", text, HEADER, [(each.alternative, *_cells(each, results)) for each in found])
    panels = [
        _panel(place, each, results, design.limit) for place, each in enumerate(found) if each.estimate is not None
    ]
    if panels:
        text = f"The probability of every score, from all levels; the dashed line is the limit, {limit}."
        yield Figure("rare-event", "How often is more", text, panels)
    rows = [row for each in found for row in _least_rows(each, results)]
    if rows:
        noise = (
            "Near the most likely failure: the mean of all failures, turned to where the score grows most and scaled"
            " until it just fails. It is an upper limit: a smaller change may fail. Nominal is no noise and the middle"
            " of every axis; usual noise is 1."
            " If as large a change in a random direction seldom fails, its direction matters and not its size."
        )
        yield Table("The least change that fails", noise, LEAST_HEADER, rows, codes=(4,))


def _failure(results: Results, limit: str) -> str:
    """Say what a failure is: a broken requirement by its formula, else a score above the limit."""
    score, design = results.study.score, results.study.design
    broken = [each for each in results.study.required if excess(each.name) == score]
    if broken and isinstance(design, RareEvent) and design.limit == 0.0:
        return f"it breaks requirement {broken[0].name}, `{broken[0].formula}`"
    return f"its {metric(score).name} exceeds {limit}"


def told_rare_event(results: Results) -> Iterator[str]:
    """The same in a few lines for a terminal."""
    for each in searches(results):
        name = f"{each.alternative}: " if len(results.alternatives) > 1 else ""
        if each.estimate is None:
            yield f"{name}not finished"
            continue
        chance, interval, flights, *_ = _cells(each, results)
        yield f"{name}probability {chance}, 95 % interval {interval}, {flights} flights"
        for what, change, happens, random, command in _least_rows(each, results):
            against = f"; as far in random directions {random}" if random else ""
            what = "least change that fails" if what == each.alternative else what.removeprefix(f"{each.alternative}, ")
            yield f"  {what}: {', '.join(filter(None, (change, happens)))}{against}"
            if command:
                yield f"    {command}"


def _found(results: Results, alternative: str, design: RareEvent) -> Found:
    mine = results.of(alternative)
    change = _changes(mine)
    searched = mine.where(change == "search")
    scores = _scores(searched)[np.argsort(searched["state"])]
    estimate = estimate_of(design, len(results.axes), results.study.seed, scores.tolist())
    least = _least(mine, change, design) if estimate is not None and estimate.failures else {}
    return Found(alternative, estimate, mine, least, _scores(mine.where(change == "random")))


def _changes(mine: Results) -> Array:
    """What was changed in each flight, as `RareEvent` labels it."""
    if "change" in mine:
        return mine["change"].astype(str)
    # A study that an earlier version flew.
    return np.where(np.isnan(mine["factor"].astype(float)), "search", "all")


def _least(mine: Results, change: Array, design: RareEvent) -> dict[Change, Least]:
    failed = _scores(mine) >= design.limit
    axes, noise = (mine[f"{what}_size"].astype(float) for what in ("axes", "noise"))
    least: dict[Change, Least] = {}
    for name in ("all", *ALONE):
        rows = np.flatnonzero((change == name) & failed & np.isfinite(axes))
        if len(rows):
            best = int(min(rows, key=lambda row: length(axes[row], noise[row], len(mine.axes))))
            least[name] = Least(float(noise[best]), float(axes[best]), best)
    return least


def _scores(rows: Results) -> Array:
    """Scores; infinite for a crash."""
    score = rows[rows.study.score].astype(float)
    flew = np.isin(rows["outcome"].astype(str), SCORED)
    return np.where(~flew | np.isnan(score), np.inf, score)


def _cells(each: Found, results: Results) -> tuple[str, ...]:
    found, design = each.estimate, results.study.design
    if found is None or not isinstance(design, RareEvent):
        return ("not finished", "", str(len(each.flights)), "", "", "")
    chance = f"{found.probability:.2g}" if found.failures else f"below {found.high:.2g}"
    interval = f"{found.low:.2g} to {found.high:.2g}"
    first, every = found.levels[0].scores, np.concatenate([level.scores for level in found.levels])
    worst = (_score(float(every.max()), results), f"{_score(float(first.max()), results)}, of {len(first)} flights")
    return (chance, interval, str(found.evaluations), str(len(found.levels)), *worst)


def _score(value: float, results: Results) -> str:
    scale = metric(results.study.score)
    return f"{number(value * scale.factor)} {scale.unit}".rstrip() if np.isfinite(value) else "a crash"


def _least_rows(each: Found, results: Results) -> Iterator[tuple[str, ...]]:
    """A row for each kind of change that fails, of all first."""
    design = results.study.design
    for change, least in each.least.items():
        told = [f"{least.noise:.2f} of usual noise"] * (change != "axes")
        if results.axes and change != "noise":
            told.append(f"{least.axes:.1f} standard deviations: {place_of(each.flights, least.row)}")
        happens = str(each.flights["outcome_text"][least.row] or "") or _happens(each, least.row, results)
        random = ""
        if change == "all" and isinstance(design, RareEvent) and len(each.random):
            fail = int((each.random >= design.limit).sum())
            rate = percent(wilson(fail, len(each.random)))
            random = f"{fail} of {len(each.random)} fail, {rate}; worst {_score(float(each.random.max()), results)}"
        name = f"{each.alternative}, {ALONE[change]}" if change in ALONE else each.alternative
        run_id = str(each.flights["id"][least.row])
        yield (name, ", ".join(told), happens, random, command_of(results.folder, run_id))
    for change, name in ALONE.items():
        if results.axes and each.least and change not in each.least:
            yield (f"{each.alternative}, {name}", "none found", "", "", "")


def _happens(each: Found, row: int, results: Results) -> str:
    scale = metric(results.study.score)
    return f"{scale.name} {_score(float(_scores(each.flights)[row]), results)}"


def _panel(place: int, each: Found, results: Results, limit: float) -> Panel:
    assert each.estimate is not None
    scale = metric(results.study.score)
    x, y = _exceedance(each.estimate)
    curve = Curve(each.alternative, x * scale.factor, y, style="steps", color=place)
    ends = np.array([y[y > 0.0].min(), 1.0])
    line = Curve("limit", np.full(2, limit * scale.factor), ends, style="dashes", color=7)
    return Panel(each.alternative, scale.label, "probability that it is exceeded", [curve, line], y_log=True)


def _exceedance(found: Estimate) -> tuple[Array, Array]:
    """Scores in increasing order, and the probability of more, from all levels."""
    scores, chances, above = [], [], 1.0
    for level in found.levels:
        ordered = np.sort(level.scores)
        share = 1.0 - np.arange(len(ordered)) / len(ordered)
        # The next level tells the rest better.
        kept = np.isfinite(ordered) & ((ordered < level.threshold) | (level is found.levels[-1]))
        scores.append(ordered[kept])
        chances.append(above * share[kept])
        above *= level.share
    return np.concatenate(scores), np.concatenate(chances)
