"""The first table of a report: errors and failure rates of the alternatives, and their paired differences."""

from collections import Counter
from collections.abc import Iterator

import numpy as np

from heli_twin.reporting.figure import Array, Table
from heli_twin.reporting.intervals import Interval, failure_interval, seed_interval
from heli_twin.reporting.words import interval, listed, metric, percent
from heli_twin.studies.columns import LANDED_EARLY
from heli_twin.studies.designs.rare_event import RareEvent
from heli_twin.studies.report.results import Results


def verdict(results: Results) -> Iterator[Table]:
    """Each alternative and metric, and the paired difference from the first alternative."""
    if isinstance(results.study.design, RareEvent):
        # Its flights are no fair sample: most are from the tail.
        return
    names = results.alternatives
    header = ["", *names]
    if len(names) > 1:
        header += [f"{name} minus {names[0]}, paired" for name in names[1:]]
    rows = [*_failures(results, names)]
    score = metric(results.study.score)
    penalised = _cells(results, names, results.penalised, score.factor, score.unit)
    rows.append(
        [
            f"score: {score.name}, a flight that did not complete counts {results.study.penalty * score.factor:g}"
            f" {score.unit}",
            *penalised,
        ]
    )
    for name in dict.fromkeys((results.study.score, *results.study.metrics)):
        scale = metric(name)
        values = results.metric(name)
        if np.isfinite(values).any():
            rows.append(
                [f"{scale.name} of completed flights", *_cells(results, names, values, scale.factor, scale.unit)]
            )
    left_out = f"; {results.invalid:,} invalid runs are left out, since the process of their control law failed:"
    left_out += " the same `heli-twin study run` flies them again, and then the figures of the design are here"
    sentence = f"{len(results):,} flights; {_claim(results, names)}{left_out if results.invalid else ''}."
    yield Table("Verdict", sentence, header, rows)


def _failures(results: Results, names: list[str]) -> Iterator[list[str]]:
    """The shares of flights that failed and, if there are any, of emergency landings, which are no failures."""
    cells: list[str] = []
    landings: list[str] = []
    for name in names:
        mine = results.of(name)
        landed = mine["outcome"] == LANDED_EARLY
        reasons = Counter(mine["outcome"][mine.failed & ~landed].tolist())
        why = ", ".join(f"{count} {reason}" for reason, count in reasons.most_common())
        cells.append(percent(failure_interval(mine.failed & ~landed, mine["seed"])) + (f" ({why})" if why else ""))
        landings.append(percent(failure_interval(landed, mine["seed"])))
    blank = [""] * (len(names) - 1)
    yield ["failed flights", *cells, *blank]
    if (results["outcome"] == LANDED_EARLY).any():
        yield ["emergency landings", *landings, *blank]


def _cells(results: Results, names: list[str], values: Array, factor: float, unit: str) -> list[str]:
    alone = [interval(_alone(results, values, name), factor, unit) for name in names]
    return alone + [interval(_difference(results, values, name, names[0]), factor, unit) for name in names[1:]]


def _alone(results: Results, values: Array, name: str) -> Interval:
    mine = results["alternative"] == name
    return seed_interval(values[mine], results["seed"][mine])


def _claim(results: Results, names: list[str]) -> str:
    """Say which alternatives are better or worse than the first, by the score of completed flights."""
    if len(names) == 1:
        return "one alternative, so nothing to compare"
    if results.seeds == 1:
        return "one seed: the differences may be chance, so nobody is called better; `replicates` gives more seeds"
    found = {name: _difference(results, results.metric(results.study.score), name, names[0]) for name in names[1:]}
    sides = {
        "better": [name for name, difference in found.items() if difference.high < 0],
        "worse": [name for name, difference in found.items() if difference.low > 0],
    }
    words = [f"{listed(some)} {'is' if len(some) == 1 else 'are'} {side}" for side, some in sides.items() if some]
    by = f"by the {metric(results.study.score).name} of completed flights"
    return f"{by} {' and '.join(words)} than {names[0]}" if words else f"{by} none differs from {names[0]}"


def _difference(results: Results, values: Array, name: str, other: str) -> Interval:
    """Mean difference of the pairs of flights with the same point and seed that both completed, over the seeds."""
    key = results["point"] * 2.0**26 + results["replicate"]
    mine, theirs = (np.flatnonzero(results["alternative"] == either) for either in (name, other))
    _, a, b = np.intersect1d(key[mine], key[theirs], assume_unique=False, return_indices=True)
    return seed_interval(values[mine[a]] - values[theirs[b]], results["seed"][mine[a]])
