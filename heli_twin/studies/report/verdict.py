"""Who is better, and how often does it fail: the table that a report begins with."""

from collections import Counter
from collections.abc import Iterator

import numpy as np

from heli_twin.studies.inference import Interval, mean_interval, paired_interval, wilson
from heli_twin.studies.report.figure import Array, Table
from heli_twin.studies.report.results import Results
from heli_twin.studies.report.words import interval, listed, metric, percent


def verdict(results: Results) -> Iterator[Table]:
    """Each alternative and metric, and the paired difference from the first alternative."""
    names = results.alternatives
    header = ["", *names]
    if len(names) > 1:
        header += [f"{name} minus {names[0]}, paired" for name in names[1:]]
    rows = [_failures(results, names)]
    claims: list[str] = []
    score = metric(results.study.score)
    penalised = _cells(results, names, results.penalised, score.factor, score.unit)
    rows.append([f"score: {score.name}, a failure counts {results.study.penalty * score.factor:g} {score.unit}", *penalised])
    for name in dict.fromkeys((results.study.score, *results.study.metrics)):
        scale = metric(name)
        values = results.metric(name)
        if np.isfinite(values).any():
            rows.append([f"{scale.name} of completed flights", *_cells(results, names, values, scale.factor, scale.unit)])
            claims += _claims(results, names, values, scale.name)
    sentence = f"{len(results):,} flights; " + ("; ".join(claims[:4]) or "one setting, so nothing to compare") + "."
    yield Table("Verdict", sentence, header, rows)


def _failures(results: Results, names: list[str]) -> list[str]:
    cells = []
    for name in names:
        mine = results.of(name)
        reasons = Counter(mine["outcome"][mine.failed].tolist())
        why = ", ".join(f"{count} {reason}" for reason, count in reasons.most_common())
        cells.append(percent(wilson(int(mine.failed.sum()), len(mine))) + (f" ({why})" if why else ""))
    return ["failed flights", *cells, *[""] * (len(names) - 1)]


def _cells(results: Results, names: list[str], values: Array, factor: float, unit: str) -> list[str]:
    alone = [interval(mean_interval(values[results["alternative"] == name]), factor, unit) for name in names]
    return alone + [interval(_difference(results, values, name, names[0]), factor, unit) for name in names[1:]]


def _claims(results: Results, names: list[str], values: Array, what: str) -> Iterator[str]:
    for name in names[1:]:
        found = _difference(results, values, name, names[0])
        if found.n > 1 and (found.low > 0 or found.high < 0):
            yield f"{what}: {name} {'worse' if found.low > 0 else 'better'} than {names[0]}"


def _difference(results: Results, values: Array, name: str, other: str) -> Interval:
    """Over the pairs of flights with the same point and seed that both completed."""
    a, b = paired(results, values, name, other)
    return paired_interval(a, b)


def paired(results: Results, values: Array, name: str, other: str) -> tuple[Array, Array]:
    """The values of two alternatives, side by side for the same point and seed."""
    key = results["point"] * 2.0**26 + results["replicate"]
    mine, theirs = results["alternative"] == name, results["alternative"] == other
    _, a, b = np.intersect1d(key[mine], key[theirs], assume_unique=False, return_indices=True)
    return values[mine][a], values[theirs][b]


def axes_sentence(results: Results) -> str:
    """What was varied."""
    return listed([*results.axes]) if results.axes else "nothing but the seed"
