"""A log whose flight is killed, whose disk is full, or whose folder goes away.

`KILLS=100 pytest tests/recording/test_survival.py -k kill -s` kills a hundred flights and prints what each lost.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from disks import disk_of

from controllers.signals import Pose
from heli_twin.cli import main
from heli_twin.experiment.text import load
from heli_twin.experiment.tree import canonical_json
from heli_twin.mission import Result, fly
from heli_twin.recording import LogError, Recorder, read_log, recover
from heli_twin.recording.wires import FLUSH_PERIOD_NS

Record = Callable[..., Recorder]

KILLS = int(os.environ.get("KILLS", "5"))
KILLED = Path(__file__).with_name("killed_flight.py")
HALF_A_SECOND = 500_000_000
STEP = 20_000_000
"""The control period, ns: messages of the step under way are not told yet."""


# --- killed


@pytest.mark.parametrize("kill", range(KILLS))
def test_a_kill_at_any_moment_loses_at_most_half_a_second(kill: int, tmp_path: Path) -> None:
    steps = int(np.random.default_rng(kill).integers(1, 1500))
    told = _killed_after(steps, tmp_path)
    (part,) = tmp_path.glob("*.part")
    with pytest.raises(LogError, match="interrupted: run `heli-twin recover`"):
        read_log(part)
    log = read_log(recover(part))
    times = [messages.times[-1] for messages in log.messages.values() if len(messages.times)]
    last = max(times, default=0)
    print(f"killed after {1e-9 * told:.2f} s, lost {1e-9 * (told - last):.2f} s")
    assert told - last <= HALF_A_SECOND
    assert log.experiment == canonical_json(load("ideal", ["duration=60", "trajectory=hover"]))
    assert (log.outcome, log.ending.time) == ("interrupted", last)
    assert log.metadata["python"] == ".".join(map(str, sys.version_info[:3]))


def _killed_after(steps: int, folder: Path) -> int:
    """Kill a flight once it has told of so many control steps; returns the last simulated time that it told, ns."""
    command = [sys.executable, KILLED, folder]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, env=os.environ | {"PYTHONPATH": ":".join(sys.path)}
    ) as flight:
        assert flight.stdout is not None
        for _ in range(steps):
            flight.stdout.readline()
        flight.kill()
        rest = flight.stdout.read().split()
    return int(rest[-1]) if rest else (steps - 1) * STEP


# --- the disk gives up


@pytest.fixture(scope="module")
def undisturbed() -> Result:
    return fly(load("ideal", ["duration=6"]), log_dir=None)


def unlogged(folder: Path, size: int) -> Result:
    with disk_of(size):
        return fly(load("ideal", ["duration=6"]), log_dir=folder)


@pytest.mark.parametrize("size", [90_000, 150_000, 299_000])
def test_a_full_disk_ends_the_file_and_not_the_flight(
    size: int, tmp_path: Path, undisturbed: Result, caplog: pytest.LogCaptureFixture
) -> None:
    result = unlogged(tmp_path, size)
    assert result.outcome == undisturbed.outcome
    assert result.flight_digest == undisturbed.flight_digest == result.log.digest
    summary, undisturbed_summary = result.summary(), undisturbed.summary()
    assert summary["rmse"] == undisturbed_summary["rmse"]
    assert (result.path, summary["log"]) == (None, None)
    assert [record.getMessage() for record in caplog.records] == [result.log_trouble] == [summary["log_trouble"]]
    assert re.search(r"any more at \d\.\d\d s \(File too large\): the flight goes on without it", result.log_trouble)
    (part,) = tmp_path.iterdir()
    assert f"`heli-twin recover {part}`" in result.log_trouble


@pytest.mark.parametrize("size", [90_000, 150_000, 299_000])
def test_what_was_written_before_the_disk_was_full_is_recovered(size: int, tmp_path: Path, undisturbed: Result) -> None:
    unlogged(tmp_path, size)
    (part,) = tmp_path.iterdir()
    log = read_log(recover(part))
    count = len(log.truth.time)
    assert count
    np.testing.assert_array_equal(log.truth.position, undisturbed.log.truth.position[:count])
    assert (log.outcome, log.experiment) == ("interrupted", undisturbed.log.experiment)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can mount")
def test_a_flight_onto_a_full_tmpfs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mount = ["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", str(tmp_path)]
    if subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("mounting is not allowed here")
    try:
        code = main(["fly", "ideal", "duration=6", "--log-dir", str(tmp_path), "--json"])
        summary = json.loads(capsys.readouterr().out)
        (part,) = tmp_path.iterdir()
        with pytest.raises(LogError, match="No space left on device"):
            recover(part)
        assert [*tmp_path.iterdir()] == [part]
    finally:
        subprocess.run(["umount", str(tmp_path)], check=True)
    assert (code, summary["outcome"], summary["log"]) == (1, "completed", None)
    assert "No space left on device" in summary["log_trouble"]


def test_a_folder_that_goes_away_costs_the_file_and_not_the_flight(tmp_path: Path) -> None:
    folder = tmp_path / "logs"
    result = fly(
        load("ideal", ["duration=3"]),
        log_dir=folder,
        progress=lambda t: t < 2 or shutil.rmtree(folder, ignore_errors=True),
    )
    assert result.outcome.kind == "completed"
    assert "No such file or directory" in result.log_trouble
    assert "recover" not in result.log_trouble
    assert len(result.log.truth.time) == 151


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="needs to find the open log")
def test_a_log_that_turns_read_only_costs_the_file_and_not_the_flight(tmp_path: Path, undisturbed: Result) -> None:
    def lock(t: float) -> None:
        if round(t, 3) == 3.0:
            (part,) = tmp_path.iterdir()
            (log,) = (fd for fd in Path("/proc/self/fd").iterdir() if fd.is_symlink() and fd.readlink() == part)
            with part.open("rb") as readable:
                os.dup2(readable.fileno(), int(log.name))

    result = fly(load("ideal", ["duration=6"]), log_dir=tmp_path, progress=lock)
    assert (result.outcome, result.flight_digest) == (undisturbed.outcome, undisturbed.flight_digest)
    assert "the flight goes on without it" in result.log_trouble
    (part,) = tmp_path.iterdir()
    # Of the last half second before it was locked nothing had to be written yet.
    assert read_log(recover(part)).truth.time[-1] >= 3 * 10**9 - FLUSH_PERIOD_NS


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="needs to find the open log")
def test_a_disk_that_dies_for_good_is_told_in_one_sentence(tmp_path: Path) -> None:
    """It takes nothing and gives nothing back, so that there is nothing to measure the flight by."""

    def die(t: float) -> None:
        if round(t, 3) == 3.0:
            (part,) = tmp_path.iterdir()
            (log,) = (fd for fd in Path("/proc/self/fd").iterdir() if fd.is_symlink() and fd.readlink() == part)
            folder = os.open("/", os.O_RDONLY)
            os.dup2(folder, int(log.name))
            os.close(folder)

    with pytest.raises(LogError, match=r"is lost \(.*\): record to another disk"):
        fly(load("ideal", ["duration=6"]), log_dir=tmp_path, progress=die)


def test_a_disk_that_is_full_from_the_start_stops_the_flight_and_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="make room or record to another folder"):
        unlogged(tmp_path, 10)
    assert not [*tmp_path.iterdir()]


# --- how it grows


def test_memory_does_not_grow_with_the_flight(tmp_path: Path) -> None:
    def seconds(start: int, end: int) -> None:
        for t in range(start * 10**9, end * 10**9, 5_000_000):
            recorder.pose(t, Pose(t, rng.standard_normal(3), rng.standard_normal(4)))

    rng = np.random.default_rng(0)
    recorder = Recorder(tmp_path / "run.mcap")
    seconds(0, 5)
    tracemalloc.start()
    before, _ = tracemalloc.get_traced_memory()
    seconds(5, 65)
    after, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    recorder.close("completed", 65 * 10**9)
    # The index has to grow: an entry of at most 300 bytes for each chunk, and Python allots an eighth ahead.
    assert after - before < 60 * 10**9 // FLUSH_PERIOD_NS * 300 * 9 / 8 + 20_000


def test_the_measures_of_a_flight_need_no_whole_log(undisturbed: Result) -> None:
    fresh = Result(**{name: getattr(undisturbed, name) for name in Result.__dataclass_fields__})
    summary = fresh.summary()
    assert "log" not in fresh.__dict__
    assert summary == undisturbed.summary()
    assert summary["qp_status"]
