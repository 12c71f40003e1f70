"""Several flights at a time, one a process: for work that flies a handful and keeps nothing but their results."""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import TypeVar

Item = TypeVar("Item")
T = TypeVar("T")


def fleet(work: Callable[[Item], T], items: Sequence[Item], cores: int | None = None) -> Iterator[T]:
    """The result of `work` on each item, in their order.

    Args:
        work: A function at the top of a module, or a `functools.partial` of one; what it raises is raised here.
        items: What to fly, as values.
        cores: Processes; None for as many as there are cores.
    """
    cores = min(len(items), cores or _cores())
    if cores <= 1:
        yield from map(work, items)
        return
    # Forked, a worker would inherit threads that are not there.
    with ProcessPoolExecutor(cores, mp_context=get_context("spawn")) as pool:
        futures = [pool.submit(work, item) for item in items]
        try:
            for future in futures:
                yield future.result()
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def _cores() -> int:
    """Cores that this process may use."""
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity else os.cpu_count() or 1
