"""A command that is asked to end does so in one line, and leaves nothing running and nothing half-written."""

import os
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from random import Random
from uuid import uuid4

import numpy as np
import pytest
from readable import check_readable

from heli_twin import fly, load, read_log
from heli_twin.recording import recover

ROOT = Path(__file__).parents[1]
DEADLINE_S = 5.0
"""Time that a command may take to end; twice that on the shared machines of CI."""
MARK = "HELI_TWIN_TEST"
"""Variable that tells the processes of a test from others; it is inherited."""
KILLS = int(os.environ.get("KILLS", "100"))

COMMANDS = {
    "fly": ["fly", "ideal", "duration=600"],
    "refly": ["refly", "run.mcap", "duration=600"],
    "resolve": ["resolve", "run.mcap", "controller.kind=ltv_mpc", "controller.horizon=60"],
    "replay": ["replay", "run.mcap", "--save", "run.rrd"],
    "snapshot": ["snapshot", "run.mcap", "run.png"],
    "reestimate": ["reestimate", "run.mcap"],
    "export": ["export", "run.mcap", "--parquet", "tables"],
    "identify": ["identify", "ideal", "--out", "identified"],
    "tune": ["tune", "pid", "--save", "pid.toml"],
    "study": ["study", "run", "seeds", "--out", "study", "--workers", "2"],
    "paper": ["paper", "--out", "paper"],
    "import": ["import", "poses.csv", "--map", "time=t,x=x,y=y,z=z,yaw=yaw", "--out", "imported.mcap"],
    "recover": ["recover", "broken.mcap.part"],
}
GIVEN = ("run.mcap", "poses.csv", "broken.mcap.part")
"""Files that the commands read."""
LATEST_S = 4.0
"""Kills come at any time up to this, or up to the end of a command that takes less."""
IN_CI = [
    ("fly", signal.SIGINT),
    ("fly", signal.SIGTERM),
    ("fly", signal.SIGHUP),
    ("refly", signal.SIGTERM),
    ("resolve", signal.SIGHUP),
    ("snapshot", signal.SIGTERM),
    ("identify", signal.SIGHUP),
    ("study", signal.SIGINT),
]


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = fly(load("lab", ["duration=60", "controller.kind=pid"]), log_dir=tmp_path_factory.mktemp("log")).path
    assert path is not None
    return path


