"""Several flights at a time, one a process: for work that flies a handful and keeps nothing but their results."""

import os
from collections.abc import Callable, Generator, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from typing import Any

Run = Callable[[Callable[[Any], Any], Sequence[Any]], Iterable[Any]]
"""From a function and values to its results on them, in their order."""


@contextmanager
def fleet(cores: int | None = None) -> Generator[Run]:
    """Processes for as long as the context lasts.

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
    try:
        yield pool.map
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _cores() -> int:
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity else os.cpu_count() or 1
