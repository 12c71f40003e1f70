"""Running a study: new runs are flown, each row is stored at once, and the wanted logs are kept."""

import os
import platform
import socket
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import partial
from heapq import heappop, heappush
from itertools import islice
from pathlib import Path
from typing import Any

from controllers.programs import to_send
from heli_twin.experiment.named_classes import own_sources
from heli_twin.experiment.scenarios import MOST_SHIPS
from heli_twin.experiment.several_text import EVERY
from heli_twin.studies.columns import COMPLETED, SCORED
from heli_twin.studies.designs import Point, Row
from heli_twin.studies.errors import StudyError
from heli_twin.studies.flight_code import changes_of, code_hash, code_parts, file_hash
from heli_twin.studies.plan import PlannedFlight, StudyPlan, plan_of
from heli_twin.studies.resume import check_code
from heli_twin.studies.space import value_at, varied
from heli_twin.studies.store import Store
from heli_twin.studies.study import Study, study_tree
from heli_twin.studies.work import OTHER_CODE, fly_task, fly_with_code
from heli_twin.whole_file import write_whole
from heli_twin.workers.engine import Backend, Done, Trouble, Work, flown
from heli_twin.workers.stopping import stoppable
from heli_twin.workers.task import Task

RUNS_PER_TRANSACTION = 256
"""Runs looked up and noted in the store at a time."""


@dataclass
class StudyProgress:
    """The progress of a study."""

    total: int
    """Runs it may need."""
    done: int = 0
    """Finished runs, with those of earlier launches."""
    flown: int = 0
    """Runs flown by this launch."""
    saved: int = 0
    """Flights of `replicates` that a `half_width` made needless."""
    failed: dict[str, int] = field(default_factory=dict)
    """Numbers of this launch's failed runs by outcome."""


def run_study(
    study: Study,
    out: Path,
    *,
    backend: Callable[[StudyPlan, float], Backend] | None = None,
    watch: Callable[[StudyProgress], None] = lambda progress: None,
    again: bool = False,
    accept_old: bool = False,
    work: Work = fly_task,
) -> StudyProgress:
    """Fly what a study asks for and has not been flown yet, and write `results.parquet` at the end.

    Runs that were invalid, since the process of their control law failed, are flown again each time.

    It may be stopped at any time, in any way, and running it again goes on; Ctrl-C and SIGTERM raise a
    KeyboardInterrupt when the workers are gone. In a program of your own, call it under
    `if __name__ == "__main__":`, since worker processes load the program too.

    Args:
        study: What to fly.
        out: Folder for the results.
        backend: Makes the backend from the plan and the timeout, s; None for all cores of this machine.
        watch: Called with the progress.
        again: Fly the runs again that were killed, hung or raised, and those that other code flew.
        accept_old: Keep the rows of runs that other code flew.
        work: What a worker does with a run.

    Raises:
        HeliTwinError: The study is wrong, the folder is in use, or other code flew some of its runs: nothing has been
            flown. Or the disk is full, or a worker has other code: what was flown before is kept.
    """
    from heli_twin.studies.results import RESULTS, write_parquet

    plan = plan_of(study)
    with stoppable(), Store(out, write=True) as store:
        campaign = Campaign(plan, store, out, work, watch)
        check_code(plan, store, campaign.code, again=again, accept_old=accept_old)
        store.begin(campaign.about())
        store.forget_invalid()
        if again:
            store.forget_troubles()
        with (backend or embedded)(plan, time_allowed(plan)) as fleet:
            campaign.run(fleet)
        write_parquet(store, out / RESULTS)
        store.finish()
    return campaign.progress


def embedded(plan: StudyPlan, timeout: float, processes: int | None = None) -> Backend:
    """A pool of processes on this machine; None for one on each core."""
    from heli_twin.workers.pebble_pool import PebblePool

    return PebblePool(processes, timeout)


def time_allowed(plan: StudyPlan) -> float:
    """Return the time after which a flight counts as hung, s."""
    tree = varied(plan.space.base, {})
    most = MOST_SHIPS if EVERY in tree else 1
    return plan.study.timeout or 60 + 5 * value_at(tree, "duration") * most


