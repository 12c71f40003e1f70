"""What a worker does: fly one run and bring back its row, and its log if somebody wants to see it."""

import socket
from io import BytesIO
from time import perf_counter
from typing import Any

from heli_twin.workers.task import Flown, Task

WIRES = ("/truth", "/reference", "/command/sent", "/mpc/qp", "/timing")
"""What the columns of a row are computed from; the rest of a log is not decoded."""


def fly_task(task: Task) -> Flown:
    """Fly a run; a flight that went wrong is a row like any other."""
    from heli_twin.experiment.tree import ExperimentError, from_json
    from heli_twin.mission import fly
    from heli_twin.recording import read_log
    from heli_twin.studies.columns import COMPLETED, columns

    began = perf_counter()
    about = {"id": task.id, "host": socket.gethostname()}
    try:
        experiment = from_json(task.experiment)
        result = fly(experiment, log_dir=None)
        log = read_log(BytesIO(result.data or b""), WIRES)
    except ExperimentError as error:
        return Flown(about | {"outcome": "refused", "outcome_text": str(error)})
    row = about | columns(log, experiment) | {"real_time_factor": result.real_time_factor}
    score: Any = row.get(task.score)
    failed = row["outcome"] != COMPLETED
    high = not failed and task.keep_above is not None and score is not None and score > task.keep_above
    keep = task.keep_log or (failed and task.keep_failed) or high
    row["wall_time"] = perf_counter() - began
    return Flown(row, result.data if keep else None)
