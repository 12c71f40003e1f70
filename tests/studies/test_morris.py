"""Morris screening: SALib judges the measures, closed forms the effects, simulation the intervals, Sobol the ranks."""

import json

import numpy as np
import pytest
from in_process import InProcess

from heli_twin.experiment import Experiment
from heli_twin.experiment.tree import canonical_json
from heli_twin.reporting.intervals import screening, sobol
from heli_twin.studies.axes import Normal, Uniform, Values
from heli_twin.studies.campaign import run_study
from heli_twin.studies.designs.morris import Morris
from heli_twin.studies.designs.sobol import Sobol
from heli_twin.studies.errors import StudyError
from heli_twin.studies.plan import plan_of
from heli_twin.studies.report import write_report
from heli_twin.studies.report.morris import elementary_effects
from heli_twin.studies.report.results import results_of
from heli_twin.studies.report.sensitivity import _scores
from heli_twin.studies.space import Alternative, Space
from heli_twin.studies.study import study_of
from heli_twin.workers.task import Flown, Task

PATHS = ("plant.thrust_gain", "plant.pitch_gain", "plant.roll_gain", "plant.mass", "radio.latency", "mocap.latency")
WEIGHTS = np.array([0.0, 1.0, 4.5, 9.0, 99.0, 99.0])


def g_function(x: np.ndarray) -> np.ndarray:
    """Saltelli's and Sobol's test function of six inputs: the greater the weight, the less an input matters."""
    return np.prod((np.abs(4.0 * x - 2.0) + WEIGHTS) / (1.0 + WEIGHTS), axis=-1)


def space_of(seed=0, axes=None):
    axes = axes or dict.fromkeys(PATHS, Uniform(0.0, 1.0))
    base = canonical_json(Experiment())
    return Space(base, (Alternative("base", {}),), axes, range(seed, seed + 1), "rmse.position", 2.5)


def placed(design, space):
    (points,) = design.batches(space)
    points = list(points)
    return points, np.array([[point.changes[path] for path in space.axes] for point in points])


def effects_of(function, trajectories, seed=0, levels=4):
    """The elementary effects of a function, without a study."""
    points, x = placed(Morris(trajectories=trajectories, levels=levels), space_of(seed))
    y, found = function(x), np.empty((trajectories, len(PATHS)))
    for i, point in enumerate(points):
        if point.labels["moved"]:
            found[point.labels["trajectory"], PATHS.index(point.labels["moved"])] = (y[i] - y[i - 1]) / point.labels[
                "by"
            ]
    return x, y, found


def test_mu_star_and_sigma_are_those_of_salib():
    from SALib.analyze.morris import analyze

    x, y, effects = effects_of(g_function, 30)
    problem = {"num_vars": 6, "names": list(PATHS), "bounds": [[0.0, 1.0]] * 6}
    judge = analyze(problem, x, y, num_levels=4, seed=1)
    found = screening(effects)
    np.testing.assert_allclose([f.value for f in found.mu_star], judge["mu_star"], rtol=1e-9)
    np.testing.assert_allclose([f.value for f in found.sigma], judge["sigma"], rtol=1e-9)


def test_each_trajectory_moves_every_axis_once_and_all_levels_are_as_likely():
    points, x = placed(Morris(trajectories=400), space_of())
    moved = np.array([point.labels["moved"] for point in points]).reshape(400, 7)
    assert all(sorted(row[1:]) == sorted(PATHS) for row in moved)
    assert {tuple(sorted(np.flatnonzero(d))) for d in np.diff(x.reshape(400, 7, 6), axis=1).reshape(-1, 6)} == {
        (i,) for i in range(6)
    }
    levels, counts = np.unique(x.round(9), return_counts=True)
    np.testing.assert_allclose(levels, [0, 1 / 3, 2 / 3, 1], atol=1e-9)
    # 16800 values: the share of a level is known to 0.01, four standard deviations of independent trajectories.
    np.testing.assert_allclose(counts / counts.sum(), 0.25, atol=0.02)


def test_a_distribution_is_moved_between_its_5_and_95_percent_and_a_list_over_its_values():
    axes = {"plant.mass": Normal(0.028, 0.001), "controller.horizon": Values((10, 14, 18, 20))}
    _, x = placed(Morris(trajectories=30), space_of(axes=axes))
    assert (x[:, 0].min(), x[:, 0].max()) == pytest.approx((0.028 - 0.001645, 0.028 + 0.001645), abs=1e-6)
    assert set(x[:, 1]) == {10, 14, 18, 20}


def test_of_a_linear_function_mu_star_is_the_slope_and_sigma_nothing():
    slopes = np.arange(1.0, 7.0)
    _, _, effects = effects_of(lambda x: x @ slopes, 5)
    found = screening(effects)
    np.testing.assert_allclose([f.value for f in found.mu_star], slopes)
    np.testing.assert_allclose([f.value for f in found.sigma], 0.0, atol=1e-12)


def coverage(trajectories, repetitions, many=4000):
    _, _, many = effects_of(g_function, many, seed=9999)
    mu, sigma = np.abs(many).mean(axis=0), many.std(axis=0)
    inside = np.zeros((2, 6))
    for seed in range(repetitions):
        found = screening(effects_of(g_function, trajectories, seed)[2])
        for row, (intervals, truth) in enumerate(((found.mu_star, mu), (found.sigma, sigma))):
            inside[row] += [f.low <= value <= f.high for f, value in zip(intervals, truth, strict=True)]
    return inside / repetitions


