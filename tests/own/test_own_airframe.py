"""A user's helicopter in a study and in an identification: the flights need its file once."""

import shutil
from pathlib import Path

import pytest

from heli_twin import fly, load
from heli_twin.cli import main
from heli_twin.identification.flights import experiments, fly_them
from heli_twin.identification.identify import identify
from heli_twin.recording import read_log
from heli_twin.studies.campaign import run_study
from heli_twin.studies.results import rows_of
from heli_twin.studies.study import load_study

QUADROTOR = Path(__file__).parents[1] / "lab" / "plant" / "airframes" / "quadrotor.xml"
STUDY = """
replicates = 1
[base]
duration = 2.2
trajectory = "hover"
[axes]
"plant.model" = ["./quad.xml", "./heavy.xml"]
[alternatives.mpc]
"controller.model" = "MODEL"
[alternatives.pid]
controller = "pid"
"controller.model" = "MODEL"
"""
MODEL = "[controller.model]\nb_x = 3.0\nk_x = -0.2\nb_y = 3.0\nk_y = -0.2\nb_z = 20.0\nb_yaw = 30.0\nk_yaw = -5.9\n"


@pytest.fixture
def study(tmp_path: Path) -> Path:
    """A folder of a user's own with two airframes, a believed model and a study."""
    home = tmp_path / "secret folder"
    home.mkdir()
    shutil.copy(QUADROTOR, home / "quad.xml")
    heavier = QUADROTOR.read_text().replace('mass="0.060"', 'mass="0.063"').replace("0.4905", "0.515025")
    (home / "heavy.xml").write_text(heavier)
    (home / "model.toml").write_text(MODEL)
    (home / "quads.toml").write_text(STUDY.replace("MODEL", str(home / "model.toml")))
    return home


def test_a_study_flies_two_airframes_by_both_laws_and_needs_their_files_once(study: Path) -> None:
    out = study.parent / "results"
    run_study(load_study(str(study / "quads.toml")), out)
    rows = list(rows_of(out))
    assert len(rows) == 4
    assert {row["outcome"] for row in rows} == {"completed"}
    assert {row["plant.model"].split(" #")[0] for row in rows} == {'<mujoco model="test quadrotor">'}
    assert len({row["plant.model"] for row in rows}) == 2
    assert {row["alternative"] for row in rows} == {"mpc", "pid"}
    assert max(row["rmse.z"] for row in rows) < 0.1
    shutil.rmtree(study)
    assert b"secret folder" not in (out / "results.sqlite").read_bytes().replace(b"model.toml", b"")
    assert main(["study", "worst", str(out)]) == 0
    assert main(["study", "fly", str(out), rows[0]["id"][:8]]) == 0
    flown = read_log(next((out / "reflown").glob("*.mcap")))
    assert flown.digest == rows[0]["digest"]


def test_an_axis_of_files_is_refused_like_a_single_file(study: Path) -> None:
    (study / "heavy.xml").write_text("<robot/>")
    with pytest.raises(Exception, match=r"plant\.model: heavy\.xml is no MJCF"):
        load_study(str(study / "quads.toml"))


@pytest.mark.long
def test_a_quadrotor_is_identified_and_flies_the_circle_on_it(tmp_path: Path) -> None:
    logs = fly_them(experiments(load("lab", [f"plant.model={QUADROTOR}"])), tmp_path)
    identified = identify((str(path), read_log(path)) for path in logs)
    # Of the file: 9.81 sin(tilt) at full stick, thrust over mass, torque over inertia.
    for name, truth in (("b_x", 3.004), ("b_y", 3.004), ("b_z", 20.0), ("b_yaw", 30.0)):
        assert identified.parameters[name].value == pytest.approx(truth, rel=0.05), name
    (tmp_path / "model.toml").write_text(identified.as_toml())
    for law in ("ltv_mpc", "pid"):
        words = [f"plant.model={QUADROTOR}", f"controller.kind={law}", f"controller.model={tmp_path / 'model.toml'}"]
        result = fly(load("lab", words), log_dir=None)
        assert result.outcome.kind == "completed"
        assert law == "pid" or result.summary()["max_abs_error"]["x"] < 0.05
