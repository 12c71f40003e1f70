"""What independent flights show: how often a flight fails, at most, and how bad nearly all flights are, at most."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from heli_twin.reporting.figure import Table
from heli_twin.reporting.intervals import flights_to_show, shown_share, tolerance_bound, wilson
from heli_twin.reporting.words import metric, number, percent
from heli_twin.studies.columns import LANDED_EARLY
from heli_twin.studies.designs.monte_carlo import MonteCarlo
from heli_twin.studies.report.results import Results
from heli_twin.studies.report.search import place_of

FEWEST_FLIGHTS, MOST_GROUPS, MOST_TOLD = 10, 48, 12
"""Flights of a group of which something can be said, groups of the table, and groups told on the terminal."""
SHARE = 0.95
"""Of flights, in the bound on their score."""


class Sample(NamedTuple):
    """Independent flights of one experiment, or of one scatter of experiments."""

    name: str
    failures: int
    flights: int
    bound: float
    """Of the score of 95 % of flights, with 95 % confidence; infinite if there is none."""

    @property
    def told(self) -> str:
        """What they show, in words."""
        failed = {0: "without a failure", 1: "with one failure"}.get(self.failures, f"with {self.failures} failures")
        share = 100.0 * shown_share(self.failures, self.flights)
        # Rounded down: no more is claimed than was shown.
        shown = np.floor(share) if share < 99.0 else np.floor(share * 100.0) / 100.0
        return f"{self.flights:,} flights {failed}: {shown:g} % of flights, 95 % confidence"


def samples(results: Results) -> list[Sample]:
    """The samples of independent flights in a study; none where flights were chosen by the results of others."""
    study = results.study
    if study.design.adaptive or study.half_width:
        return []
    found: list[Sample] = []
    for alternative in results.alternatives:
        mine = results.of(alternative)
        points = [None] if isinstance(study.design, MonteCarlo) else np.unique(mine["point"]).tolist()
        for point in points[: MOST_GROUPS + 1]:
            is_mine = np.full(len(mine), True) if point is None else mine["point"] == point
            rows = mine.where(is_mine)
            if len(rows) < FEWEST_FLIGHTS:
                return []
            place = "" if point is None else place_of(mine, int(np.argmax(is_mine)))
            name = ", ".join(filter(None, (alternative if len(results.alternatives) > 1 else "", place)))
            found.append(_sample(name, rows))
    return found if len(found) <= MOST_GROUPS else []


def bounds(results: Results) -> Iterator[Table]:
    """One row a sample: failures with their Wilson interval, and what is shown with 95 % confidence."""
    found = samples(results)
    if not found:
        return
    scale = metric(results.study.score)
    text = (
        "Independent flights. Shown: at least so many of all flights do not fail, with 95 % confidence;"
        f" {flights_to_show(0.95)} flights without a failure show 95 %, {flights_to_show(0.99)} show 99 % (Wilks)."
        " Each row by itself is right in 95 of 100 studies."
    )
    header = ["", "failed, 95 % interval (Wilson)", "shown"]
    rows = [
        [
            sample.name,
            f"{sample.failures} of {sample.flights:,}, {percent(wilson(sample.failures, sample.flights))}",
            sample.told,
        ]
        for sample in found
    ]
    if any(np.isfinite(sample.bound) for sample in found):
        text += (
            f" Last column: 95 % of all flights stay below it, with 95 % confidence ({flights_to_show(SHARE)} needed)."
        )
        header.append(f"{scale.name} of 95 %")
        for row, sample in zip(rows, found, strict=True):
            known = f"{number(sample.bound * scale.factor)} {scale.unit}".rstrip()
            row.append(known if np.isfinite(sample.bound) else "-")
    yield Table("What the flights show", text, header, rows)


def told_bounds(results: Results) -> Iterator[str]:
    """The same in a few lines for a terminal; none if they were many."""
    found = samples(results)
    if len(found) <= MOST_TOLD:
        for sample in found:
            yield f"{sample.name}: {sample.told}" if sample.name else sample.told


def _sample(name: str, rows: Results) -> Sample:
    scores = rows.metric(rows.study.score)
    bound = tolerance_bound(np.where(np.isnan(scores), np.inf, scores), SHARE)
    failed = rows.failed & (rows["outcome"] != LANDED_EARLY)
    return Sample(name, int(failed.sum()), len(rows), bound)
