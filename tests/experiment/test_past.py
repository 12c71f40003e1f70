"""Old logs, stores and files fly as they flew; a new field changes no digest of flights that do not use it."""

import json
from importlib import import_module
from pathlib import Path

import pytest

from heli_twin.cli import main
from heli_twin.errors import HeliTwinError
from heli_twin.experiment import Experiment
from heli_twin.experiment.differences import fly_words
from heli_twin.experiment.fields import fields_of
from heli_twin.experiment.past import PAST, PHYSICS_VERSION, Past
from heli_twin.experiment.text import load
from heli_twin.experiment.tree import ExperimentError, canonical_json, from_json, parsed, toml_of, tree_of
from heli_twin.logbook import flown_experiment, physics_notice, physics_version, provenance
from heli_twin.metrics.tracking import metrics
from heli_twin.reanalysis.refly import refly
from heli_twin.recording import Log, read_log
from heli_twin.studies.plan import plan_of
from heli_twin.studies.space import varied
from heli_twin.studies.study import load_study

LOGS = sorted((Path(__file__).parent / "past").glob("physics*.mcap"))
CAME_IN_3 = {
    "heli_twin.lab.plant.mujoco.MuJoCo.mass": Past(3, 0.031),
    "heli_twin.lab.disturbances.gust.Gust.time": Past(3, 0.5),
    "controllers.model.Model.b_x": Past(3, 2.5),
    "controllers.trajectories.circle.Circle.radius": Past(3, 0.4),
    "heli_twin.experiment.Experiment.compute": Past(3, {"kind": "off"}),
    "heli_twin.experiment.Experiment.seed": Past(3, 7, is_new=False),
}
"""As if these fields had come with version 3."""
WITH_PAST = [
    "plant.mass=0.031",
    "disturbances.gust.time=0.5",
    "controller.model.b_x=2.5",
    "trajectory=takeoff_and_landing",
    "trajectory.flight.radius=0.4",
    "compute=off",
]


