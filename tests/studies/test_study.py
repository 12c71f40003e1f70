import json

import pytest

from heli_twin.errors import HeliTwinError
from heli_twin.studies.designs import Point
from heli_twin.studies.plan import PlannedFlight, StudyPlan, plan_of, run_id
from heli_twin.studies.study import load_study, shipped, study_of

SMALLEST = """
replicates = 3
[base.controller]
kind = "ltv_mpc"
[axes]
"plant.mass" = { linspace = [0.024, 0.034, 3] }
controller = [ { kind = "ltv_mpc" }, { kind = "pid" } ]
"""


def runs_of(plan: StudyPlan) -> list[PlannedFlight]:
    return list(plan.runs(next(plan.batches())))


def study_file(tmp_path, text):
    path = tmp_path / "mine.toml"
    path.write_text(text)
    return str(path)


def test_the_smallest_file_is_a_whole_study(tmp_path):
    plan = plan_of(load_study(study_file(tmp_path, SMALLEST)))
    runs = runs_of(plan)
    assert plan.study.name == "mine"
    assert [a.name for a in plan.space.alternatives] == ["ltv_mpc", "pid"]
    assert len(runs) == plan.count() == 3 * 3 * 2


def test_every_point_is_flown_with_the_same_seeds(tmp_path):
    runs = runs_of(plan_of(load_study(study_file(tmp_path, SMALLEST), ["seed=7"])))
    seeds: dict = {}
    for run in runs:
        assert json.loads(run.experiment)["seed"] == run.coordinates["seed"]
        seeds.setdefault((run.coordinates["point"], run.coordinates["alternative"]), []).append(run.coordinates["seed"])
    assert set(map(tuple, seeds.values())) == {(7, 8, 9)}


def test_an_axis_changes_its_field_and_no_other():
    study = study_of({"axes": {"plant.mass": [0.028, 0.03], "controller.horizon": {"linspace": [10, 18, 2]}}})
    plan = plan_of(study)
    base = json.loads(plan.space.base)
    for run in runs_of(plan):
        tree = json.loads(run.experiment)
        assert tree["plant"].pop("mass") == run.coordinates["plant.mass"]
        assert tree["controller"].pop("horizon") == run.coordinates["controller.horizon"]
        assert type(run.coordinates["controller.horizon"]) is int
        expected = json.loads(json.dumps(base))
        del expected["plant"]["mass"], expected["controller"]["horizon"]
        assert tree == expected


def test_ids_are_of_the_experiment_not_of_how_it_was_written():
    short = runs_of(plan_of(study_of({"base": {"duration": 5, "plant": {"mass": 0.03}}})))
    spelt_out = runs_of(plan_of(study_of({"base": {"duration": 5.0}, "axes": {"plant.mass": [0.03]}, "name": "other"})))
    assert short[0].id == spelt_out[0].id
    assert short[0].id != runs_of(plan_of(study_of({"base": {"duration": 5.0}})))[0].id


def test_an_id_never_changes_by_itself():
    # printf '8\n{"seed":0}' | sha256sum, where 8 is the physics version.
    assert run_id('{"seed":0}') == "220f1360145b6761"


def test_distributions_are_drawn_the_same_every_time():
    tree = {
        "axes": {"plant.mass": {"normal": [0.028, 0.001]}, "radio.latency": {"uniform": [0.0, 0.02]}},
        "design": {"kind": "latin_hypercube", "points": 8},
    }
    first, second = (runs_of(plan_of(study_of(tree))) for _ in range(2))
    assert [run.id for run in first] == [run.id for run in second]
    masses = sorted(run.coordinates["plant.mass"] for run in first)
    assert masses[0] < 0.0275
    assert masses[-1] > 0.0285


def test_sobol_flies_each_mixture_of_two_matrices():
    tree = {
        "axes": {"plant.mass": {"uniform": [0.02, 0.03]}, "radio.latency": {"uniform": [0.0, 0.02]}},
        "design": {"kind": "sobol", "n": 4},
    }
    runs = {(r.coordinates["matrix"], r.coordinates["sample"]): r.coordinates for r in runs_of(plan_of(study_of(tree)))}
    assert len(runs) == 4 * (2 + 2)
    for sample in range(4):
        mixture = runs["plant.mass", sample]
        assert mixture["plant.mass"] == runs["B", sample]["plant.mass"]
        assert mixture["radio.latency"] == runs["A", sample]["radio.latency"]


