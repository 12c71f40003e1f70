"""An ensemble of a calibration as one axis: whole helicopters are drawn, and methods that need more say so."""

import json

import numpy as np
import pytest
from in_process import InProcess

from heli_twin.experiment.tree import table_of
from heli_twin.lab.plant.mujoco import MuJoCo
from heli_twin.studies.campaign import run_study
from heli_twin.studies.errors import StudyError
from heli_twin.studies.plan import plan_of
from heli_twin.studies.report import write_report
from heli_twin.studies.results import rows_of
from heli_twin.studies.study import load_study, study_of
from heli_twin.workers.task import Flown, Task

DRAWS = 8


def plants() -> list[dict]:
    """Helicopters whose mass and thrust go together, as a calibration finds them."""
    masses = 0.028 + 0.001 * np.random.default_rng(0).standard_normal(DRAWS)
    return [table_of(MuJoCo(mass=round(m, 6), thrust_gain=round(18.0 * m, 6))) for m in masses.tolist()]


@pytest.fixture
def folder(tmp_path):
    lines = ['name = "ensemble"']
    for i, plant in enumerate(plants(), 1):
        effects = plant.pop("effects")
        assert not effects
        lines += [f"[alternatives.draw_{i:02d}.plant]", *(f"{k} = {json.dumps(v)}" for k, v in plant.items())]
    (tmp_path / "ensemble.toml").write_text("\n".join(lines))
    return tmp_path


def study(folder, design, axes="", alternatives='"MPC" = {}\n"PID" = { controller = "pid" }'):
    path = folder / "mine.toml"
    path.write_text(
        f'base = {{ preset = "lab", duration = 1.0 }}\ndesign = {design}\n[alternatives]\n{alternatives}\n'
        f'[axes]\nplant = {{ ensemble = "ensemble.toml" }}\n{axes}'
    )
    return load_study(str(path))


def rough(task: Task) -> Flown:
    """A flight that takes no time: an error by too little thrust for its mass, and by a late radio."""
    e = json.loads(task.experiment)
    score = 0.1 + abs(e["plant"]["thrust_gain"] / e["plant"]["mass"] - 18.0) + e["radio"]["latency"]
    score += 10.0 * abs(e["plant"]["mass"] - 0.028)
    return Flown({"id": task.id, "outcome": "completed", "outcome_text": "", "rmse.position": score, "effort": 0.1})


LATENCY = '"radio.latency" = { uniform = [0.0, 0.02] }\n'


def test_whole_helicopters_are_drawn_so_that_what_goes_together_stays_together(folder):
    mine = study(folder, '{ kind = "latin_hypercube", points = 40 }', LATENCY)
    run_study(mine, folder / "out", backend=InProcess, work=rough)
    rows = rows_of(folder / "out")
    assert {row["plant"] for row in rows} == {f"draw_{i:02d}" for i in range(1, DRAWS + 1)}
    # Each of eight is as likely: five of forty points.
    counts = np.unique([row["plant"] for row in rows if row["alternative"] == "MPC"], return_counts=True)[1]
    assert set(counts.tolist()) == {5}
    # No mass meets the thrust of another helicopter.
    assert all(abs(row["rmse.position"] - 0.1 - row["radio.latency"]) < 0.04 for row in rows)
    assert "This needs independent axes" in write_report(folder / "out").read_text()


def test_a_grid_flies_every_helicopter_and_the_store_needs_no_file(folder):
    mine = study(folder, '"grid"')
    (folder / "ensemble.toml").unlink()
    assert plan_of(mine).count() == 2 * DRAWS
    run_study(mine, folder / "out", backend=InProcess, work=rough)
    assert "draw_08" in write_report(folder / "out").read_text()


def test_of_sobol_the_ensemble_is_one_axis_and_the_report_says_what_it_needs(folder):
    run_study(study(folder, '{ kind = "sobol", n = 16 }', LATENCY), folder / "out", backend=InProcess, work=rough)
    page = write_report(folder / "out").read_text()
    assert "This needs independent axes: of axes that really vary together it says nothing; an ensemble is one" in page


@pytest.mark.parametrize(
    ("design", "axes", "alternatives", "words"),
    [
        ('"morris"', "", '"a" = {}', "moves one parameter at a time, and those of an ensemble go together"),
        ('"margin"', "", '"a" = {}', "a margin is searched in a range"),
        ('"boundary"', LATENCY, '"a" = {}', "a boundary is searched in a range"),
        ('"sobol"', '"plant.mass" = { uniform = [0.02, 0.03] }', '"a" = {}', "is a part of axis 'plant', an ensemble"),
        ('"grid"', "", '"a" = { "plant.mass" = 0.03 }', "alternative 'a' changes plant.mass, which the ensemble of"),
        ('"grid"', "", '"a" = { plant = "ideal" }', "alternative 'a' changes plant, which the ensemble of"),
    ],
)
def test_what_an_ensemble_cannot_be_used_for_is_told(folder, design, axes, alternatives, words):
    with pytest.raises(StudyError) as refusal:
        plan_of(study(folder, design, axes, alternatives))
    assert words in str(refusal.value)
    assert len(str(refusal.value)) < 500


@pytest.mark.parametrize(
    ("written", "words"),
    [
        ("gone.toml", "cannot read the ensemble gone.toml: No such file"),
        ({}, "an ensemble is the name of a file that `heli-twin calibrate --out DIR` writes, not {}"),
        (5, "an ensemble is the name of a file"),
    ],
)
def test_a_file_that_is_no_ensemble_is_told(written, words):
    with pytest.raises(StudyError) as refusal:
        plan_of(study_of({"axes": {"plant": {"ensemble": written}}}))
    assert words in str(refusal.value)


def test_a_file_of_something_else_is_told(folder):
    (folder / "ensemble.toml").write_text('[alternatives]\nMPC = { controller = "ltv_mpc" }\n')
    with pytest.raises(StudyError, match=r"holds no ensemble .* writes DIR/ensemble.toml"):
        study(folder, '"grid"')
