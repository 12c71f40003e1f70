"""A few flights at a time, one per process, for work that keeps nothing but their results."""

from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import contextmanager
from typing import Any

from heli_twin.workers.stopping import stoppable

ParallelMap = Callable[[Callable[[Any], Any], Sequence[Any]], Iterable[Any]]
"""From a function and values to the results of the function on them, in the order of the values."""


@contextmanager
def fleet(processes: int | None = None) -> Generator[ParallelMap]:
    """Processes for as long as the context lasts; Ctrl-C, SIGTERM and SIGHUP end them, and so does the end of this one.

    The function that they are given stands at the top level of a module, or is a `functools.partial` of one that does;
    an exception that it raises is raised here.

    Args:
        processes: How many; None for one a core, 1 to work in this process itself.
    """
    from heli_twin.workers.pebble_pool import PebblePool, cores

    with stoppable():
        if (processes or cores()) == 1:
            yield map
            return
        with PebblePool(processes, timeout=None) as pool:
            yield pool.map
