"""What can be learnt without reading source: help, hints, templates, units, completion."""

import pydoc
import subprocess
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from in_process import InProcess

import heli_twin
from heli_twin import Experiment, Log, Study, fly, load, load_study, run
from heli_twin.cli import main
from heli_twin.experiment.families import DESIGNS, GROUPS, members
from heli_twin.experiment.fields import fields_of
from heli_twin.recording import columns
from heli_twin.recording.log import COLUMNS, OTHER_NAMES
from heli_twin.studies import axes
from heli_twin.studies.plan import plan_of

SPECS = [Experiment, Study, *(spec for package in GROUPS for spec in members(package).values())]


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    flown = fly(load("lab", ["duration=2.5"]), log_dir=tmp_path_factory.mktemp("flight")).path
    assert flown is not None
    return flown


@pytest.fixture(scope="module")
def log(path: Path) -> Log:
    return heli_twin.read_log(path)


# --- a log


def test_topics_are_counted(log: Log) -> None:
    assert log.topics["/truth"] == len(log.truth.time) == 126
    assert sum(log.topics.values()) == sum(len(topic.times) for topic in log.messages.values())


@pytest.mark.parametrize("name", ["reference", "estimate"])
def test_named_columns_are_those_of_the_state(log: Log, name: str) -> None:
    topic = getattr(log, name)
    flat = np.column_stack([topic.position, topic.yaw, topic.velocity_body, topic.yaw_rate])
    np.testing.assert_array_equal(flat, topic.x)


def test_the_velocity_of_the_reference_is_that_of_its_position_in_the_world() -> None:
    turning = fly(load("ideal", ["trajectory=pirouette_circle", "duration=4"]), log_dir=None).log.reference
    by_difference = np.gradient(turning.position, turning.seconds, axis=0)
    # Central differences of 20 ms of a path with 1 rad/s are wrong by (w dt)^2 / 6 = 7e-5 of 0.5 m/s.
    np.testing.assert_allclose(turning.velocity[2:-2], by_difference[2:-2], atol=1e-3)
    assert np.abs(turning.velocity - turning.velocity_body).max() > 0.1


def test_named_inputs_are_those_of_the_command(log: Log) -> None:
    sent = log.sent
    np.testing.assert_array_equal(np.column_stack([sent.pitch, sent.roll, sent.thrust, sent.yaw]), sent.u)


@pytest.mark.parametrize("name", sorted(set(COLUMNS) - {"events", "reference_paths"}))
def test_times_are_in_seconds_too(log: Log, name: str) -> None:
    topic = getattr(log, name)
    np.testing.assert_allclose(topic.seconds, 1e-9 * topic.time, rtol=1e-12)


def test_a_wrong_column_is_told_the_right_one(log: Log) -> None:
    assert set(OTHER_NAMES.values()) <= set(COLUMNS)
    with pytest.raises(AttributeError, match=r"a log has no `mocap`: it is called `log.pose`"):
        _ = log.mocap
    with pytest.raises(AttributeError, match="it has truth, pose, estimate"):
        _ = log.thruth


