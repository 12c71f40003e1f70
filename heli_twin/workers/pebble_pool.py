"""All cores of this machine: processes by pebble, each of which can die, hang or leak without harm to the others."""

import multiprocessing
import os
import signal
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import forkserver
from typing import Any

from pebble import CONSTS, ProcessExpired, ProcessPool
from threadpoolctl import threadpool_limits

from heli_twin.errors import HeliTwinError
from heli_twin.workers.engine import Trouble
from heli_twin.workers.stopping import end_with_parent

CONSTS.term_timeout = 0.1
"""Time that pebble gives a worker to end, s, before it kills it, one after the other; nothing is lost with a worker."""
RUNS_PER_PROCESS = 200
"""After so many runs a process is replaced by a fresh one, whatever its libraries have leaked."""
THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")
PRELOADED_MODULES = [
    "heli_twin.workers.quiet_start",
    "heli_twin.mission",
    "heli_twin.studies.columns",
    "heli_twin.studies.work",
    "mujoco",
    "numpy",
    "proxsuite",
]
"""Imported once in the process from which workers are forked; it never starts a thread or flies."""


class PebblePool:
    """A pool of processes, which end with the context, and whenever this process dies.

    Args:
        processes: How many; None for one a core.
        timeout: A run that takes longer is ended, s; None for no limit.
    """

    def __init__(self, processes: int | None = None, timeout: float | None = 300.0) -> None:
        self._processes = processes or cores()
        self._timeout = timeout
        self._pool = self._new()

    def workers(self) -> int:
        """One run per process."""
        return self._processes

    def submit(self, work: Callable[[Any], Any], task: Any) -> "Future[Any]":
        """Queue a run; a pool that broke while it was idle is replaced."""
        try:
            return self._pool.schedule(work, args=(task,), timeout=self._timeout)
        except RuntimeError:
            self._pool.stop()
            self._pool = self._new()
            return self._pool.schedule(work, args=(task,), timeout=self._timeout)

    def map(self, work: Callable[[Any], Any], values: Iterable[Any]) -> Iterator[Any]:
        """Apply a function to values at the same time, and yield the results in the order of the values.

        Raises:
            HeliTwinError: A process died. What the function itself raises is raised here too.
        """
        for future in [self.submit(work, value) for value in values]:
            try:
                result = future.result()
            except (ProcessExpired, BrokenProcessPool) as error:
                text = self.trouble(error).text
                raise HeliTwinError(f"a flight was lost, {text}: free some memory and run it again") from None
            yield result

    def trouble(self, error: BaseException) -> Trouble:
        """Translate what pebble says of a run that did not return."""
        if isinstance(error, ProcessExpired):
            return Trouble("killed", f"its process died ({_exit_text(error.exitcode)})")
        if isinstance(error, TimeoutError):
            return Trouble("hung", f"it was not over after {self._timeout:g} s")
        if isinstance(error, BrokenProcessPool):
            return Trouble("killed", "its process could not be started, or died")
        return Trouble("error", f"{type(error).__name__}: {error}")

    def __enter__(self) -> "PebblePool":
        return self

    def __exit__(self, *stopped: object) -> None:
        self._pool.stop()
        self._pool.join()

    def _new(self) -> ProcessPool:
        begin_to_load()
        context: Any = multiprocessing.get_context(_start_method())
        return ProcessPool(self._processes, max_tasks=RUNS_PER_PROCESS, initializer=_begin_worker, context=context)


def begin_to_load() -> None:
    """Let another process load what the workers need, and do not wait for it; a pool finds it where it has begun."""
    if _start_method() == "forkserver":
        forkserver.set_forkserver_preload(PRELOADED_MODULES)
        with _single_threaded_environment():
            forkserver.ensure_running()


def _start_method() -> str:
    """A process forked from this one could inherit a lock that another thread holds."""
    return "forkserver" if "forkserver" in multiprocessing.get_all_start_methods() else "spawn"


def cores() -> int:
    """Return the number of cores that this process may use."""
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity else os.cpu_count() or 1


def _begin_worker() -> None:
    """Prepare a worker process."""
    end_with_parent()
    threadpool_limits(limits=1)


@contextmanager
def _single_threaded_environment() -> Generator[None]:
    """Let a process that is started inside load numerical libraries without threads; afterwards all is as before."""
    added = [name for name in THREAD_VARIABLES if name not in os.environ]
    os.environ.update(dict.fromkeys(added, "1"))
    try:
        yield
    finally:
        for name in added:
            del os.environ[name]


def _exit_text(code: int | None) -> str:
    """An exit code as a person knows it."""
    if code is not None and code < 0:
        return signal.Signals(-code).name
    return f"exit code {code}"
