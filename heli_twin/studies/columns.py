"""The columns of a run's row: outcome, metrics and provenance."""

from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from typing import Any, Literal

from heli_twin.experiment import Experiment
from heli_twin.experiment.several import Several
from heli_twin.metrics.flat import flat
from heli_twin.metrics.measures import measures
from heli_twin.metrics.several import pooled_metrics, several_metrics
from heli_twin.metrics.tracking import metrics
from heli_twin.recording import Log
from heli_twin.requirements import Requirement, Verdict, judge
from heli_twin.studies.errors import StudyError
from heli_twin.terminal_text import instead

COMPLETED = "completed"
"""The outcome of a flight that did not fail. In a study with requirements it may have landed early, if it may."""
BROKEN = "broken"
"""The outcome of a flight that ended well but broke a requirement: it has failed, and its score counts all the same."""
SCORED = (COMPLETED, BROKEN)
"""Outcomes of flights whose score counts; the others get the penalty."""
LANDED_EARLY = "landed"
"""The outcome of an emergency landing: the flight did not do what it should, and nothing broke."""
STANDING_PLAN_M = 0.06
"""A plan that ends below this height means to land."""
INVALID: Literal["invalid"] = "invalid"
"""The outcome of a run whose control law was a process that failed: it is neither completed nor a failure."""
MEASURED_COLUMNS = (
    *("control_step_ms.", "solve_ms.", "planning_ms.", "deadline_misses", "real_time_factor", "wall_time", "attempts"),
    *("host", "started", "git_commit", "cpu", "platform", "python", "version."),
)
"""Columns that may differ between two flights of the same experiment, by how their names begin."""


def columns(log: Log, experiment: Experiment, requirements: Sequence[Requirement] = ()) -> dict[str, Any]:
    """The row of a flight: its outcome, its metrics by dotted name, its provenance. Plain values, no NaN."""
    row = flat(metrics(log)) | flat(measures(log, experiment.controller))
    row = {"outcome": outcome(log), "outcome_text": log.ending.text} | {k: v for k, v in row.items() if k != "outcome"}
    row |= _judged(row, judge(requirements, log)) if requirements else {}
    return row | _provenance(log, row.pop("duration", None))


def columns_of_several(log: Log, several: Several, requirements: Sequence[Requirement] = ()) -> dict[str, Any]:
    """The row of a flight of several helicopters.

    Of a metric that each helicopter has, it is the largest of all; of a requirement, the verdict on the one that is
    nearest to breaking it.
    """
    row = pooled_metrics(log, several.fleet())
    row = {"outcome": log.outcome, "outcome_text": log.ending.text} | {k: v for k, v in row.items() if k != "outcome"}
    if requirements:
        row |= _judged(row, _tightest([judge(requirements, log.ship(name)) for name in log.ships]))
    return row | _provenance(log, row.pop("duration", None))


def _tightest(of_each: Sequence[Mapping[str, Verdict]]) -> dict[str, Verdict]:
    """Of each requirement the verdict on the helicopter that breaks it most, or keeps it by least."""

    def order(verdict: Verdict) -> tuple[bool, float]:
        return verdict.holds, -_excess(verdict)

    return {name: min((each[name] for each in of_each), key=order) for name in of_each[0]}


def _provenance(log: Log, duration: Any) -> dict[str, Any]:
    row: dict[str, Any] = {"flown": duration, "digest": log.digest}
    about = log.metadata
    row |= {"started": about.get("started", ""), "git_commit": about.get("git_commit", ""), "cpu": about.get("cpu", "")}
    row |= {key: value for key, value in about.items() if key.startswith("version.") or key in ("python", "platform")}
    return row


def _judged(row: Mapping[str, Any], verdicts: Mapping[str, Verdict]) -> dict[str, Any]:
    """The excess over each requirement, and the outcome: where nothing broke, the requirements alone decide it."""
    judged: dict[str, Any] = {excess(name): _excess(verdict) for name, verdict in verdicts.items()}
    broken = [
        f"{name}: {verdict.reason} at {verdict.tightest_at:g} s" if verdict.tightest_at is not None else name
        for name, verdict in verdicts.items()
        if not verdict.holds
    ]
    if row["outcome"] not in (COMPLETED, LANDED_EARLY):
        return judged
    if broken:
        return judged | {"outcome": BROKEN, "outcome_text": f"requirement {'; '.join(broken)}"}
    return judged | {"outcome": COMPLETED}


def excess(name: str) -> str:
    """The metric of a requirement: by how much it is broken, as a share of its limit; negative if it is kept."""
    return f"excess.{name}"


def _excess(verdict: Verdict) -> float:
    """1 and -1 stand for a requirement that is decided by what is true or false alone."""
    if verdict.normalised is None:
        return -1.0 if verdict.holds else 1.0
    return -verdict.normalised


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


@cache
def several_metric_names() -> tuple[str, ...]:
    """The names of the metrics that several helicopters have beyond those of one."""
    known = flat(several_metrics(Log({}), {}))
    return tuple(name for name in known if name not in ("outcome", "duration", "nearest", "nearest_planned"))


def check_metrics(names: Iterable[str], requirements: Iterable[str] = (), *, together: bool = False) -> None:
    """Refuse metrics that no flight has.

    Args:
        names: The metrics.
        requirements: Names of the study's requirements, each of which has an excess.
        together: True for a study of several helicopters.

    Raises:
        StudyError: Suggests the right one.
    """
    of_room = several_metric_names() if together else ()
    known = (*metric_names(), *of_room, "real_time_factor", *map(excess, requirements))
    for name in names:
        if name not in known:
            raise StudyError(f"unknown metric {instead(name, known)}")