@pytest.fixture(scope="module")
def given(log: Path) -> Path:
    """A folder with a log, a recording of poses and a log without its end."""
    whole = log.read_bytes()
    (log.parent / "broken.mcap.part").write_bytes(whole[: len(whole) * 2 // 3])
    log.replace(log.with_name("run.mcap"))
    t = 0.01 * np.arange(30_000)
    poses = np.column_stack([t, 0.3 * np.cos(0.8 * t), 0.3 * np.sin(0.8 * t), 1.0 + 0.0 * t, 0.8 * t])
    np.savetxt(log.with_name("poses.csv"), poses, "%.5f", ",", header="t,x,y,z,yaw", comments="")
    return log.parent


@pytest.fixture
def folder(given: Path, tmp_path: Path) -> Path:
    for name in GIVEN:
        (tmp_path / name).symlink_to(given / name)
    return tmp_path


def listens(process: int) -> bool:
    """Return whether a process catches SIGHUP: then it is past the start of Python and catches the others too."""
    status = Path(f"/proc/{process}/status").read_text()
    caught = next(line for line in status.splitlines() if line.startswith("SigCgt:")).split()[1]
    return bool(int(caught, 16) >> (signal.SIGHUP - 1) & 1)


def alive(mark: str) -> Iterator[int]:
    """Processes that have the mark in their environment, and no zombies."""
    for process in Path("/proc").glob("[0-9]*"):
        try:
            if f"{MARK}={mark}\0".encode() in (process / "environ").read_bytes():
                yield int(process.name)
        except OSError:
            continue


def end(words: list[str], number: signal.Signals, delay_s: float, folder: Path, begun: str = "*") -> str | None:
    """Start a command, ask it to end some time after a file is there, and check how it does.

    Returns its only line, or None if it was done before.
    """
    mark = uuid4().hex
    environment = os.environ | {"PYTHONPATH": str(ROOT), MARK: mark}
    command = [sys.executable, "-m", "heli_twin", *words]
    with (folder / "output").open("w") as output, (folder / "errors").open("w") as errors:
        process = subprocess.Popen(
            command, cwd=folder, env=environment, stdout=output, stderr=errors, start_new_session=True
        )
    try:
        while process.poll() is None and not (listens(process.pid) and any(folder.glob(begun))):
            time.sleep(0.005)
        with suppress(subprocess.TimeoutExpired):
            process.wait(delay_s)
        process.send_signal(number)
        asked = time.monotonic()
        code = process.wait(2 * DEADLINE_S)
        while [*alive(mark)] and time.monotonic() - asked < 2 * DEADLINE_S:
            time.sleep(0.05)
        assert not [*alive(mark)], "processes were left behind"
    finally:
        for left in alive(mark):
            os.kill(left, signal.SIGKILL)
        process.wait()
    said = (folder / "errors").read_text()
    # Nobody can say anything after SIGKILL; Python gives the other signals back to the system when it is done.
    if code in (0, 1, -number) and (not said or number == signal.SIGKILL):
        return None
    assert code == 128 + number, said
    assert said.count("\n") == 1, said
    return said


def check_files(folder: Path, number: signal.Signals = signal.SIGTERM) -> None:
    """Every file is whole, or the beginning of a log that can be recovered; SIGKILL leaves others as `.part` too."""
    for path in folder.rglob("*"):
        if path.is_symlink():
            continue
        if path.name.endswith(".mcap.part"):
            assert read_log(recover(path)).outcome == "interrupted"
        elif path.suffix in (".part", ".recovered"):
            assert number == signal.SIGKILL, path
        else:
            check_readable(path)


@pytest.mark.parametrize(("name", "number"), IN_CI, ids=[f"{name}-{number.name}" for name, number in IN_CI])
def test_a_command_that_is_asked_to_end_ends(name: str, number: signal.Signals, folder: Path) -> None:
    is_flight = name in ("fly", "refly")
    said = end(COMMANDS[name], number, 0.3 if is_flight else 1.5, folder, "logs/*.part" if is_flight else "*")
    check_files(folder)
    assert said is not None
    if is_flight:
        (kept,) = (folder / "logs").iterdir()
        assert said.endswith(f"; the log until then is logs/{kept.name}\n")
        assert read_log(kept).outcome == "aborted"


def test_ctrl_c_while_a_command_starts_is_told_in_one_line(folder: Path) -> None:
    for delay_s in (0.0, 0.05, 0.1, 0.2, 0.4):
        said = end(COMMANDS["fly"], signal.SIGINT, delay_s, folder)
        assert said is not None
        assert said.startswith("heli-twin: interrupted")


def test_a_snapshot_that_is_killed_takes_its_viewer_along(folder: Path) -> None:
    mark = uuid4().hex
    environment = os.environ | {"PYTHONPATH": str(ROOT), MARK: mark}
    command = [sys.executable, "-m", "heli_twin", *COMMANDS["snapshot"]]
    with subprocess.Popen(command, cwd=folder, env=environment, stderr=subprocess.DEVNULL) as process:
        # The program, a shell and its watching half, and the viewer's wrapper.
        while process.poll() is None and len([*alive(mark)]) < 4:
            time.sleep(0.01)
        process.kill()
    killed = time.monotonic()
    while [*alive(mark)] and time.monotonic() - killed < DEADLINE_S:
        time.sleep(0.05)
    left = [*alive(mark)]
    for orphan in left:
        os.kill(orphan, signal.SIGKILL)
    assert not left


@pytest.mark.long
@pytest.mark.parametrize("name", COMMANDS)
def test_many_kills_leave_nothing_behind(name: str, folder: Path) -> None:
    random, latest, ended = Random(name), LATEST_S, Counter[str]()
    for kill in range(KILLS + 1):
        number = random.choice([signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGKILL])
        began = time.monotonic()
        # The first one tells how long the command takes.
        said = end(COMMANDS[name], number, random.uniform(0.0, latest) if kill else latest, folder)
        latest = latest if kill else min(latest, time.monotonic() - began)
        ended[number.name if said or number == signal.SIGKILL else "before"] += 1
        check_files(folder, number)
        for path in filter(Path.is_file, folder.rglob("*")):
            if not path.is_symlink():
                path.unlink()
    print(f"{name}: {dict(ended)}, over {latest:.1f} s")
