"""Many machines: a Dask cluster, however it was started. The one module that knows Dask.

Each Dask worker flies its runs in processes of its own, so that a run which dies or hangs costs that run alone, as on
one machine; when a whole worker is lost, Dask flies its runs elsewhere.
"""

import multiprocessing
from concurrent.futures import Future
from pathlib import Path
from time import sleep
from typing import Any
from uuid import uuid4

from distributed import Client, WorkerPlugin, get_worker

from heli_twin.errors import HeliTwinError
from heli_twin.workers.engine import Trouble, Work
from heli_twin.workers.pebble_pool import PebblePool
from heli_twin.workers.task import Flown, Task

WAIT = "20s"
"""How long to look for a scheduler."""
TRIES = 5
"""How often to speak to all workers at once, of which any may be dying."""


class DaskCluster:
    """A running cluster.

    Args:
        address: Of its scheduler, such as `tcp://head:8786`, or the path of a scheduler file.
        timeout: A run that takes longer, s, is ended.
    """

    def __init__(self, address: str, timeout: float = 300.0) -> None:
        where: dict[str, Any] = {"scheduler_file": address} if Path(address).is_file() else {"address": address}
        try:
            self._client: Any = Client(**where, timeout=WAIT, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            raise HeliTwinError(
                f"no Dask scheduler answers at {address} ({error}): start one with `dask scheduler`"
            ) from None
        self._name = f"heli_twin-{uuid4().hex[:8]}"
        self._prepare(Processes(timeout))
        self._executor = self._client.get_executor(pure=False)

    def _prepare(self, plugin: "Processes") -> None:
        """Give every worker its processes; one that dies on the way does not stop the others."""
        for left in reversed(range(TRIES)):
            try:
                self._client.register_plugin(plugin, name=self._name)
                return
            except OSError as error:
                if not left:
                    raise HeliTwinError(
                        f"the Dask cluster does not hold still ({error}): look at its workers' logs"
                    ) from None
                sleep(1.0)

    def workers(self) -> int:
        """One run a thread of each Dask worker, as many as there are now."""
        return sum(self._client.nthreads().values())

    def submit(self, work: Work, task: Task) -> "Future[Any]":
        """Send a run to the cluster."""
        return self._executor.submit(apart, self._name, work, task)

    def trouble(self, error: BaseException) -> Trouble:
        """What Dask gives up on."""
        return Trouble("killed", f"the cluster lost it: {type(error).__name__}: {error}")

    def __enter__(self) -> "DaskCluster":
        return self

    def __exit__(self, *stopped: object) -> None:
        self._executor.shutdown(wait=False)
        self._client.unregister_worker_plugin(self._name)
        self._client.close()


class Processes(WorkerPlugin):
    """What each Dask worker has while a study uses it: as many processes as it has threads, kept apart by pebble."""

    def __init__(self, timeout: float) -> None:
        self.timeout = timeout
        self.pool: PebblePool | None = None

    def setup(self, worker: Any) -> None:
        """Called by Dask on every worker, on those too that join later."""
        # A nanny's worker is a daemon, which Python forbids to have children; these end when their pipe does.
        multiprocessing.current_process().daemon = False
        self.pool = PebblePool(worker.state.nthreads, self.timeout)

    def teardown(self, worker: Any) -> None:
        """Called by Dask when the study or the worker is over."""
        if self.pool is not None:
            self.pool.__exit__()


def apart(plugin: str, work: Work, task: Task) -> Flown | Trouble:
    """Fly a run on a Dask worker, in a process of its own."""
    processes: Any = get_worker().plugins[plugin]
    pool: PebblePool = processes.pool
    future = pool.submit(work, task)
    error = future.exception()
    return future.result() if error is None else pool.trouble(error)
