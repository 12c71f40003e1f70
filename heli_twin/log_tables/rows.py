"""One row a log: what was flown, how it ended, and, after a pass over its messages, how well."""

from collections.abc import Iterator, Sequence
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from heli_twin.errors import HeliTwinError
from heli_twin.experiment.differences import fly_words
from heli_twin.experiment.several_written import parsed_several, several_from_json
from heli_twin.experiment.tree import ExperimentError, Tree, parsed, tree_of
from heli_twin.logbook import viewed_experiment
from heli_twin.metrics.flat import flat
from heli_twin.metrics.measures import measures
from heli_twin.metrics.motion import statistics
from heli_twin.metrics.several import pooled_metrics
from heli_twin.metrics.tracking import metrics
from heli_twin.recording import Log, LogError, read_log
from heli_twin.recording.head import read_head
from heli_twin.recording.records import Messages

ENDINGS = (".mcap", ".mcap.part")
TOPICS = ("/truth", "/reference", "/mpc/qp", "/timing", "/command/sent")
"""The topics that the errors are computed from; of a log without a truth, the poses too."""
BYTES_PER_S = 80e6
"""Speed of a pass over messages, for the sentence that says how long it takes."""
NOTHING = Messages((), ())
UNREADABLE = "unreadable"
"""The outcome of a file that is no log that can be read."""


class LogRow(NamedTuple):
    """A log in a table."""

    path: Path
    facts: dict[str, Any]
    """By name; metrics in SI units under the names that studies use."""
    text: str = ""
    """The experiment, canonical JSON."""

    @property
    def experiment(self) -> Tree:
        """With every field; empty if this version does not know it."""
        return _tree(self.text)


def logs_in(folder: Path, *, below: bool = False) -> list[Path]:
    """The files in a folder that look like logs, unfinished ones too.

    Raises:
        HeliTwinError: It is no folder, or has none.
    """
    if not folder.is_dir():
        raise HeliTwinError(f"{folder} is no folder: give one with logs, such as logs")
    found = sorted(path for path in folder.glob("**/*" if below else "*") if path.name.endswith(ENDINGS))
    if not found:
        more = "" if below else sum(1 for _ in folder.glob("**/*.mcap"))
        hint = f"; below it are {more}: --recursive lists them" if more else ""
        raise HeliTwinError(f"{folder} has no logs (*.mcap){hint}")
    return found


def head_row(path: Path) -> LogRow:
    """The row of a log, from its beginning and end alone."""
    facts: dict[str, Any] = {"file": str(path), "started": None, "trajectory": None, "controller": None}
    try:
        log = read_head(path)
    except LogError as error:
        told = str(error).removeprefix(f"{path} ")
        return LogRow(path, facts | {"changes": None, "outcome": UNREADABLE, "problem": told})
    words: list[str] | None = None
    problem = ""
    try:
        words = fly_words(log.experiment)
    except ExperimentError as error:
        problem = str(error)
    facts |= {
        "started": log.metadata.get("started") or None,
        "trajectory": f"{len(log.ships)} helicopters" if log.ships else _kind(log.experiment, "trajectory"),
        "controller": _room_kind(log.experiment) if log.ships else _kind(log.experiment, "controller"),
        "origin": log.origin,
        "changes": words,
        "outcome": log.outcome,
        "outcome_text": log.ending.text,
        "duration": 1e-9 * log.ending.time,
        "digest": log.digest or None,
        "problem": problem or None,
    }
    return LogRow(path, facts, log.experiment)


@lru_cache(maxsize=4096)
def _tree(text: str) -> Tree:
    try:
        return tree_of(viewed_experiment(Log({}, text))) if text else {}
    except ExperimentError:
        return {}


def _kind(experiment: str, part: str) -> str | None:
    try:
        kind = parsed(experiment)[part]["kind"]
    except (ExperimentError, LookupError, TypeError):
        return None
    return kind if isinstance(kind, str) else None


def _room_kind(experiment: str) -> str | None:
    """The coordination of several helicopters."""
    try:
        kind = parsed_several(experiment)["coordination"]["kind"]
    except (ExperimentError, LookupError, TypeError):
        return None
    return kind if isinstance(kind, str) else None


def measured(row: LogRow) -> LogRow:
    """A row with its errors, effort and computing times, which need a pass over the messages."""
    if row.facts["outcome"] == UNREADABLE:
        return row
    try:
        log = read_log(row.path, (*TOPICS, "/path", "/planning"))
        if log.ships:
            with np.errstate(all="ignore"):
                found = pooled_metrics(log, several_from_json(log.experiment).fleet())
            return row._replace(facts=row.facts | _without_outcome(found))
        if not log.messages.get("/truth", NOTHING).times:
            log = read_log(row.path, (*TOPICS, "/mocap/pose"))
        controller = viewed_experiment(log).controller if row.experiment else None
        with np.errstate(all="ignore"):
            found = flat(metrics(log)) | flat(measures(log, controller))
            found |= flat({"error": statistics(log) or {}})
    except (LogError, ExperimentError) as error:
        return row._replace(
            facts=row.facts | {"outcome": UNREADABLE, "problem": str(error).removeprefix(f"{row.path} ")}
        )
    return row._replace(facts=row.facts | _without_outcome(found))


def _without_outcome(found: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in found.items() if key not in ("outcome", "duration", "settling")}


@cache
def metric_names() -> tuple[str, ...]:
    """The names of the metrics that `measured` adds; an empty log has every one of them but statistics."""
    nothing = Log({})
    return tuple(flat(metrics(nothing)) | flat(measures(nothing)))


def measured_rows(rows: Sequence[LogRow]) -> Iterator[LogRow]:
    """All rows with their errors, one after the other."""
    return map(measured, rows)


def seconds_of(rows: Sequence[LogRow]) -> float:
    """About how long `measured` takes for rows, s."""
    return sum(row.path.stat().st_size for row in rows if row.facts["outcome"] != UNREADABLE) / BYTES_PER_S
