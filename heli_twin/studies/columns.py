"""The columns of a run's row: outcome, metrics and provenance."""

from collections.abc import Iterable
from functools import cache
from typing import Any, Literal

from heli_twin.experiment import Experiment
from heli_twin.metrics.flat import flat
from heli_twin.metrics.measures import measures
from heli_twin.metrics.tracking import metrics
from heli_twin.recording import Log
from heli_twin.studies.errors import StudyError
from heli_twin.terminal_text import instead

COMPLETED = "completed"
"""The outcome of a flight that did not fail."""
LANDED_EARLY = "landed"
"""The outcome of an emergency landing: the flight did not do what it should, and nothing broke."""
STANDING_PLAN_M = 0.06
"""A plan that ends below this height means to land."""
INVALID: Literal["invalid"] = "invalid"
"""The outcome of a run whose control law was a process that failed: it is neither completed nor a failure."""
MEASURED_COLUMNS = (
    *("control_step_ms.", "solve_ms.", "deadline_misses", "real_time_factor", "wall_time", "attempts"),
    *("host", "started", "git_commit", "cpu", "platform", "python", "version."),
)
"""Columns that may differ between two flights of the same experiment, by how their names begin."""


def columns(log: Log, experiment: Experiment) -> dict[str, Any]:
    """The row of a flight: its outcome, its metrics by dotted name, its provenance. Plain values, no NaN."""
    row = flat(metrics(log)) | flat(measures(log, experiment.controller))
    row = {"outcome": outcome(log), "outcome_text": log.ending.text} | {k: v for k, v in row.items() if k != "outcome"}
    row["flown"] = row.pop("duration", None)
    row["digest"] = log.digest
    about = log.metadata
    row |= {"started": about.get("started", ""), "git_commit": about.get("git_commit", ""), "cpu": about.get("cpu", "")}
    row |= {key: value for key, value in about.items() if key.startswith("version.") or key in ("python", "platform")}
    return row


def outcome(log: Log) -> str:
    """The outcome of a flight in a study: one that landed where its plan came down has completed."""
    height = log.reference.x[-1:, 2]
    has_come_down = log.outcome == "landed" and bool((height < STANDING_PLAN_M).all())
    return COMPLETED if has_come_down else log.outcome


@cache
def metric_names() -> tuple[str, ...]:
    """The names of all metrics; an empty log has every one of them."""
    known = flat(metrics(Log({}))) | flat(measures(Log({})))
    return tuple(name for name in known if name not in ("outcome", "duration", "settling"))


def check_metrics(names: Iterable[str]) -> None:
    """Refuse metrics that no flight has.

    Raises:
        StudyError: Suggests the right one.
    """
    known = metric_names()
    for name in names:
        if name not in known:
            raise StudyError(f"unknown metric {instead(name, known)}")