def test_a_ladder_keeps_what_was_below():
    rungs = [{"name": "heavy", "plant": {"mass": 0.03}}, {"name": "late", "radio": {"latency": 0.01}}]
    plan = plan_of(study_of({"design": {"kind": "ladder", "rungs": rungs}}))
    top = json.loads(runs_of(plan)[-1].experiment)
    assert (top["plant"]["mass"], top["radio"]["latency"]) == (0.03, 0.01)


def test_a_point_can_be_for_one_alternative_and_seed():
    plan = plan_of(study_of({"alternatives": {"a": {}, "b": {"plant": {"mass": 0.03}}}, "replicates": 3}))
    (run,) = plan.runs([Point({}, {}, ("b",), (2,))])
    assert (run.coordinates["alternative"], run.coordinates["seed"]) == ("b", 2)


@pytest.mark.parametrize(
    ("tree", "words"),
    [
        ({"axes": {"plant.mas": [0.03]}}, "did you mean 'plant.mass'"),
        ({"axes": {"plant.mass": []}}, "axis 'plant.mass' is empty"),
        ({"axes": {"plant.mass": [0.03, 0.03]}}, "same value twice"),
        ({"axes": {"plant.mass": [0.03, 5.0]}}, "plant.mass = 5.0"),
        ({"axes": {"plant.mass": {"linspace": [1, 2]}}}, "linspace takes [start, stop, number]"),
        (
            {"axes": {"plant.mass": {"linspac": [1, 2, 3]}}},
            "write a list, or one of linspace, logspace, normal, uniform",
        ),
        ({"axes": {"plant.mass": {"normal": [0.03, 0.001]}}}, "is a distribution, of which a grid"),
        ({"axes": {"seed": [1, 2]}}, "replicates"),
        (
            {"axes": {"plant.mass": {"linspace": [0.02, 0.03, 500]}}, "replicates": 1000},
            "500,000 flights, more than max_runs",
        ),
        ({"design": {"kind": "sobol"}}, "needs something to vary"),
        (
            {"design": {"kind": "sobol", "n": 12}, "axes": {"plant.mass": [1], "radio.latency": [1]}},
            "power of 2, such as 16",
        ),
        ({"design": {"kind": "ladder"}}, "needs rungs"),
        ({"design": {"kind": "margin"}, "axes": {"plant.mass": [0.02, 0.03]}}, "a margin is searched in a range"),
        ({"design": {"kind": "worst_case"}, "axes": {"plant.mass": [0.02]}}, "one value only"),
        ({"design": {"kind": "gird"}}, "did you mean 'grid'"),
        ({"design": {}}, "design.kind is missing"),
        ({"replicats": 3}, "did you mean 'replicates'"),
        ({"replicates": 0}, "replicates = 0"),
        ({"score": "rmse.q"}, "unknown metric 'rmse.q'"),
        ({"base": {"preset": "idael"}}, "did you mean 'ideal'"),
        ({"base": {"duration": "long"}}, "duration = 'long'"),
        ({"alternatives": {"a": 3}}, "write the changes it stands for as a table"),
        ({"name": "../x"}, "it names a folder"),
    ],
)
def test_a_bad_study_is_one_sentence_that_helps(tree, words):
    with pytest.raises(HeliTwinError) as refusal:
        plan_of(study_of(tree))
    text = str(refusal.value)
    assert words in text
    assert "\n" not in text


def test_an_unreadable_file_is_one_sentence(tmp_path):
    with pytest.raises(HeliTwinError, match="not valid TOML"):
        load_study(study_file(tmp_path, "replicates = ["))
    with pytest.raises(HeliTwinError, match="did you mean 'ladder'"):
        load_study("lader")


def test_overrides_reach_the_study_and_its_base(tmp_path):
    path = study_file(tmp_path, SMALLEST)
    study = load_study(
        path, ["replicates=1", "duration=5", "axes.plant.mass=[0.03]", "plant=ideal", "design.kind=ladder"]
    )
    assert (study.replicates, study.base["duration"], study.axes["plant.mass"]) == (1, 5, [0.03])
    assert (study.base["plant"], study.design.kind) == ("ideal", "ladder")


@pytest.mark.parametrize("name", sorted(shipped()))
def test_every_shipped_study_can_be_flown(name):
    study = load_study(name)
    plan = plan_of(study)
    assert study.question.endswith("?")
    assert len(plan.space.alternatives) > 1 or plan.space.axes
    next(plan.runs(next(plan.batches())))
