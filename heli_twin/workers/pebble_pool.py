"""All cores of this machine: processes by pebble, of which each can die, hang or leak without harm to the others."""

import multiprocessing
import os
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from pebble import ProcessExpired, ProcessPool

from heli_twin.workers.engine import Trouble, Work
from heli_twin.workers.task import Task

FLIGHTS_A_PROCESS = 200
"""After so many a worker makes room for a fresh one, whatever its libraries have leaked."""
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")
PRELOADED = ["heli_twin.mission", "heli_twin.studies.columns", "mujoco", "proxsuite", "numpy", "heli_twin.studies.work"]
"""Loaded once in the process that workers are forked from; it never starts a thread or flies."""


class PebblePool:
    """A pool of processes.

    Args:
        processes: How many; None for one a core.
        timeout: A run that takes longer, s, is ended.
    """

    def __init__(self, processes: int | None = None, timeout: float = 300.0) -> None:
        self._processes = processes or len(os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else [0])
        self._timeout = timeout
        for name in ONE_THREAD:
            os.environ.setdefault(name, "1")
        self._pool = self._new()

    def workers(self) -> int:
        """One run a process."""
        return self._processes

    def submit(self, work: Work, task: Task) -> "Future[Any]":
        """Queue a run; a pool that broke while idle is replaced."""
        try:
            return self._pool.schedule(work, args=(task,), timeout=self._timeout)
        except RuntimeError:
            self._pool.stop()
            self._pool = self._new()
            return self._pool.schedule(work, args=(task,), timeout=self._timeout)

    def trouble(self, error: BaseException) -> Trouble:
        """By what pebble says of a run that did not return."""
        if isinstance(error, ProcessExpired):
            return Trouble("killed", f"its process died ({_exit(error.exitcode)})")
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
        # A process forked from this one could inherit a lock that a thread holds.
        methods = multiprocessing.get_all_start_methods()
        context: Any = multiprocessing.get_context("forkserver" if "forkserver" in methods else "spawn")
        if "forkserver" in methods:
            context.set_forkserver_preload(PRELOADED)
        return ProcessPool(max_workers=self._processes, max_tasks=FLIGHTS_A_PROCESS, context=context)


def _exit(code: int | None) -> str:
    """An exit code as a person knows it."""
    import signal

    if code is not None and code < 0:
        return signal.Signals(-code).name
    return f"exit code {code}"