class Campaign:
    """One launch of a study."""

    def __init__(
        self,
        plan: StudyPlan,
        store: Store,
        out: Path,
        work: Work = fly_task,
        watch: Callable[[StudyProgress], None] = lambda p: None,
    ) -> None:
        self.plan, self.store, self.out, self.work, self.watch = plan, store, out, work, watch
        self.progress = StudyProgress(plan.count())
        self._next_run = self._next_point = 0
        self._worst: list[float] = []
        """The worst scores of this launch, as a heap with the least of them first."""
        self._failures_kept = 0
        self._kept: set[str] = set()
        """Ids of the runs whose logs the design asks for."""
        self.code = store.code_of(file_hash()) or code_hash()

    def about(self) -> dict[str, Any]:
        """The facts about the study as a whole that the store keeps for the report."""
        from heli_twin.logbook import provenance

        facts = {f"with.{key}": value for key, value in provenance().items()}
        return facts | {
            "study": study_tree(self.plan.study),
            "base": self.plan.space.base,
            "planned": self.progress.total,
            "code": self.code,
            "host": socket.gethostname(),
            "cores": os.cpu_count(),
            "system": platform.platform(),
            "launched": datetime.now(UTC).isoformat(),
        }

    def run(self, backend: Backend) -> None:
        """Fly the design, batch by batch."""
        batches = self.plan.batches()
        points = next(batches, None)
        while points is not None:
            first = self._next_run
            self._batch(points, backend)
            answer: list[Row] = list(self.store.rows(first, self._next_run - 1)) if self.plan.adaptive else []
            try:
                points = batches.send(answer)
            except StopIteration:
                points = None
        if self.plan.study.half_width:
            self.progress.saved = self.plan.count() - self._next_run
        self.progress.total = self.progress.done
        self.store.note({"planned": self._next_run, "saved": self.progress.saved})
        self._prune()
        self.watch(self.progress)

    def _batch(self, points: Iterable[Point], backend: Backend) -> None:
        work = partial(fly_with_code, self.work, file_hash(), self.code)
        for done in flown(backend, work, self._tasks(points)):
            self._keep(done)
            self.watch(self.progress)

    def _tasks(self, points: Iterable[Point]) -> Iterator[Task]:
        """Yield the runs that are still to be flown, each once; all runs are noted in the store as wanted."""
        runs = self.plan.runs(self._counted(points), self._next_point)
        under_way: set[str] = set()
        while chunk := list(islice(runs, RUNS_PER_TRANSACTION)):
            self.store.ask(enumerate(chunk, self._next_run))
            self._kept |= {run.id for run in chunk if run.keep}
            for n, run in enumerate(chunk, self._next_run):
                if run.id in under_way or self.store.has(run.id):
                    self.progress.done += 1
                    continue
                under_way.add(run.id)
                yield self._task(n, run)
            self._next_run += len(chunk)
            self.watch(self.progress)

    def _counted(self, points: Iterable[Point]) -> Iterator[Point]:
        for point in points:
            yield point
            self._next_point += 1

    def _task(self, n: int, run: PlannedFlight) -> Task:
        logs = self.plan.study.logs
        stride = max(1, -(-self.progress.total // logs.sampled)) if logs.sampled else 0
        return Task(
            id=run.id,
            experiment=run.experiment,
            score=self.plan.study.score,
            keep_log=run.keep or (bool(stride) and n % stride == stride // 2),
            keep_failed=self._failures_kept < logs.failed,
            keep_above=self._threshold(),
            own=own_sources(),
            programs=to_send(),
            requirements=self.plan.study.requirements,
        )

    def _threshold(self) -> float | None:
        """Return the score above which a flight may be one of the worst. It never falls."""
        wanted = self.plan.study.logs.worst
        if not wanted:
            return None
        return self._worst[0] if len(self._worst) == wanted else -1.0

    def _keep(self, done: Done) -> None:
        """Store a run that is over."""
        row, trouble = self._row(done)
        if row["outcome"] == OTHER_CODE:
            raise StudyError(
                f"the worker on {row['host']} has other code ({changes_of(code_parts(), row['parts'])}): install there"
                " what is installed here; what was flown before is kept"
            )
        completed = row["outcome"] == COMPLETED
        score = row.get(self.plan.study.score) if row["outcome"] in SCORED else None
        if not isinstance(done.result, Trouble) and done.result.log is not None:
            write_whole(self.out / "logs" / f"{done.task.id}.mcap", done.result.log)
            self._failures_kept += not completed
        if score is not None:
            heappush(self._worst, score)
            if len(self._worst) > self.plan.study.logs.worst:
                heappop(self._worst)
        self.store.add([(row, score, trouble)])
        self.progress.done += 1
        self.progress.flown += 1
        if not completed:
            failed = self.progress.failed
            failed[row["outcome"]] = failed.get(row["outcome"], 0) + 1

    def _row(self, done: Done) -> tuple[dict[str, Any], bool]:
        if isinstance(done.result, Trouble):
            text = done.result.text + (f", {done.tries} times" if done.tries > 1 else "")
            return {
                "id": done.task.id,
                "outcome": done.result.outcome,
                "outcome_text": text,
                "attempts": done.tries,
                "code": self.code,
            }, True
        return done.result.row | {"attempts": done.tries, "code": self.code}, False

    def _prune(self) -> None:
        """Delete the logs of flights that were among the worst only for a while."""
        logs = self.plan.study.logs
        stride = max(1, -(-self.plan.count() // logs.sampled)) if logs.sampled else 0
        keep = {run_id for run_id, _ in self.store.worst(logs.worst)} | set(self.store.failed(2**31)) | self._kept
        if stride:
            keep |= self.store.every(stride)
        for path in (self.out / "logs").glob("*.mcap"):
            if path.stem not in keep:
                path.unlink()
