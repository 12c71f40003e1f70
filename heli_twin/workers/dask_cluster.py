"""Many machines: a Dask cluster, however it was started. The one module that imports Dask.

Each Dask worker flies its runs in processes of its own, so that a run that dies or hangs costs that run alone, as on
one machine; when a whole worker is lost, Dask flies its runs on another.
"""

import json
import multiprocessing
from concurrent.futures import Future
from pathlib import Path
from time import sleep
from typing import Any
from uuid import uuid4

from distributed import Client, Security, WorkerPlugin, get_worker

from heli_twin.errors import HeliTwinError
from heli_twin.workers.engine import Trouble, Work
from heli_twin.workers.pebble_pool import PebblePool
from heli_twin.workers.task import Flown, Task

CONNECT_TIMEOUT = "20s"
"""Time to look for a scheduler."""
PREPARE_TRIES = 5
"""Attempts to address all workers at once, any of which may be about to die."""
PREPARE_PAUSE_S = 1.0
"""Between two such tries."""


class DaskCluster:
    """A running cluster.

    A Dask scheduler and its workers run whatever they are sent. With `tls://` they listen to holders of a certificate
    only, and the certificates are those of Dask's configuration, `distributed.comm.tls`.

    Args:
        address: Of its scheduler, such as `tcp://head:8786` or `tls://head:8786`, or the path of a scheduler file.
        timeout: A run that takes longer is ended, s.

    Raises:
        HeliTwinError: No scheduler answers, certificates are missing, or its workers cannot be prepared.
    """

    def __init__(self, address: str, timeout: float = 300.0) -> None:
        address = _read_address(Path(address)) if Path(address).is_file() else address
        _check_encryption(address)
        try:
            self._client: Any = Client(address, timeout=CONNECT_TIMEOUT, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            raise HeliTwinError(
                f"no Dask scheduler answers at {address} ({error}): start one with `dask scheduler`"
            ) from None
        self._name = f"heli_twin-{uuid4().hex[:8]}"
        self._prepare(WorkerProcesses(timeout))
        self._executor = self._client.get_executor(pure=False)

    def _prepare(self, plugin: "WorkerProcesses") -> None:
        """Give every Dask worker its processes; one that dies meanwhile does not stop the others."""
        for left in reversed(range(PREPARE_TRIES)):
            try:
                self._client.register_plugin(plugin, name=self._name)
                return
            except OSError as error:
                if not left:
                    raise HeliTwinError(
                        f"the workers of the Dask cluster keep failing ({error}): look at their logs"
                    ) from None
                sleep(PREPARE_PAUSE_S)

    def workers(self) -> int:
        """One run per thread of each Dask worker, for as many workers as there are now."""
        return sum(self._client.nthreads().values())

    def submit(self, work: Work, task: Task) -> "Future[Any]":
        """Send a run to the cluster."""
        return self._executor.submit(fly_in_own_process, self._name, work, task)

    def trouble(self, error: BaseException) -> Trouble:
        """Translate an exception with which Dask gives up a run."""
        return Trouble("killed", f"the cluster lost it: {type(error).__name__}: {error}")

    def __enter__(self) -> "DaskCluster":
        return self

    def __exit__(self, *stopped: object) -> None:
        self._executor.shutdown(wait=False)
        self._client.unregister_worker_plugin(self._name)
        self._client.close()


def _read_address(scheduler_file: Path) -> str:
    try:
        return str(json.loads(scheduler_file.read_text())["address"])
    except (OSError, ValueError, KeyError, TypeError):
        raise HeliTwinError(f"{scheduler_file} is no scheduler file of Dask: give one, or an address") from None


def _check_encryption(address: str) -> None:
    """Refuse what a Dask client would only find out by hanging."""
    try:
        security: Any = Security()
        has_certificates = security.get_connection_args("client")["ssl_context"] is not None
    except (OSError, TypeError, ValueError) as error:
        raise HeliTwinError(
            f"the certificates in Dask's configuration, distributed.comm.tls, cannot be used: {error}"
        ) from None
    is_tls = address.startswith("tls://")
    if is_tls and not has_certificates:
        raise HeliTwinError(
            f"{address} needs certificates: set ca-file, client.cert and client.key in Dask's configuration under"
            " distributed.comm.tls"
        )
    if security.require_encryption and not is_tls:
        raise HeliTwinError(f"Dask's configuration requires encryption, and {address} has none: use tls://HOST:PORT")


class WorkerProcesses(WorkerPlugin):
    """The processes of a Dask worker while a study uses it: as many as it has threads, kept apart by pebble."""

    def __init__(self, timeout: float) -> None:
        self.timeout = timeout
        self.pool: PebblePool | None = None

    def setup(self, worker: Any) -> None:
        """Called by Dask on every worker, also on one that joins later."""
        # A nanny's worker is a daemon, which Python forbids to have children; these end when their worker does.
        multiprocessing.current_process().daemon = False
        self.pool = PebblePool(worker.state.nthreads, self.timeout)

    def teardown(self, worker: Any) -> None:
        """Called by Dask when the study or the worker ends."""
        if self.pool is not None:
            self.pool.__exit__()


def fly_in_own_process(plugin: str, work: Work, task: Task) -> Flown | Trouble:
    """Fly a run on a Dask worker, in a process of its own.

    Args:
        plugin: Name under which the worker's `WorkerProcesses` are registered.
        work: What to do with the task.
        task: What to fly.
    """
    processes: Any = get_worker().plugins[plugin]
    pool: PebblePool = processes.pool
    future = pool.submit(work, task)
    error = future.exception()
    return future.result() if error is None else pool.trouble(error)
