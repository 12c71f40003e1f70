import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from heli_twin import load, read_log
from heli_twin.cli import main

ROOT = Path(__file__).parents[1]
SHORT = ["ideal", "duration=0.1"]


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch):
    """What a command leaves lying about, it leaves here."""
    monkeypatch.chdir(tmp_path)


def files(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


MISTAKES = {
    "misspelt key": (["plant.masss=0.03"], "did you mean 'plant.mass'?"),
    "wrong type": (["duration=long"], "duration = 'long': it must be a valid number; the default is 30.0 s"),
    "negative mass": (["plant.mass=-0.028"], "plant.mass = -0.028: it must be greater than or equal to 0.01 kg"),
    "not a number": (["plant.mass=nan"], "plant.mass = nan is not a finite number"),
    "infeasible trajectory": (["trajectory.rate=9"], "the limit is 1; make it slower, smaller or smoother"),
    "inside the floor": (["trajectory.height=0.01"], "would stand 0.035 m in the floor: start higher"),
    "impossible plant": (["plant.inertia_xx=1e-3"], "are no rigid body's"),
    "unknown preset": (["labb"], "did you mean 'lab'?"),
    "missing file": (["mine.toml"], "cannot read mine.toml: No such file or directory"),
    "broken file": (["broken.toml"], "broken.toml is not valid TOML: "),
    "half an override": (["lab", "plant.mass"], "write path.to.field=value"),
}


SHOWN = {"infeasible trajectory", "inside the floor"}
"""Experiments that can be shown and not flown."""


@pytest.mark.parametrize(
    ("command", "words", "said"),
    [(c, *MISTAKES[m]) for m in MISTAKES for c in ("fly", "show") if c == "fly" or m not in SHOWN],
)
def test_a_mistake_is_told_in_one_line_and_leaves_nothing(command, words, said, capsys, tmp_path):
    (tmp_path / "broken.toml").write_text("[plant\nmass = 0.03\n")
    assert main([command, *words]) == 2
    out, error = capsys.readouterr()
    assert out == ""
    assert error.startswith("heli-twin: ")
    assert error.count("\n") == 1
    assert error.endswith("\n")
    assert said in error
    assert "Traceback" not in error
    assert files(tmp_path) == ["broken.toml"]


@pytest.mark.parametrize("folder", ["taken", "taken/deeper"])
def test_a_folder_that_cannot_be_written_is_told_in_one_line(folder, capsys, tmp_path):
    (tmp_path / "taken").write_text("mine")
    assert main(["fly", *SHORT, "--log-dir", folder]) == 2
    out, error = capsys.readouterr()
    assert out == ""
    assert error.startswith("heli-twin: ")
    assert error.count("\n") == 1
    assert "taken" in error
    assert files(tmp_path) == ["taken"]
    assert (tmp_path / "taken").read_text() == "mine"


@pytest.mark.skipif(os.geteuid() == 0 if hasattr(os, "geteuid") else True, reason="root writes everywhere")
def test_a_folder_without_permission_is_told_in_one_line(capsys, tmp_path):
    (tmp_path / "locked").mkdir(mode=0o500)
    assert main(["fly", *SHORT, "--log-dir", "locked"]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_a_process_that_is_told_of_a_mistake_ends_with_2():
    command = [sys.executable, "-m", "heli_twin", "fly", "plant.masss=1"]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=60, check=False)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)


@pytest.mark.parametrize("words", [["fly", "--no-lg"], ["flie"], [], ["fly", "--log-dir"]])
def test_a_wrong_option_is_told_in_one_line_that_names_the_help(words, capsys):
    with pytest.raises(SystemExit, match="2"):
        main(words)
    error = capsys.readouterr().err
    assert error.startswith("heli-twin")
    assert error.count("\n") == 1
    assert "--help`" in error


@pytest.mark.parametrize("words", [["--help"], ["fly", "--help"], ["show", "--help"]])
def test_every_command_explains_itself(words, capsys):
    with pytest.raises(SystemExit, match="0"):
        main(words)
    out = capsys.readouterr().out
    assert "heli-twin" in out
    if len(words) == 2:
        assert "examples:\n" in out


def by_axis(value) -> bool:
    return list(value) == ["x", "y", "z", "yaw"]


def test_json_is_json_with_the_names_that_programs_rely_on(capsys, tmp_path):
    assert main(["fly", "ideal", "duration=2.5", "--json", "--log-dir", "runs"]) == 0
    out, error = capsys.readouterr()
    assert error == ""
    found = json.loads(out, parse_constant=lambda text: pytest.fail(f"{text} is not JSON"))
    assert found["outcome"] == "completed"
    assert found["duration"] == 2.5
    for key in ("max_abs_error", "rmse", "mse"):
        assert by_axis(found[key])
        assert all(0 <= value < 0.01 for value in found[key].values())
    for key in ("control_step_ms", "solve_ms"):
        assert list(found[key]) == ["p50", "p99", "max"]
        assert 0 < found[key]["p50"] <= found[key]["p99"] <= found[key]["max"]
    assert found["control_step_ms"]["p50"] > found["solve_ms"]["p50"]
    assert found["qp_status"] == {"solved": 125}
    assert found["real_time_factor"] > 0
    assert files(tmp_path) == [found["log"]]
    assert read_log(found["log"]).digest == found["flight_digest"]
    assert len(bytes.fromhex(found["flight_digest"])) == 32