def test_the_first_step_has_no_pose_and_says_so(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fly", "lab", "duration=0.1", "--no-log"]) == 0
    assert "control problems: 4 solved, 1 step before the first pose\n" in capsys.readouterr().out


# --- help


@pytest.mark.parametrize("spec", SPECS, ids=lambda spec: spec.__name__)
def test_help_tells_every_field_with_its_unit(spec: type) -> None:
    text = pydoc.plain(pydoc.render_doc(spec))
    assert "Annotated" not in text.split("Data and other attributes")[0].split("Data descriptors")[0]
    said = " ".join(text.split("Fields:")[1].split("Methods defined")[0].replace(" |", "").split())
    for name, field in fields_of(spec).items():
        if name != "kind":
            assert f"{name} = " in said
            assert " ".join(field.doc.split()) in said
            assert field.unit in ("", "1") or f" {field.unit}: " in said


@pytest.mark.parametrize("kind", [value for value in vars(columns).values() if hasattr(value, "_fields")])
def test_help_tells_every_column(kind: type) -> None:
    told = (kind.__doc__ or "").split("Attributes:")[1]
    for name in kind._fields:
        assert name in told


def test_fly_takes_a_name(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text("duration = 0.1\nseed = 3\n")
    assert fly(str(tmp_path / "mine.toml"), log_dir=None).experiment == load("lab", ["duration=0.1", "seed=3"])
    with pytest.raises(heli_twin.ExperimentError, match="did you mean 'lab'"):
        fly("labb")


# --- studies


def test_the_template_is_a_study_and_is_not_overwritten(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["study", "new", "mine.toml"]) == 0
    assert "heli-twin study run mine.toml" in capsys.readouterr().out
    assert plan_of(load_study("mine.toml")).count() == 24
    Path("mine.toml").write_text("mine")
    assert main(["study", "new", "mine.toml"]) == 2
    assert "mine.toml exists already" in capsys.readouterr().err
    assert Path("mine.toml").read_text() == "mine"


def test_what_study_show_prints_study_run_takes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["study", "show", "mass"]) == 0
    (tmp_path / "mass.toml").write_text(capsys.readouterr().out)
    assert load_study(str(tmp_path / "mass.toml")) == load_study("mass")
    assert main(["study", "show", "mas"]) == 2
    assert "did you mean 'mass'" in capsys.readouterr().err


def test_the_help_of_study_run_names_every_design_and_axis(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["study", "run", "--help"])
    said = capsys.readouterr().out
    kinds = {kind.__name__.lower() for kind in vars(axes).values() if hasattr(kind, "quantile")} - {"axis", "values"}
    template = (Path(heli_twin.__file__).parent / "studies" / "template.toml").read_text()
    for word in (*members(DESIGNS), *kinds):
        assert word in said
        assert word in template


def test_a_study_from_python_is_a_table_with_units(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("heli_twin.studies.run.embedded", InProcess)
    study = Study("two", base={"preset": "lab_simple", "duration": 2.1}, axes={"plant.mass": [0.028, 0.03]})
    rows = run(study, tmp_path)
    assert rows.column("plant.mass").to_pylist() == [0.028, 0.03]
    assert rows.column("outcome").to_pylist() == ["completed"] * 2
    units = {field.name: (field.metadata or {}).get(b"unit", b"").decode() for field in rows.schema}
    expected = {"rmse.x": "m", "rmse.yaw": "rad", "mse.x": "m^2", "plant.mass": "kg", "solve_ms.p50": "ms"}
    assert {name: units[name] for name in expected} == expected


# --- files and shells


def test_columns_of_parquet_files_have_units(path: Path, tmp_path: Path) -> None:
    assert main(["export", str(path), "--parquet", str(tmp_path)]) == 0
    schema = pq.read_schema(tmp_path / "truth.parquet")
    assert schema.field("velocity").metadata == {b"unit": b"m/s", b"about": b"(3) world, m/s"}
    assert pq.read_schema(tmp_path / "reference.parquet").field("time").metadata[b"unit"] == b"ns"
    (tmp_path / "truth.parquet").write_text("old")
    assert main(["export", str(path), "--parquet", str(tmp_path)]) == 2
    assert main(["export", str(path), "--parquet", str(tmp_path), "--force"]) == 0
    assert pq.read_schema(tmp_path / "truth.parquet") == schema


def test_the_version_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["--version"])
    assert stop.value.code == 0
    assert capsys.readouterr().out.startswith("heli-twin 0.")


def test_bash_completes_commands_and_options(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", "bash"]) == 0
    script = (
        f"{capsys.readouterr().out}\n"
        "COMP_WORDS=(heli-twin snap); COMP_CWORD=1; _shtab_heli_twin; echo ${COMPREPLY[@]}"
        "\nCOMP_WORDS=(heli-twin snapshot --a); COMP_CWORD=2; _shtab_heli_twin; echo ${COMPREPLY[@]}"
    )
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["snapshot", "--at"]
