"""Several processes of this machine: results in order, names that nobody else takes, and an untouched caller."""

import os
import signal
import time
from functools import partial

import hooks
import pytest
from threadpoolctl import threadpool_info

from heli_twin import HeliTwinError, read_log
from heli_twin.recording import LogExistsError, Recorder
from heli_twin.workers.fleet import fleet
from heli_twin.workers.pebble_pool import THREAD_VARIABLES, PebblePool
from heli_twin.workers.stopping import stoppable


def square(x):
    if x < 0:
        raise HeliTwinError(f"{x} is negative")
    return x * x


@pytest.mark.parametrize("processes", [1, 2])
def test_a_fleet_answers_in_order_and_raises_what_its_work_raises(processes):
    with fleet(processes) as run:
        assert list(run(square, [3, 1, 2])) == [9, 1, 4]
        with pytest.raises(HeliTwinError, match="-2 is negative"):
            list(run(square, [3, -2]))


def die(x):
    os.kill(os.getpid(), signal.SIGKILL)


def test_a_worker_that_dies_is_one_sentence():
    with fleet(2) as run, pytest.raises(HeliTwinError, match=r"its process died \(SIGKILL\)"):
        list(run(die, [1]))


def refuse_to_end(folder):
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    (folder / str(os.getpid())).touch()
    time.sleep(60)


def test_leaving_a_fleet_takes_seconds_whatever_its_workers_do(tmp_path):
    """Also for those who call it from Python, where no timer of a command ends the process."""
    with PebblePool(3, timeout=None) as pool:
        for _ in range(3):
            pool.submit(refuse_to_end, tmp_path)
        while len(list(tmp_path.iterdir())) < 3:
            time.sleep(0.01)
        left = time.monotonic()
    # 0.1 s for each that is asked in vain; twice and five times that for a busy machine.
    assert time.monotonic() - left < 3.0
    for file in tmp_path.iterdir():
        with pytest.raises(ProcessLookupError):
            os.kill(int(file.name), 0)


def threads(name):
    assert threadpool_info()
    return os.environ.get(name), max(library["num_threads"] for library in threadpool_info())


@pytest.mark.parametrize("mine", [None, "3"])
def test_workers_have_one_thread_and_the_caller_keeps_its_environment(mine, monkeypatch):
    for name in THREAD_VARIABLES:
        monkeypatch.delenv(name, raising=False)
    if mine:
        monkeypatch.setenv("OMP_NUM_THREADS", mine)
    before = dict(os.environ)
    with fleet(2) as run:
        assert dict(os.environ) == before
        assert {count for _, count in run(threads, THREAD_VARIABLES)} == {1}
    assert dict(os.environ) == before


def test_flights_that_start_in_the_same_second_all_keep_their_logs(tmp_path):
    with fleet(3) as run:
        logs = [log for logs in run(partial(hooks.fly_in_one_second, tmp_path), range(3)) for log in logs]
    assert len(logs) == len({name for name, _ in logs}) == len(list(tmp_path.iterdir())) == 30
    for name, digest in logs:
        assert read_log(tmp_path / name).digest == digest


def test_a_log_that_was_finished_in_the_meantime_is_not_overwritten(tmp_path):
    path = tmp_path / "run.mcap"
    path.write_bytes(b"the log of another flight")
    with pytest.raises(LogExistsError, match=r"run\.mcap exists already"):
        Recorder(path)
    assert [file.name for file in tmp_path.iterdir()] == ["run.mcap"]
    assert path.read_bytes() == b"the log of another flight"


def test_nohup_is_respected_and_other_signals_stop():
    handlers = {number: signal.getsignal(number) for number in (signal.SIGHUP, signal.SIGTERM)}
    try:
        for number in handlers:
            signal.signal(number, signal.SIG_IGN)
        with stoppable():
            signal.raise_signal(signal.SIGHUP)
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(signal.SIGTERM)
        signal.signal(signal.SIGHUP, signal.SIG_DFL)
        with stoppable(), pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGHUP)
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
