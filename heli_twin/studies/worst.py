"""Single runs of a study: the ones to look at, and what flies them again."""

from pathlib import Path
from typing import NamedTuple

from heli_twin.experiment.differences import fly_command
from heli_twin.experiment.tree import canonical_json, experiment_of
from heli_twin.pasteable import pasteable
from heli_twin.studies.columns import COMPLETED
from heli_twin.studies.errors import StudyError
from heli_twin.studies.space import varied
from heli_twin.studies.store import Store


class Bad(NamedTuple):
    """A run worth looking at."""

    id: str
    what: str
    """What became of it, where in the study."""
    command: str
    """What replays its log, or else flies it again."""


def worst_runs(folder: Path, number: int = 10) -> list[Bad]:
    """The runs that failed, in the study's order, and then those that completed with the worst score."""
    with Store(folder) as store:
        study = store.about()["study"]
        ids = [*store.failed(number), *(found for found, _ in store.worst(number))][:number]
        rows = {run_id: store.row(run_id) for run_id in ids}
    found = []
    for run_id, row in rows.items():
        place = ", ".join(f"{key} {row[key]}" for key in ("alternative", *study["axes"], "rung", "seed") if key in row)
        what = row["outcome_text"] if row["outcome"] != COMPLETED else f"{study['score']} {row.get(study['score']):.4g}"
        found.append(Bad(run_id, f"{what} ({place})", command_of(folder, run_id)))
    return found


def command_of(folder: Path, run_id: str) -> str:
    """What shows a run again: its log if it was kept, else the flight."""
    log = folder / "logs" / f"{run_id}.mcap"
    return pasteable("heli-twin", "replay", log) if log.exists() else fly_command(experiment_by_id(folder, run_id))


def experiment_by_id(folder: Path, start: str) -> str:
    """The experiment of the run whose id begins so, canonical JSON.

    Raises:
        StudyError: The study has no such run.
    """
    with Store(folder) as store:
        found, base = store.find(start), store.about()["base"]
    if found is None:
        raise StudyError(f"{folder} has no run '{start}': `heli-twin study worst` and the report print ids")
    return canonical_json(experiment_of(varied(base, found[1])))
