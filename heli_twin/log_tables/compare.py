"""Several flights beside each other: what differs between their experiments, and how well each flew."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from heli_twin.errors import HeliTwinError
from heli_twin.experiment import Experiment
from heli_twin.experiment.differences import differences
from heli_twin.logbook import viewed_experiment
from heli_twin.metrics.flat import flat
from heli_twin.metrics.measures import measures
from heli_twin.metrics.motion import statistics
from heli_twin.metrics.tracking import SETTLING_S, metrics
from heli_twin.recording import Log, read_log

STATISTICS = ("rmse", "mean", "median", "std", "min", "max", "sse")
"""As evo names them."""


class Compared(NamedTuple):
    """One of the flights."""

    name: str
    """A, B, ..."""
    path: Path
    log: Log
    experiment: Experiment
    errors: dict[str, dict[str, float]] | None
    """Statistics of `position`, `x`, `y`, `z`, `yaw`; None if none was recorded in the window."""
    metrics: dict[str, Any]
    """Of the whole flight, by dotted name, SI units."""

    def plain(self) -> dict[str, Any]:
        """The same for JSON."""
        row = {"name": self.name, "file": str(self.path), "outcome": self.log.outcome}
        row |= {"duration": 1e-9 * self.log.ending.time, "digest": self.log.digest or None}
        found = {key: value for key, value in self.metrics.items() if key not in ("outcome", "duration")}
        return row | flat({"error": self.errors or {}}) | found


def compared(paths: Iterable[Path], start: float | None = None, end: float | None = None) -> list[Compared]:
    """Read flights to compare.

    Args:
        paths: Their logs.
        start: First moment whose errors count, s; None: after the metrics' usual start.
        end: Last moment, s; None for the end of each flight.

    Raises:
        HeliTwinError: A log cannot be read, or the window is empty.
    """
    first = SETTLING_S if start is None else start
    if not first >= 0 or (end is not None and not end > first):
        raise HeliTwinError(
            f"no time from {first:g} to {'the end' if end is None else f'{end:g} s'}: give --from < --to"
        )
    flights: list[Compared] = []
    for i, path in enumerate(paths):
        log = read_log(path)
        experiment = viewed_experiment(log)
        with np.errstate(all="ignore"):
            found = flat(metrics(log)) | flat(measures(log, experiment.controller))
            flights.append(Compared(letters(i), path, log, experiment, statistics(log, first, end), found))
    return flights


def letters(number: int) -> str:
    """A, B, ..., Z, AA, AB, ..."""
    name = ""
    number += 1
    while number:
        number, digit = divmod(number - 1, 26)
        name = chr(ord("A") + digit) + name
    return name


def differing(flights: Sequence[Compared]) -> list[tuple[str, list[str]]]:
    """Each field in which the experiments differ, with its value in each flight."""
    first, *others = flights
    values: dict[str, list[str | None]] = {}
    for place, other in enumerate(others, start=1):
        for path, of_first, of_other in differences(first.experiment, other.experiment):
            row = values.setdefault(path, [of_first] + [None] * len(others))
            row[place] = of_other
    return [(path, [row[0] or "" if value is None else value for value in row]) for path, row in values.items()]
