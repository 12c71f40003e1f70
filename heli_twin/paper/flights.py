"""The flights of `heli-twin paper`: what came of them, and flying them on all cores."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property
from itertools import chain
from pathlib import Path

import numpy as np

from controllers.signals import Array
from heli_twin.experiment.text import load
from heli_twin.experiment.tree import canonical_json
from heli_twin.metrics.tracking import SETTLING_S
from heli_twin.paper.cases import CASES, LAB
from heli_twin.recording import Log, read_log
from heli_twin.studies.columns import COMPLETED
from heli_twin.studies.designs import Row
from heli_twin.workers.engine import Work
from heli_twin.workers.task import Flown, Task


class Flights:
    """The flown cases: a row for each flight, and the log of each case's first flight."""

    def __init__(self, folder: Path, rows: Mapping[str, Sequence[Row]]) -> None:
        self.folder, self.rows = folder, rows

    def values(self, case: str, metric: str) -> Array:
        """A metric (n,) of the flights of a case, in the order of their seeds; NaN where one failed."""
        values = [row.get(metric) if row["outcome"] == COMPLETED else None for row in self.rows[case]]
        return np.array([np.nan if value is None else value for value in values], np.float64)

    def rms(self, case: str, axis: str) -> float:
        """Root of the mean squared error over all flights of a case, m or rad."""
        return float(np.sqrt(np.mean(self.values(case, f"mse.{axis}"))))

    def failed(self, case: str) -> int:
        """Return the number of flights of a case that did not complete."""
        return sum(row["outcome"] != COMPLETED for row in self.rows[case])

    def path(self, case: str) -> Path:
        """The log of its first flight."""
        return self.folder / "logs" / f"{case}-seed0.mcap"

    def log(self, case: str) -> Log:
        """The first flight of a case."""
        if case not in self._logs:
            self._logs[case] = read_log(self.path(case))
        return self._logs[case]

    @cached_property
    def _logs(self) -> dict[str, Log]:
        return {}


def tasks(seeds: int, duration: float, names: Sequence[str]) -> Iterator[Task]:
    """The flights of some cases; the log of the first of each is kept."""
    for name in names:
        case = CASES[name]
        for seed in case.seeds(seeds):
            text = canonical_json(case.experiment(seed, duration))
            yield Task(f"{name}-seed{seed}", text, "", keep_log=seed == 0, keep_failed=False, keep_above=None)


def identification_tasks() -> Iterator[Task]:
    """The flights of `heli-twin identify`; all logs are kept."""
    from heli_twin.identification.flights import experiments

    for number, experiment in enumerate(experiments(load(LAB))):
        text = canonical_json(experiment)
        yield Task(f"identify-{number}", text, "", keep_log=True, keep_failed=True, keep_above=None)


def fly_all(
    folder: Path, jobs: Sequence[tuple[Work, Sequence[Task]]], progress: Callable[[], None] = lambda: None
) -> dict[str, Row]:
    """Fly on all cores; logs go to `folder/logs`. Ctrl-C and SIGTERM end the workers.

    Args:
        folder: For the logs.
        jobs: What a worker does with a task, such as `fly_task`, and the tasks.
        progress: Called when a task is done.

    Returns:
        The row of each flight, by the id of its task. One whose process died is a failed flight.
    """
    from heli_twin.whole_file import write_whole
    from heli_twin.workers.engine import Trouble, flown
    from heli_twin.workers.pebble_pool import PebblePool
    from heli_twin.workers.stopping import stoppable

    rows: dict[str, Row] = {}
    with stoppable(), PebblePool() as pool:
        for done in chain.from_iterable(flown(pool, work, tasks) for work, tasks in jobs):
            if isinstance(done.result, Trouble):
                rows[done.task.id] = {"outcome": done.result.outcome, "outcome_text": done.result.text}
            else:
                rows[done.task.id] = done.result.row
                if done.result.log is not None:
                    write_whole(folder / "logs" / f"{done.task.id}.mcap", done.result.log)
            progress()
    return rows


def fly_task(task: Task) -> Flown:
    """The work of a worker process: one flight, its metrics and its yaw activity."""
    from heli_twin.experiment.tree import from_json
    from heli_twin.mission import fly
    from heli_twin.studies.columns import columns

    experiment = from_json(task.experiment)
    result = fly(experiment, log_dir=None)
    row = columns(result.log, experiment) | activity(result.log)
    return Flown(row, result.data if task.keep_log else None)


def activity(log: Log) -> dict[str, float]:
    """Means and deviations of the planar inputs; rms of the yaw input and of its step; all from `SETTLING_S` on."""
    u = log.sent.u[1e-9 * log.sent.time >= SETTLING_S]
    if len(u) < 2:
        return {}
    return {
        "mean.u_x": float(u[:, 0].mean()),
        "mean.u_y": float(u[:, 1].mean()),
        "std.u_x": float(u[:, 0].std()),
        "std.u_y": float(u[:, 1].std()),
        "rms.u_yaw": float(np.sqrt(np.mean(u[:, 3] ** 2))),
        "step.u_yaw": float(np.sqrt(np.mean(np.diff(u[:, 3]) ** 2))),
    }