@pytest.fixture
def past(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in list(PAST):
        monkeypatch.delitem(PAST, name)
    for name, value in CAME_IN_3.items():
        monkeypatch.setitem(PAST, name, value)


def test_the_table_names_fields_that_there_are() -> None:
    for name, past in PAST.items():
        module, spec, field = name.rsplit(".", 2)
        assert field in fields_of(getattr(import_module(module), spec)), name
        assert past.version <= PHYSICS_VERSION


@pytest.mark.parametrize("path", LOGS, ids=lambda path: path.stem)
def test_a_log_of_an_older_version_still_flies(path: Path) -> None:
    log = read_log(path)
    version = int(path.stem.removeprefix("physics"))
    assert physics_version(log) == version
    assert metrics(log)["outcome"] == "completed"
    assert canonical_json(flown_experiment(log)) == log.experiment
    again = refly(log)
    assert again.verdict in ("identical", "within tolerance")
    if version == PHYSICS_VERSION:
        assert again.result.flight_digest == log.digest or again.platforms
    assert bool(physics_notice(log)) == (version != PHYSICS_VERSION)


def test_there_is_a_log_of_every_version_since_they_are_kept() -> None:
    assert {f"physics{version}" for version in range(3, PHYSICS_VERSION)} <= {path.stem for path in LOGS}


def test_refly_says_first_that_the_physics_changed(monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    monkeypatch.setattr("heli_twin.logbook.PHYSICS_VERSION", 9)
    assert main(["refly", str(LOGS[0])]) == 0
    assert capsys.readouterr().out.startswith("the log was flown with physics version 3, this is version 9: ")


def test_a_log_says_its_physics_version_and_an_old_one_is_of_version_3() -> None:
    assert physics_version(Log({}, metadata=provenance())) == PHYSICS_VERSION
    assert physics_version(Log({}, metadata={})) == 3
    for text in ("", "three", "-1", "9" * 5000, "\u0663"):
        with pytest.raises(HeliTwinError, match="not a version of the physics"):
            physics_version(Log({}, metadata={"physics": text}))


@pytest.mark.usefixtures("past")
def test_a_new_field_with_its_past_value_is_left_out_of_the_text() -> None:
    text = json.loads(canonical_json(load("lab", WITH_PAST)))
    assert "mass" not in text["plant"]
    assert "time" not in text["disturbances"]["gust"]
    assert "b_x" not in text["controller"]["model"]
    assert "radius" not in text["trajectory"]["flight"]
    assert "compute" not in text
    assert text["seed"] == 0
    # Any other value is written, today's default too.
    assert json.loads(canonical_json(Experiment()))["plant"]["mass"] == 0.028


@pytest.mark.usefixtures("past")
@pytest.mark.parametrize("overrides", [[], WITH_PAST, WITH_PAST[2:], [WITH_PAST[0], "seed=7"]])
def test_what_is_left_out_is_read_back(overrides: list[str]) -> None:
    experiment = load("lab", overrides)
    text = canonical_json(experiment)
    assert from_json(text) == experiment
    assert parsed(text) == tree_of(experiment)
    assert varied(text, {"plant.mass": 0.03, "compute": "modelled"})["plant"]["mass"] == 0.03
    words = fly_words(text)
    source = words.pop(0) if words and "=" not in words[0] else None
    assert load(source, words) == experiment


@pytest.mark.usefixtures("past")
def test_a_file_of_an_older_version_gets_the_past_and_another_one_today(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    words = 'trajectory.kind = "takeoff_and_landing"\ntrajectory.climb = 2.0\n'
    file.write_text(f"physics = 2\n{words}")
    assert load(str(file)) == load("lab", [*WITH_PAST, "trajectory.climb=2", "seed=7"])
    # What it names and what an override says hold.
    file.write_text(f"physics = 2\nseed = 0\nplant.mass = 0.029\n{words}compute.kind = 'modelled'\n")
    read = load(str(file), ["trajectory.flight.radius=0.6"])
    assert (read.seed, read.plant.mass, read.compute.kind, read.trajectory.flight.radius) == (0, 0.029, "modelled", 0.6)
    assert read.disturbances[1].time == 0.5
    for version in ("", f"physics = {PHYSICS_VERSION}\n"):
        file.write_text(version + words)
        assert load(str(file)) == load("lab", ["trajectory=takeoff_and_landing", "trajectory.climb=2"])


@pytest.mark.usefixtures("past")
def test_a_part_from_a_file_of_an_older_version_gets_the_past_and_the_rest_today(tmp_path: Path) -> None:
    file = tmp_path / "plant.toml"
    file.write_text("physics = 2\n[plant]\ndrag_z = 0.01\n")
    read = load(None, [f"plant={file}"])
    assert read == load(None, ["plant.mass=0.031", "plant.drag_z=0.01"])
    for part in (f"[base]\nplant = '{file}'", f"[alternatives]\nold = {{plant = '{file}'}}"):
        (tmp_path / "study.toml").write_text(part)
        plan = plan_of(load_study(str(tmp_path / "study.toml")))
        (run,) = plan.runs(next(plan.batches()))
        assert parsed(run.experiment)["plant"]["mass"] == 0.031


@pytest.mark.parametrize("version", [0, PHYSICS_VERSION + 1])
def test_a_table_of_no_version_has_an_unknown_field(version: int) -> None:
    with pytest.raises(HeliTwinError, match=r"unknown field 'plant\.physics'"):
        load(None, [f"plant={{physics={version}, mass=0.03}}"])


@pytest.mark.parametrize("version", ["0", "-1", "2.5", "'3'", "true", str(PHYSICS_VERSION + 1), "9" * 18])
def test_a_file_of_a_version_that_nobody_knows_is_refused(version: str, tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(f"physics = {version}\n")
    with pytest.raises(ExperimentError, match=f"knows the versions 1 to {PHYSICS_VERSION}"):
        load(str(file))


def test_what_show_prints_carries_the_version() -> None:
    assert toml_of(Experiment()).startswith(f"physics = {PHYSICS_VERSION} ")


def test_the_simple_lab_is_the_lab_of_physics_version_3() -> None:
    """The same canonical text, so that its flights keep their digests."""
    changes = ["duration=1", "faults.pose_outage=on", "faults.pose_outage.start=0.3"]
    flown, simple = (
        json.loads(text)
        for text in (
            read_log(Path(__file__).parent / "past" / "physics3.mcap").experiment,
            canonical_json(load("lab_simple", changes)),
        )
    )
    # The log's flight rose from the floor; a trajectory that is chosen anew has today's defaults.
    del flown["trajectory"], simple["trajectory"]
    assert simple == flown
