"""Studies of several helicopters: any field of the room and of every helicopter is an axis."""

import pytest

from heli_twin.experiment.differences import fly_words
from heli_twin.experiment.several_text import load_several
from heli_twin.experiment.several_written import several_from_json, several_json
from heli_twin.studies.errors import StudyError
from heli_twin.studies.plan import StudyPlan, plan_of
from heli_twin.studies.study import load_study, study_of
from heli_twin.studies.work import fly_task
from heli_twin.workers.task import Flown, Task

BASE = {"preset": "pair", "coordination": "none", "base": "lab_simple", "duration": 0.4, "scenario.radius": 0.3}


def planned(**changes: object) -> StudyPlan:
    tree = {"base": BASE, "score": "missing", "requirements": {"apart": "always distance > 0.25 m"}} | changes
    return plan_of(study_of(tree))


def test_numbers_losses_masses_and_seeds_are_axes():
    axes = {"scenario.ships": [2, 3], "network.loss": [0.0, 0.3], "plant.mass": [0.027, 0.028]}
    plan = planned(axes=axes, replicates=2)
    runs = [run for batch in plan.batches() for run in plan.runs(batch)]
    assert len({run.id for run in runs}) == 16
    for run in runs:
        several = several_from_json(run.experiment)
        fleet = several.fleet().values()
        assert len(fleet) == run.coordinates["scenario.ships"]
        assert several.network.loss == run.coordinates["network.loss"]
        assert {e.plant.mass for e in fleet} == {run.coordinates["plant.mass"]}  # pyright: ignore[reportAttributeAccessIssue]
        assert {e.seed for e in fleet} == {run.coordinates["seed"]}
        assert load_several(*_command(run.experiment)) == several


def _command(experiment: str) -> tuple[str, list[str]]:
    preset, *overrides = fly_words(experiment)
    return preset, overrides


@pytest.mark.parametrize(
    "words",
    [
        ("swap8", "scenario=random", "scenario.draw=3", "seed=3"),
        (
            "pair",
            "ships.a.plant.mass=0.03",
            "ships.c.trajectory=hover",
            "ships.c.trajectory.y=1",
            "disturbances.gust=off",
        ),
        ("formation", "base=lab_simple", "controller=pid", "faults.pose_outage=on", 'shared=["gust"]'),
        ("pair", "world=shared", "transmitters=one"),
    ],
)
def test_the_shortest_command_flies_the_same(words: tuple[str, ...]):
    several = load_several(words[0], words[1:])
    preset, overrides = _command(several_json(several))
    assert load_several(preset, overrides) == several
    assert len(overrides) <= len(words) + 1


def test_a_row_tells_of_all_and_the_requirement_of_the_nearest():
    plan = planned()
    (run,) = (run for batch in plan.batches() for run in plan.runs(batch))
    task = Task(run.id, run.experiment, "missing", False, True, None, requirements=plan.study.requirements)
    flown = fly_task(task)
    assert isinstance(flown, Flown)
    row = flown.row
    assert row["outcome"] == "completed"
    assert row["missing"] == row["ships"] == 2
    assert row["nearest.ships"] == "a b"
    assert row["excess.apart"] == pytest.approx(1 - row["least_distance"] / 0.25, abs=0.01)
    assert row["digest"]


def test_metrics_of_several_need_several():
    with pytest.raises(StudyError, match="unknown metric 'missing'"):
        planned(base={"preset": "lab"})
    with pytest.raises(StudyError, match="unknown metric 'mising': did you mean 'missing'"):
        planned(score="mising")


@pytest.mark.parametrize("name", ["room_ships", "room_messages", "room_gusts", "room_downwash"])
def test_shipped_studies_of_rooms_can_be_flown(name: str):
    assert plan_of(load_study(name)).count() > 1
