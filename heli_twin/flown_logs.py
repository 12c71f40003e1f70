"""Flies several experiments, one a core, into logs of one folder."""

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

from heli_twin.experiment import Experiment
from heli_twin.flight import Outcome
from heli_twin.mission import fly
from heli_twin.workers.fleet import fleet


class Logged(NamedTuple):
    """A flight that left a log."""

    path: Path
    outcome: Outcome


def fly_into(folder: Path, experiments: Sequence[Experiment]) -> Iterator[Logged]:
    """Fly experiments, one a core at a time, and yield their logs in `folder` in the order of the experiments."""
    with fleet() as run:
        yield from run(partial(_logged, folder), experiments)


def _logged(folder: Path, experiment: Experiment) -> Logged:
    result = fly(experiment, log_dir=folder)
    assert result.path is not None
    return Logged(result.path, result.outcome)
