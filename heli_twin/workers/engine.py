"""Runs a sequence of tasks on any backend: a bounded number at a time, a second try, and no run can harm another."""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from typing import Any, Literal, NamedTuple, Protocol

from heli_twin.workers.task import Flown, Task

RUNS_PER_WORKER = 3
"""Runs submitted per worker at one time: enough to keep it busy, few enough to lose little when it dies."""
MAX_TRIES = 2
"""Attempts to fly a run that brings no row back."""
POLL_PERIOD_S = 5.0
"""Time between two checks whether workers have joined or left."""


class Trouble(NamedTuple):
    """The reason why a run brought no row back."""

    outcome: Literal["killed", "hung", "error", "invalid"]
    """`killed`: its process died; `hung`: it took too long; `error`: it raised an exception; `invalid`: the process of
    its control law failed."""
    text: str
    """One sentence."""


Work = Callable[[Task], Flown | Trouble]


class Backend(Protocol):
    """Flies runs in other processes. A context manager: leaving it stops the runs that are still flying."""

    def workers(self) -> int:
        """Return the number of runs that can fly at the same time now."""
        ...

    def submit(self, work: Work, task: Task) -> "Future[Any]":
        """Fly a run in another process.

        Returns:
            A future with a `Flown` or a `Trouble`, or with the exception that ended the run.
        """
        ...

    def trouble(self, error: BaseException) -> Trouble:
        """Translate the exception of a future."""
        ...

    def __enter__(self) -> "Backend": ...

    def __exit__(self, *stopped: object) -> None: ...


class Done(NamedTuple):
    """A run that is over."""

    task: Task
    result: Flown | Trouble
    tries: int


def flown(backend: Backend, work: Work, tasks: Iterable[Task]) -> Iterator[Done]:
    """Fly tasks and yield them as they end, in any order.

    A task is taken from the iterable only when a worker has room for it. A run that brings no row back is flown once
    more; if that fails too, its `Trouble` is the result.

    Args:
        backend: Where to fly.
        work: What a worker does with a task; a function at the top level of a module, or a `functools.partial` of one.
        tasks: What to fly.
    """
    waiting = iter(tasks)
    again: list[tuple[Task, int]] = []
    flying: dict[Future[Any], tuple[Task, int]] = {}
    more = True
    while more or again or flying:
        room = RUNS_PER_WORKER * max(1, backend.workers()) - len(flying)
        while room > 0 and (again or more):
            task, tries = again.pop() if again else (next(waiting, None), 0)
            if task is None:
                more = False
                continue
            flying[backend.submit(work, task)] = (task, tries + 1)
            room -= 1
        for future in wait(flying, timeout=POLL_PERIOD_S, return_when=FIRST_COMPLETED).done:
            task, tries = flying.pop(future)
            result = _result(backend, future)
            if isinstance(result, Trouble) and tries < MAX_TRIES:
                again.append((task, tries))
            else:
                yield Done(task, result, tries)


def _result(backend: Backend, future: "Future[Any]") -> Flown | Trouble:
    if future.cancelled():
        return Trouble("killed", "it was cancelled")
    error = future.exception()
    return backend.trouble(error) if error is not None else future.result()
