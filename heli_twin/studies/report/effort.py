"""Stick effort against tracking error, and computing times."""

from collections.abc import Iterator

import numpy as np

from heli_twin.reporting.figure import Array, Curve, Figure, Panel, decades
from heli_twin.reporting.words import metric, number
from heli_twin.studies.designs.rare_event import RareEvent
from heli_twin.studies.report.results import TIMES, Results

MAX_EFFORT_POINTS = 2000
"""Points drawn at most; of more flights every n-th is drawn."""


def effort(results: Results) -> Iterator[Figure]:
    """Each completed flight by the work of its sticks and its error."""
    shown, scale = metric(results.study.score), metric("effort")
    if isinstance(results.study.design, RareEvent):
        # Its flights are no fair sample: most are from the tail.
        return
    errs = "errs" if "error" in shown.name else f"its {shown.name} is"
    clouds, facts = [], []
    for place, name in enumerate(results.alternatives):
        mine = results.of(name)
        mine = mine.where(~mine.failed & np.isfinite(mine["effort"].astype(float)))
        if not len(mine):
            continue
        work, error = (float(np.median(mine[column])) for column in ("effort", results.study.score))
        much = f"{number(error * shown.factor)} {shown.unit}"
        facts.append(f"{name} works its sticks {number(work, 2)} {scale.unit} and {errs} {much}")
        mine = mine.where(np.arange(len(mine)) % max(1, -(-len(mine) // MAX_EFFORT_POINTS)) == 0)
        commands = [mine.command(i) for i in range(len(mine))]
        x, y = mine["effort"], mine[results.study.score] * shown.factor
        clouds.append(Curve(name, x, y, style="points", commands=commands, color=place))
    if clouds:
        label = f"{scale.label} (variance of the four inputs, full stick is 1)"
        x_log, y_log = (decades(np.concatenate(values)) for values in ([c.x for c in clouds], [c.y for c in clouds]))
        panel = Panel("", label, shown.label, clouds, x_log, y_log)
        lost = int(results.failed.sum())
        tail = f"; {lost:,} failed flights are not shown" if lost else ""
        yield Figure("effort", "Effort against error", f"In the median, {'; '.join(facts)}{tail}.", [panel])


def timing(results: Results) -> Iterator[Figure]:
    """Distributions of the measured times of a flight, over all flights."""
    panels, facts = [], []
    for name in TIMES[:3]:
        curves = []
        for place, alternative in enumerate(results.alternatives):
            times = results.of(alternative)[name].astype(float)
            times = np.sort(times[np.isfinite(times) & (times > 0)])
            if len(times):
                curves.append(_distribution(alternative, times, place))
                if name.endswith("p99"):
                    facts.append(
                        f"{alternative} solves within {number(float(np.median(times)), 2)} ms in 99 % of its steps"
                    )
        if curves:
            panels.append(
                Panel(_title(name), "ms", "% of flights below", curves, decades(np.concatenate([c.x for c in curves])))
            )
    if panels:
        text = "; ".join(facts) + " (median over the flights, on the machines named below)."
        yield Figure("solve-times", "Solve times", text, panels)


def _distribution(label: str, times: Array, color: int) -> Curve:
    """The empirical distribution of sorted values: each is a step of 1/n; of many, every n-th is drawn."""
    share = 100 * np.arange(len(times) + 1) / len(times)
    kept = np.unique(np.linspace(0, len(times), min(len(times), MAX_STEPS) + 1).astype(int))
    x = np.concatenate([times[:1], times])[kept]
    return Curve(label, x, share[kept], style="steps", color=color)


MAX_STEPS = 400
"""Steps drawn at most."""


def _title(name: str) -> str:
    return {"p50": "median solve of a flight", "p99": "99 % solve of a flight", "max": "longest solve of a flight"}[
        name.rpartition(".")[2]
    ]
