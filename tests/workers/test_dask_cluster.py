import os
import signal
import warnings

import hooks
import pytest

from heli_twin.studies.campaign import embedded, run_study
from heli_twin.studies.columns import MEASURED_COLUMNS
from heli_twin.studies.results import rows_of
from heli_twin.studies.study import study_of, study_tree

distributed = pytest.importorskip("distributed")
pytestmark = pytest.mark.filterwarnings("ignore")


@pytest.fixture(scope="module")
def cluster():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None, "host": "127.0.0.1"}
        with distributed.LocalCluster(**options) as cluster:
            yield cluster


def on(cluster):
    from heli_twin.workers.dask_cluster import DaskCluster

    return lambda plan, timeout: DaskCluster(cluster.scheduler_address, timeout)


def determined(row):
    """What a flight's experiment determines, the digest of its every message included."""
    return {key: value for key, value in row.items() if not key.startswith(MEASURED_COLUMNS)}


def test_a_cluster_brings_the_same_rows_as_one_machine(small, cluster, tmp_path):
    run_study(small, tmp_path / "here", backend=lambda plan, timeout: embedded(plan, timeout, 2))
    run_study(small, tmp_path / "there", backend=on(cluster))
    here, there = ([determined(row) for row in rows_of(tmp_path / where)] for where in ("here", "there"))
    assert len(here) == 6
    assert here == there


def test_a_poison_run_costs_the_cluster_that_run_alone(small, cluster, tmp_path):
    before = set(cluster.workers)
    count = run_study(small, tmp_path, backend=on(cluster), work=hooks.poison)
    assert (count.done, count.failed) == (6, {"killed": 2})
    assert set(cluster.workers) == before


def test_a_lost_worker_costs_no_row(small, cluster, tmp_path):
    study = study_of(study_tree(small) | {"replicates": 8})
    victims = [worker.process.pid for worker in cluster.workers.values()][:1]

    def kill(progress):
        if progress.flown >= 3 and victims:
            os.kill(victims.pop(), signal.SIGKILL)
            cluster.scale(3)

    count = run_study(study, tmp_path, backend=on(cluster), work=hooks.slowly, watch=kill)
    assert not victims
    assert (count.done, count.failed) == (24, {})
