"""Several flights at a time, one a process: for work that flies a handful and keeps nothing but their results."""

import os
import signal
import threading
from collections.abc import Callable, Generator, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from typing import Any

Run = Callable[[Callable[[Any], Any], Sequence[Any]], Iterable[Any]]
"""From a function and values to its results on them, in their order."""


@contextmanager
def fleet(cores: int | None = None) -> Generator[Run]:
    """Processes for as long as the context lasts; Ctrl-C and SIGTERM end them.

    The function that they are given stands at the top of a module, or is a `functools.partial` of one that does; what
    it raises is raised here.

    Args:
        cores: How many; None for as many as this process may use, 1 to work in this process itself.
    """
    cores = cores or _cores()
    if cores == 1:
        yield map
        return
    # Forked, a worker would inherit threads that are not there.
    pool = ProcessPoolExecutor(cores, mp_context=get_context("spawn"))
    with stoppable():
        try:
            yield pool.map
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _cores() -> int:
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity else os.cpu_count() or 1


@contextmanager
def stoppable() -> Generator[None]:
    """Let SIGTERM stop what is inside as Ctrl-C does: by a KeyboardInterrupt, on whose way out pools end their workers.

    A batch system asks with SIGTERM; a shell's background job ignores Ctrl-C unless told. Handlers that a program has
    set itself stay, and outside the main thread nothing changes.
    """
    unheard = (signal.SIG_DFL, signal.SIG_IGN)
    asked = (signal.SIGTERM, signal.SIGINT) if threading.current_thread() is threading.main_thread() else ()
    before = {number: found for number in asked if (found := signal.getsignal(number)) in unheard}
    for number in before:
        signal.signal(number, signal.default_int_handler)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
