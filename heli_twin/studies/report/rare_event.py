"""How often a rare event happens, and the most likely flight that brings it about."""

from collections.abc import Iterator

import numpy as np

from heli_twin.reporting.figure import Array, Curve, Figure, Panel, Table
from heli_twin.reporting.words import metric, number
from heli_twin.studies.columns import SCORED
from heli_twin.studies.designs.rare_event import RareEvent, estimate_of
from heli_twin.studies.report.results import Results
from heli_twin.studies.subset_simulation import Estimate, mean_state, scaled, size

HEADER = ("", "probability", "95 % interval", "flights", "levels", "the least noise that is enough", "fly it")


def rare_event(results: Results) -> Iterator[Figure | Table]:
    """The probability of each alternative with its interval, and how often each score is exceeded."""
    design = results.study.design
    if not isinstance(design, RareEvent):
        return
    scale = metric(results.study.score)
    rows: list[tuple[str, ...]] = []
    panels: list[Panel] = []
    for place, alternative in enumerate(results.alternatives):
        mine = results.of(alternative)
        searched = mine.where(np.isnan(mine["factor"].astype(float)))
        scores = _scores(searched)[np.argsort(searched["state"])]
        found = estimate_of(design, len(results.axes), results.study.seed, scores.tolist())
        if found is None:
            rows.append((alternative, "not finished", "", str(len(scores)), "", "", ""))
            continue
        rows.append((alternative, *_row(found, mine, design)))
        x, y = _exceedance(found)
        panels.append(
            Panel(
                alternative,
                scale.label,
                "probability that it is exceeded",
                [Curve(alternative, x * scale.factor, y, style="steps", color=place)],
                y_log=True,
            )
        )
    limit = f"{number(design.limit * scale.factor)} {scale.unit}".strip()
    text = (
        f"A flight has failed if its {scale.name} exceeds {limit}, or if it crashes. Subset simulation over all noise"
        f"{' and the axes' if results.axes else ''}, {design.samples} flights a level; interval: see the guide page"
        " on studies."
    )
    yield Table("How often", text, HEADER, rows, codes=(6,))
    if panels:
        yield Figure("rare-event", "How often is more", text, panels)


def _scores(rows: Results) -> Array:
    """Scores; infinite for a crash."""
    score = rows[rows.study.score].astype(float)
    flew = np.isin(rows["outcome"].astype(str), SCORED)
    return np.where(~flew | np.isnan(score), np.inf, score)


def _row(found: Estimate, mine: Results, design: RareEvent) -> tuple[str, ...]:
    chance = f"{found.probability:.2g}" if found.failures else f"below {found.high:.2g}"
    interval = f"{found.low:.2g} to {found.high:.2g}" if found.failures else ""
    least, command = _least(found, mine, design)
    return (chance, interval, str(found.evaluations), str(len(found.levels)), least, command)


def _least(found: Estimate, mine: Results, design: RareEvent) -> tuple[str, str]:
    """The smallest share of the mean failure that fails, and the command that flies it."""
    factor = mine["factor"].astype(float)
    failed = np.flatnonzero(~np.isnan(factor) & (_scores(mine) >= design.limit))
    if not len(failed):
        return "none found", ""
    best = int(failed[np.argmin(factor[failed])])
    axes, noise = size(scaled(mean_state(found.failures), float(factor[best])))
    told = [f"{noise:.2f} of usual noise"] + [f"axes {axes:.1f} standard deviations off"] * bool(mine.axes)
    return ", ".join(told), mine.command(best)


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
