"""Long commands that are ended at any moment, in every way: nothing is left running, nothing is left half-written.

`pytest -m long tests/workers/test_kills.py`; the environment variable KILLS is the number of kills of each command.
"""

import os
import pty
import random
import select
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

import pytest
from readable import check_readable

KILLS = int(os.environ.get("KILLS", "100"))
LATEST_S = 8.0
"""Kills come at any time up to this."""
ENDED_WITHIN_S = {"SIGKILL": 2.0, "SIGTERM": 5.0, "SIGINT": 5.0, "SIGHUP": 5.0, "closed terminal": 5.0}
COMMANDS = {
    "identify": ["identify", "--out", "out", "--save", "out/mine.toml"],
    "tune": ["tune", "pid", "--budget", "2", "--save", "out/pid.toml"],
    "paper": ["paper", "--seeds", "1", "--out", "out"],
    "study": ["study", "run", "gust", "duration=5", "replicates=20", "--out", "out"],
}


class Terminal:
    """A terminal of which one side is ours; what comes from the other side is read away."""

    def __init__(self) -> None:
        self._ours, self._theirs = pty.openpty()
        self._closing = threading.Event()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        # A read that waits would keep the terminal open.
        while not self._closing.is_set():
            if select.select([self._ours], [], [], 0.05)[0]:
                with suppress(OSError):
                    os.read(self._ours, 65536)

    def start(self, words: list[str], folder: Path) -> subprocess.Popen[bytes]:
        """A command whose session has this terminal."""
        script = "import fcntl, runpy, sys, termios; fcntl.ioctl(0, termios.TIOCSCTTY, 0); "
        script += "sys.argv[0] = 'heli-twin'; runpy.run_module('heli_twin', run_name='__main__', alter_sys=True)"
        streams = {"stdin": self._theirs, "stdout": self._theirs, "stderr": self._theirs}
        return subprocess.Popen([sys.executable, "-c", script, *words], cwd=folder, start_new_session=True, **streams)

    def close(self) -> None:
        """Hang up, once."""
        if not self._closing.is_set():
            self._closing.set()
            self._reader.join()
            os.close(self._theirs)
            os.close(self._ours)


def running(session: int) -> list[str]:
    """The processes of a session that have not ended."""
    listed = subprocess.run(["ps", "-eo", "sess=,stat=,pid=,args="], capture_output=True, text=True, check=True).stdout
    return [line for line in listed.splitlines() if int(line.split()[0]) == session and "Z" not in line.split()[1]]


def end(driver: subprocess.Popen[bytes], terminal: Terminal, way: str) -> None:
    if way == "closed terminal":
        terminal.close()
    else:
        with suppress(ProcessLookupError):
            os.kill(driver.pid, signal.Signals[way])


@pytest.mark.long
@pytest.mark.parametrize("command", COMMANDS)
def test_kills_leave_nothing_running_and_nothing_half_written(command: str, tmp_path: Path) -> None:
    chance = random.Random(command)
    for number in range(KILLS):
        way = list(ENDED_WITHIN_S)[number % len(ENDED_WITHIN_S)]
        terminal = Terminal()
        driver = terminal.start(COMMANDS[command], tmp_path)
        try:
            with suppress(subprocess.TimeoutExpired):
                driver.wait(timeout=chance.uniform(0.0, LATEST_S))
            end(driver, terminal, way)
            asked = time.monotonic()
            while (left := running(driver.pid)) and time.monotonic() < asked + ENDED_WITHIN_S[way]:
                time.sleep(0.05)
            assert not left, f"{way}, kill {number}"
        finally:
            with suppress(ProcessLookupError):
                os.killpg(driver.pid, signal.SIGKILL)
            driver.wait()
            terminal.close()
        for path in filter(Path.is_file, tmp_path.rglob("*")):
            check_readable(path)
        for path in tmp_path.rglob("*.mcap*"):
            path.unlink()
