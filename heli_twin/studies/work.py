"""The work of a worker process: fly one run; return its row, and its log if it is to be kept."""

import socket
from io import BytesIO
from time import perf_counter
from typing import TYPE_CHECKING, Any

from heli_twin.experiment.families import DESIGNS, GROUPS, all_members
from heli_twin.studies.flight_code import code_hash, code_parts, file_hash
from heli_twin.workers.engine import Trouble, Work
from heli_twin.workers.task import Flown, Task

if TYPE_CHECKING:
    from heli_twin.requirements import Requirement

DECODED_TOPICS = ("/truth", "/reference", "/command/sent", "/mpc/qp", "/timing")
"""The topics from which the columns of a row are computed; other topics are not decoded."""

OTHER_CODE = "other code"
"""The outcome of a run that a worker refuses, since its code is not the driver's."""

file_hash()
for family in GROUPS.keys() - {DESIGNS}:
    # Both are kept by this process from its start on: what is hashed is what flies.
    dict(all_members(family))


def fly_with_code(work: Work, files: str, code: str, task: Task) -> Flown | Trouble:
    """Do the work if this process has the driver's code.

    Args:
        work: Flies the run.
        files: The driver's `file_hash`.
        code: The driver's `code_hash`.
        task: The run.
    """
    if files != file_hash() and code != code_hash():
        row = {"id": task.id, "outcome": OTHER_CODE, "host": socket.gethostname(), "parts": code_parts()}
        return Flown(row)
    return work(task)


def fly_task(task: Task) -> Flown | Trouble:
    """Fly a run; a failed flight is a row like any other, an invalid run is none."""
    from controllers.programs import receive
    from heli_twin.experiment.families import FamilyError
    from heli_twin.experiment.named_classes import load_own_sources
    from heli_twin.experiment.several_written import is_several_json, several_from_json
    from heli_twin.experiment.tree import ExperimentError, from_json
    from heli_twin.mission import ProgramMissing, fly
    from heli_twin.recording import read_log
    from heli_twin.studies.columns import COMPLETED, INVALID, SCORED, columns, columns_of_several

    began = perf_counter()
    about = {"id": task.id, "host": socket.gethostname()}
    try:
        load_own_sources(task.own)
        receive(task.programs)
        requirements = _requirements(task)
        if is_several_json(task.experiment):
            from heli_twin.several.fly import fly_several

            several = several_from_json(task.experiment)
            result = fly_several(several, log_dir=None)
            if result.outcome.kind == INVALID:
                return Trouble(INVALID, result.outcome.text)
            row = about | columns_of_several(result.log, several, requirements)
        else:
            experiment = from_json(task.experiment)
            result = fly(experiment, log_dir=None)
            if result.outcome.kind == INVALID:
                return Trouble(INVALID, result.outcome.text)
            log = read_log(BytesIO(result.data or b""), None if requirements else DECODED_TOPICS)
            row = about | columns(log, experiment, requirements)
        row["real_time_factor"] = result.real_time_factor
    except ProgramMissing as error:
        return Trouble(INVALID, f"{error} ({socket.gethostname()})")
    except (ExperimentError, FamilyError) as error:
        return Flown(about | {"outcome": "refused", "outcome_text": str(error)})
    score: Any = row.get(task.score)
    failed = row["outcome"] != COMPLETED
    high = row["outcome"] in SCORED and task.keep_above is not None and score is not None and score > task.keep_above
    keep = task.keep_log or (failed and task.keep_failed) or high
    row["wall_time"] = perf_counter() - began
    return Flown(row, result.data if keep else None)


def _requirements(task: Task) -> "tuple[Requirement, ...]":
    if not task.requirements:
        return ()
    # A heavy import, for these tasks alone.
    from heli_twin.requirements import requirements_of

    return requirements_of(task.requirements)
