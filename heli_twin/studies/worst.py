"""Single runs of a study: the worst ones, and the commands that show them."""

from pathlib import Path
from typing import NamedTuple

from heli_twin.experiment.differences import fly_command
from heli_twin.experiment.tree import ExperimentError
from heli_twin.reporting.terminal_tables import metric_text
from heli_twin.reporting.words import metric
from heli_twin.studies.columns import COMPLETED
from heli_twin.studies.errors import StudyError
from heli_twin.studies.space import text_of, value_at, varied
from heli_twin.studies.store import Store
from heli_twin.studies.study import stored_study
from heli_twin.terminal_text import pasteable

MOST_NOISE = 2
"""Seeds of noise in a command."""


class WorstRun(NamedTuple):
    """A run that failed or completed with a bad score."""

    id: str
    what: str
    """Its outcome or score, and its place in the study."""
    command: str
    """The command that replays its log, or flies it again if no log was kept."""


def worst_runs(folder: Path, number: int = 10) -> list[WorstRun]:
    """The runs that failed, in the study's order, and then those that completed with the worst score."""
    with Store(folder) as store:
        study = stored_study(store.about()["study"])
        ids = [*store.failed(number), *(run_id for run_id, _ in store.worst(number))][:number]
        rows = {run_id: store.row(run_id) for run_id in ids}
    worst: list[WorstRun] = []
    for run_id, row in rows.items():
        place = ", ".join(f"{key} {row[key]}" for key in ("alternative", *study.axes, "rung", "seed") if key in row)
        score = f"{metric(study.score).name} {metric_text(study.score, row.get(study.score))}"
        what = score if row["outcome"] == COMPLETED else row.get("outcome_text", "")
        worst.append(WorstRun(run_id, f"{what} ({place})", command_of(folder, run_id)))
    return worst


def command_of(folder: Path, run_id: str) -> str:
    """The command that replays a run's log, or flies it again if no log was kept."""
    log = folder / "logs" / f"{run_id}.mcap"
    if log.exists():
        return pasteable("heli-twin", "replay", log)
    try:
        experiment = experiment_by_id(folder, run_id)
    except ExperimentError:
        # A class of the user's own, which has to be named, and the store has no path of it.
        return pasteable("heli-twin", "study", "fly", folder, run_id, "--with", "FILE.py")
    # An airframe's text fits into no command, and the noise of a search into none that can be read.
    noise = value_at(varied(experiment, {}), "noise")
    is_long = "\\n" in experiment or len(noise) > MOST_NOISE
    return pasteable("heli-twin", "study", "fly", folder, run_id) if is_long else fly_command(experiment)


def experiment_by_id(folder: Path, start: str) -> str:
    """The experiment of the run whose id begins so, canonical JSON.

    Raises:
        StudyError: The study has no such run.
    """
    with Store(folder) as store:
        run, base = store.find(start), store.about()["base"]
    if run is None:
        raise StudyError(f"{folder} has no run '{start}': `heli-twin study worst` and the report print ids")
    return text_of(varied(base, run[1]))
