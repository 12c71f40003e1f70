"""One loop over futures, whatever flies them: a bounded window in flight, a second try, and no run can hurt another."""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from typing import Any, NamedTuple, Protocol

from heli_twin.workers.task import Flown, Task

DEPTH = 3
"""Runs in flight a worker: enough to keep it busy, few enough to lose little."""
TRIES = 2

Work = Callable[[Task], Flown]


class Trouble(NamedTuple):
    """A run that brought no row back."""

    outcome: str
    """`killed` (its process died), `hung` (it took too long) or `error` (it raised)."""
    text: str
    """One sentence."""


class Backend(Protocol):
    """What flies runs. A context manager: leaving it stops whatever is still flying."""

    def workers(self) -> int:
        """How many runs fly at the same time now."""
        ...

    def submit(self, work: Work, task: Task) -> "Future[Any]":
        """Fly a run somewhere else. The future gives Flown or Trouble, or raises what became of it."""
        ...

    def trouble(self, error: BaseException) -> Trouble:
        """What an exception of a future means."""
        ...

    def __enter__(self) -> "Backend": ...

    def __exit__(self, *stopped: object) -> None: ...


class Done(NamedTuple):
    """One run that is over."""

    task: Task
    result: Flown | Trouble
    tries: int


def flown(backend: Backend, work: Work, tasks: Iterable[Task]) -> Iterator[Done]:
    """Fly tasks, and give them back as they end, in any order.

    Tasks are drawn when there is room for them. One that brings no row back flies once more before that is its result.
    """
    waiting = iter(tasks)
    again: list[tuple[Task, int]] = []
    flying: dict[Future[Any], tuple[Task, int]] = {}
    more = True
    while more or again or flying:
        room = DEPTH * max(1, backend.workers()) - len(flying)
        while room > 0 and (again or more):
            task, tries = again.pop() if again else (next(waiting, None), 0)
            if task is None:
                more = False
                continue
            flying[backend.submit(work, task)] = (task, tries + 1)
            room -= 1
        for future in wait(flying, timeout=PATIENCE, return_when=FIRST_COMPLETED).done:
            task, tries = flying.pop(future)
            result = _result(backend, future)
            if isinstance(result, Trouble) and tries < TRIES:
                again.append((task, tries))
            else:
                yield Done(task, result, tries)


PATIENCE = 5.0
"""s: how often to look whether workers have joined or left."""


def _result(backend: Backend, future: "Future[Any]") -> Flown | Trouble:
    error = future.exception() if not future.cancelled() else Trouble("killed", "it was called off")
    if isinstance(error, Trouble):
        return error
    return backend.trouble(error) if error is not None else future.result()
