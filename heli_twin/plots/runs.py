"""Flights as figures show them: their names, colours and positions, and the window of time that is shown."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from controllers.signals import Array
from heli_twin.errors import HeliTwinError
from heli_twin.experiment import Experiment
from heli_twin.experiment.tree import ExperimentError
from heli_twin.logbook import viewed_experiment
from heli_twin.recording import Log, read_log
from heli_twin.reporting.figure import color
from heli_twin.reporting.names import told_apart
from heli_twin.requirements import Requirement, Verdict, judge
from heli_twin.terminal_text import clean

NAME_LIMIT = 60
"""Characters of a flight's name in a legend."""


class Run(NamedTuple):
    """A flight in a figure."""

    log: Log
    name: str
    color: str
    experiment: Experiment | None
    """None if this version does not know it."""
    start: float
    """Start of what is shown, s."""
    end: float
    verdicts: tuple[Verdict, ...] = ()
    """On its requirements, in their order."""

    def shown(self, time: Array) -> Any:
        """The slice of ascending times (n,), s, that is shown."""
        first, last = np.searchsorted(time, [self.start, self.end + 1e-9])
        return slice(int(first), int(last))


def runs(
    logs: Sequence[Any],
    names: Sequence[str] | None = None,
    start: float | None = None,
    end: float | None = None,
    requirements: Iterable[Requirement] = (),
) -> list[Run]:
    """Read flights for a figure.

    Args:
        logs: Paths of logs, logs that were read, or results of `fly`.
        names: For the legend; None: what tells one experiment from the others.
        start: First moment that is shown, s; None for the beginning.
        end: Last moment, s; None for the end of the longest flight.
        requirements: By which each is judged.

    Raises:
        HeliTwinError: A log cannot be read or judged, or names or window do not fit.
    """
    if not logs:
        raise HeliTwinError("no flight is given: give the path of one log or more")
    read, ships = _each([_log(each) for each in logs])
    if names is not None and len(names) != len(read):
        raise HeliTwinError(f"names has {len(names)} names for {len(read)} flights: give one for each")
    longest = max(1e-9 * log.ending.time for log in read)
    first, last = 0.0 if start is None else start, longest if end is None else end
    if not 0 <= first < last or first >= longest:
        raise HeliTwinError(
            f"nothing was recorded from {first:g} to {last:g} s: give a window within 0 and {longest:g} s, its start"
            " before its end"
        )
    known = [_experiment(log) for log in read]
    required = tuple(requirements)
    verdicts = [tuple(judge(required, log).values()) if required else () for log in read]
    shown = names or ships or told_apart(read, logs)
    return [
        Run(log, clean(name, NAME_LIMIT), color(i), experiment, first, min(last, longest), judged)
        for i, (log, name, experiment, judged) in enumerate(zip(read, shown, known, verdicts, strict=True))
    ]


def _each(logs: Sequence[Log]) -> tuple[list[Log], list[str]]:
    """The flights of all helicopters, and their names if one log holds several; else no names."""
    if not any(log.ships for log in logs):
        return [*logs], []
    read: list[Log] = []
    names: list[str] = []
    for i, log in enumerate(logs, 1):
        for name in log.ships or [""]:
            read.append(log.ship(name) if name else log)
            names.append(" ".join(filter(None, (name, f"of {i}" if len(logs) > 1 else ""))))
    return read, names


def _log(source: Any) -> Log:
    if isinstance(source, str | Path):
        return read_log(source)
    found = source if isinstance(source, Log) else getattr(source, "log", None)
    if not isinstance(found, Log):
        raise HeliTwinError(f"{clean(repr(source), 80)} is no flight: give a path, a log or a result of `fly`")
    return found


def _experiment(log: Log) -> Experiment | None:
    try:
        return viewed_experiment(log)
    except ExperimentError:
        return None
