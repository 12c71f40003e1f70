"""Standard streams that are full, closed or cannot show a character: one line, and an exit code that tells."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
COMMANDS = {
    "help": ["--help"],
    "fly": ["fly", "ideal", "duration=0.1", "--no-log"],
    "show": ["show"],
    "trajectories": ["trajectories", "trajectory=circle"],
    "studies": ["study", "list"],
}
every_command = pytest.mark.parametrize("words", COMMANDS.values(), ids=COMMANDS)


def run(words: list[str], folder: Path, redirection: str, **variables: str) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"PYTHONPATH": str(ROOT)} | variables
    command = ["sh", "-c", f'exec "$@" {redirection}', "sh", sys.executable, "-m", "heli_twin", *words]
    return subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, errors="replace", timeout=60, check=False
    )


@every_command
def test_a_full_disk_behind_the_output_is_told_in_one_line(words: list[str], tmp_path: Path) -> None:
    done = run(words, tmp_path, ">/dev/full")
    assert (done.returncode, done.stderr) == (2, "heli-twin: the output cannot be written: No space left on device\n")


@every_command
def test_a_closed_output_is_told_before_anything_is_done(words: list[str], tmp_path: Path) -> None:
    done = run([word for word in words if word != "--no-log"], tmp_path, ">&-")
    assert done.returncode == 2
    assert done.stderr == "heli-twin: the standard output is closed: redirect it to a file or to /dev/null\n"
    assert not [*tmp_path.iterdir()]


@every_command
@pytest.mark.parametrize("encoding", ["latin-1", "ascii"])
def test_an_output_without_unicode_shows_what_it_can(encoding: str, words: list[str], tmp_path: Path) -> None:
    done = run(words, tmp_path, "", PYTHONIOENCODING=encoding)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout


def test_without_an_error_stream_a_command_does_its_work(tmp_path: Path) -> None:
    assert run(COMMANDS["fly"], tmp_path, "2>&- <&-").returncode == 0
    done = run(["fly", "plant.mass=x"], tmp_path, "2>&-")
    assert (done.returncode, done.stdout) == (2, "")