def test_the_intervals_hold_the_truth_as_often_as_they_say():
    # 95 %, less three standard deviations of 50 repetitions.
    assert (coverage(20, 50) >= 0.86).all()


@pytest.mark.long
@pytest.mark.parametrize("trajectories", [10, 20, 40])
def test_the_intervals_hold_the_truth_in_94_percent_of_many_repetitions(trajectories):
    found = coverage(trajectories, 1000, 20_000)
    print(trajectories, found.round(3).tolist())
    # 94 %, less two standard deviations of 1000 repetitions.
    assert (found >= 0.925).all()


def test_the_ranks_are_those_of_sobols_total_indices():
    points, x = placed(Sobol(n=1024), space_of())
    matrix = np.array([point.labels["matrix"] for point in points])
    y = g_function(x)
    total = [
        f.value for f in sobol(y[matrix == "A"], y[matrix == "B"], np.array([y[matrix == p] for p in PATHS])).total
    ]
    mu = [f.value for f in screening(effects_of(g_function, 40)[2]).mu_star]
    # The last two are the same input twice.
    assert np.argsort(total)[::-1][:4].tolist() == np.argsort(mu)[::-1][:4].tolist() == [0, 1, 2, 3]


def rough(task: Task) -> Flown:
    """A flight that takes no time: the gust matters most, the mass together with it, the radio not at all."""
    e = json.loads(task.experiment)
    gust = e["disturbances"]["gust"]["strength"]
    score = gust**2 + 2.0 * gust * (e["plant"]["mass"] - 0.028) / 0.028 + 0.5
    row = {"id": task.id, "outcome": "crashed" if score > 1.6 else "completed", "outcome_text": ""}
    return Flown(row if score > 1.6 else {**row, "rmse.position": score, "effort": 0.1})


TREE = {
    "name": "morris",
    "base": {"preset": "lab", "duration": 1.0},
    "axes": {
        "radio.latency": {"uniform": [0.0, 0.02]},
        "disturbances.gust.strength": {"uniform": [0.0, 1.0]},
        "plant.mass": {"uniform": [0.026, 0.032]},
    },
    "alternatives": {"first": {}, "second": {"controller": {"coupling": "full"}}},
    "replicates": 2,
    "design": {"kind": "morris", "trajectories": 12},
}


def test_a_study_reports_ranks_with_intervals_and_says_what_may_be_left_out(tmp_path):
    run_study(study_of(TREE), tmp_path, backend=InProcess, work=rough)
    results = results_of(tmp_path)
    effects = elementary_effects(results.of("second"), list(results.axes))
    assert effects.shape == (12, 3)
    assert np.abs(effects).mean(axis=0).argsort().tolist() == [0, 2, 1]
    page = write_report(tmp_path).read_text()
    assert "a Sobol study may leave out radio.latency" in page
    assert "This needs independent axes" in page
    assert len(results) == plan_of(study_of(TREE)).count() == 12 * 4 * 2 * 2


def test_what_cannot_be_screened_is_told():
    with pytest.raises(StudyError, match=r"design.levels = 5: it must be even, .* 6"):
        plan_of(study_of({**TREE, "design": {"kind": "morris", "levels": 5}}))
    with pytest.raises(StudyError, match="has one value only"):
        plan_of(study_of({**TREE, "axes": {"plant.mass": [0.03]}}))


@pytest.mark.long
def test_morris_and_sobol_agree_on_the_twin(tmp_path):
    """Which uncertainty the error of a hover comes from: 60 flights find the same first ones as 224."""
    tree = {
        "base": {"preset": "lab", "duration": 5.0, "trajectory": "hover", "controller": "pid"},
        "axes": {
            "plant.pitch_trim": {"uniform": [-0.1, 0.1]},
            "disturbances.gust.strength": {"uniform": [0.02, 0.2]},
            "plant.attitude_frequency": {"uniform": [10.0, 18.0]},
            "radio.latency": {"uniform": [0.001, 0.03]},
            "plant.yaw_trim": {"uniform": [-0.01, 0.01]},
        },
        "score": "rmse.position",
    }
    ranked = {}
    for kind, size in (("morris", {"trajectories": 10}), ("sobol", {"n": 32})):
        run_study(study_of({**tree, "name": kind, "design": {"kind": kind, **size}}), tmp_path / kind)
        results = results_of(tmp_path / kind)
        if kind == "morris":
            values = [f.value for f in screening(elementary_effects(results, results.axes)).mu_star]
        else:
            A, B, *AB = (_scores(results, matrix, 32) for matrix in ("A", "B", *results.axes))
            values = [f.value for f in sobol(A, B, np.array(AB)).total]
        print(kind, len(results), dict(zip(results.axes, np.round(values, 4), strict=True)))
        ranked[kind] = [results.axes[i] for i in np.argsort(values)[::-1]]
    assert ranked["morris"][:2] == ranked["sobol"][:2]
    assert set(ranked["morris"][:3]) == set(ranked["sobol"][:3])
