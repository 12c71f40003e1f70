"""Many machines: a Dask cluster, however it was started. The one module that knows Dask.

Each Dask worker flies its runs in processes of its own, so that a run which dies or hangs costs that run alone, as on one
machine; when a whole worker is lost, Dask flies its runs elsewhere.
"""

import multiprocessing
import threading
from concurrent.futures import Future
from functools import cache
from pathlib import Path
from typing import Any

from heli_twin.studies.engine import Trouble, Work
from heli_twin.studies.errors import StudyError
from heli_twin.studies.pebble_pool import PebblePool
from heli_twin.studies.work import Flown, Task

WAIT = "20s"
"""How long to look for a scheduler."""


class DaskCluster:
    """A running cluster.

    Args:
        address: Of its scheduler, such as `tcp://head:8786`, or the path of a scheduler file.
        timeout: A run that takes longer, s, is ended.
    """

    def __init__(self, address: str, timeout: float = 300.0) -> None:
        try:
            from distributed import Client
        except ImportError:
            raise StudyError("--scheduler needs Dask: pip install 'heli-twin[cluster]'") from None
        where = {"scheduler_file": address} if Path(address).is_file() else {"address": address}
        try:
            self._client: Any = Client(**where, timeout=WAIT, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            raise StudyError(f"no Dask scheduler answers at {address} ({error}): start one with `dask scheduler`") from None
        self._executor = self._client.get_executor(pure=False)
        self._timeout = timeout

    def workers(self) -> int:
        """One run a thread of each Dask worker, as many as there are now."""
        return sum(self._client.nthreads().values())

    def submit(self, work: Work, task: Task) -> "Future[Any]":
        """Send a run to the cluster."""
        return self._executor.submit(apart, work, task, self._timeout)

    def trouble(self, error: BaseException) -> Trouble:
        """What Dask gives up on."""
        return Trouble("killed", f"the cluster lost it: {type(error).__name__}: {error}")

    def __enter__(self) -> "DaskCluster":
        return self

    def __exit__(self, kind: object, *stopped: object) -> None:
        self._executor.shutdown(wait=False)
        self._client.close()


def apart(work: Work, task: Task, timeout: float) -> Flown | Trouble:
    """Fly a run on a Dask worker, in a process of its own."""
    pool = _pool(timeout)
    future = pool.submit(work, task)
    error = future.exception()
    return future.result() if error is None else pool.trouble(error)


_starting = threading.Lock()


def _pool(timeout: float) -> PebblePool:
    """The processes of this Dask worker."""
    with _starting:
        return _processes(timeout)


@cache
def _processes(timeout: float) -> PebblePool:
    from distributed import get_worker

    # A nanny's worker is a daemon, which Python forbids to have children; these end when their pipe does.
    multiprocessing.current_process().daemon = False
    return PebblePool(get_worker().state.nthreads, timeout)