def test_a_flight_that_ends_early_is_json_too_and_exit_1(capsys):
    assert main(["fly", "plant.thrust_gain=0.2", "duration=3", "--json", "--no-log"]) == 1
    found = json.loads(capsys.readouterr().out)
    assert found["outcome"] == "crashed"
    assert found["log"] is None
    assert by_axis(found["rmse"])
    assert set(found["rmse"].values()) == {None}


def test_a_person_is_told_what_happened_and_where_the_log_is(capsys, tmp_path):
    assert main(["fly", "ideal", "duration=2.5"]) == 0
    out, error = capsys.readouterr()
    assert error == ""
    (log,) = files(tmp_path)
    assert log.startswith("logs/")
    assert log.endswith(".mcap")
    assert out.startswith("completed: flew the whole 2.5 s\n")
    assert f"log {log}" in out
    assert "control problems: 125 solved" in out
    assert "Traceback" not in out


def test_without_a_log_nothing_is_left(capsys, tmp_path):
    assert main(["fly", *SHORT, "--no-log"]) == 0
    assert files(tmp_path) == []
    assert "log " not in capsys.readouterr().out


def test_flights_within_one_second_have_logs_of_their_own(capsys, tmp_path):
    for _ in range(3):
        assert main(["fly", *SHORT, "--log-dir", "runs"]) == 0
    assert len(files(tmp_path)) == 3
    assert not any(name.endswith(".part") for name in files(tmp_path))


@pytest.mark.parametrize("words", [["lab"], ["ideal"], ["ideal", "trajectory=hover", "faults.pose_nan=on", "seed=3"]])
def test_what_show_prints_fly_takes(words, capsys, tmp_path):
    assert main(["show", *words]) == 0
    shown = capsys.readouterr().out
    (tmp_path / "mine.toml").write_text(shown)
    assert main(["show", "mine.toml"]) == 0
    assert capsys.readouterr().out == shown
    digests = []
    for source in (words, ["mine.toml"]):
        assert main(["fly", *source, "duration=0.2", "--no-log", "--json"]) == 0
        digests.append(json.loads(capsys.readouterr().out)["flight_digest"])
    assert digests[0] == digests[1]


def test_without_a_preset_it_is_the_lab(capsys):
    assert main(["show", "seed=4"]) == 0
    first = capsys.readouterr().out
    assert main(["show", "lab", "seed=4"]) == 0
    assert capsys.readouterr().out == first
    assert load("lab", ["seed=4"]).seed == 4
    assert "seed = 4" in first


def test_a_reader_that_has_gone_is_no_error():
    """`heli-twin show | head -1`."""
    command = f"{sys.executable} -m heli_twin show | head -1"
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, shell=True, capture_output=True, text=True, env=environment, timeout=60, check=True)
    assert done.stderr == ""
    assert done.stdout.startswith("physics = ")


# --- foreign text


def test_brackets_in_a_path_are_printed_as_they_are(capsys, tmp_path):
    assert main(["fly", *SHORT, "--log-dir", "x[/foo][bold]"]) == 0
    (log,) = files(tmp_path)
    assert f"log {log}\n" in capsys.readouterr().out
    assert main(["export", log, "--parquet", "y[/foo]"]) == 0
    assert "y[/foo]/truth.parquet: " in capsys.readouterr().out
    assert main(["info", log]) == 0
    assert log in capsys.readouterr().out


@pytest.mark.parametrize("size", [1, 100_000])
@pytest.mark.parametrize(
    "words", [["fly", "{}=1"], ["fly", "duration={}"], ["info", "{}"], ["fly", "keys.toml"], ["import", "poses.csv"]]
)
def test_foreign_text_in_an_error_is_short_and_cannot_command_a_terminal(words, size, capsys, tmp_path):
    foreign = "\x1b]0;owned\x07\x1b[2J\u202e" * size
    (tmp_path / "keys.toml").write_text(f"{json.dumps(foreign)} = 1\n")
    (tmp_path / "poses.csv").write_text(f"time,x,y,{foreign}\n0,0,0,0\n")
    assert main([word.format(foreign) for word in words]) == 2
    out, error = capsys.readouterr()
    assert out == ""
    assert error.count("\n") == 1
    assert len(error) < 500
    assert error[:-1].isprintable()


# --- words and options


@pytest.mark.parametrize("command", ["fly", "show", "trajectories"])
def test_words_go_before_between_and_after_the_options(command, capsys, tmp_path):
    option = ["--json"] if command != "show" else []
    assert main([command, "ideal", *option, "plant.model.b_x=nonsense", "duration=1"]) == 2
    assert "b_x" in capsys.readouterr().err


@pytest.mark.parametrize(
    "words",
    [
        ["identify", "ideal", "--json", "plant.mass=nonsense"],
        ["tune", "--budget", "1", "pid", "--json", "ideal", "plant.mass=nonsense"],
        ["study", "run", "--workers", "1", "ladder", "--no-report", "plant.mass=nonsense"],
        ["import", "poses.csv", "--out", "a.mcap", "plant.mass=nonsense"],
    ],
)
def test_words_after_an_option_are_read(words, capsys, tmp_path):
    (tmp_path / "poses.csv").write_text("time,x,y,z,yaw\n0,0,0,1,0\n0.01,0,0,1,0\n")
    assert main(words) == 2
    error = capsys.readouterr().err
    assert "unrecognized" not in error
    assert "mass" in error
