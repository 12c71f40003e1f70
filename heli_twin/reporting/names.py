"""Names of flights in pictures: what tells them apart."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from heli_twin.experiment.differences import fly_words
from heli_twin.experiment.tree import ExperimentError
from heli_twin.recording import Log


def told_apart(logs: Sequence[Log], given: Sequence[Any]) -> list[str]:
    """For each flight the words of its `fly` command that not all have; the name of its file if that tells nothing.

    Args:
        logs: The flights.
        given: The same as they were given: paths, or anything else.
    """
    words = [_words(log) for log in logs]
    if len(logs) == 1:
        return ["" if words[0] is None else " ".join(words[0]) or "lab"]
    common = set(words[0] or ()).intersection(*(each or () for each in words))
    told = [" ".join(word for word in each or () if word not in common) or "lab" for each in words]
    files = [Path(str(each)).stem if isinstance(each, str | Path) else "" for each in given]
    doubled = {name for name in told if told.count(name) > 1}
    return [
        (files[i] or f"{name} {i + 1}") if name in doubled or words[i] is None else name for i, name in enumerate(told)
    ]


def _words(log: Log) -> list[str] | None:
    """None for an experiment that this version does not know."""
    try:
        return fly_words(log.experiment)
    except ExperimentError:
        return None
