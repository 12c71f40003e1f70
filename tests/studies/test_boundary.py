"""The boundary of failures: known functions judge the map and its uncertainty; a study goes on; the twin's own grid."""

import json
from dataclasses import replace

import numpy as np
import pytest
from in_process import InProcess
from threadpoolctl import threadpool_limits

from heli_twin.studies.axes import Linspace, Logspace, Uniform, share_of
from heli_twin.studies.campaign import run_study
from heli_twin.studies.designs import boundary as boundary_design
from heli_twin.studies.designs.boundary import places_and_scores, response
from heli_twin.studies.designs.grid import Grid
from heli_twin.studies.errors import StudyError
from heli_twin.studies.plan import plan_of
from heli_twin.studies.report import progress, write_report
from heli_twin.studies.results import rows_of
from heli_twin.studies.straddle import fitted, next_places, share_above, spread_places
from heli_twin.studies.study import load_study, study_of
from heli_twin.workers.task import Flown, Task

LIMIT = 0.25


def scores_of(seed: int, axes: int = 2, *, crash: bool = False):
    """Scores over the unit cube: the exponential of a random smooth function, with a crash where it is great."""
    rng = np.random.default_rng(seed)
    waves = rng.standard_normal((200, axes)) / rng.uniform(0.25, 0.6)
    phases, sizes = rng.uniform(0.0, 2.0 * np.pi, 200), rng.standard_normal(200) * 0.1
    shift = rng.uniform(-0.8, 0.8)

    def score(places):
        value = LIMIT * np.exp(np.cos(places @ waves.T + phases) @ sizes + shift)
        return np.where(value > 0.5, 2.5, value) if crash else value

    return score


def learned(score, axes=2, points=80, first=20, seed=0):
    places = spread_places(axes, 5, seed)[:first]
    while len(places) < points:
        places = np.vstack([places, next_places(places, response(score(places), LIMIT), 5, seed)])
    return fitted(places, response(score(places), LIMIT))


def judged(seed, axes=2, crash=False, points=80):
    """The true share that fails, its interval, and the shares that are wrong and surely wrong."""
    score = scores_of(seed, axes, crash=crash)
    surrogate = learned(score, axes, points)
    truth = score(spread_places(axes, 13, 7)) > LIMIT
    chance = surrogate.above(spread_places(axes, 13, 7))
    sure = np.mean((chance > 0.975) & ~truth) + np.mean((chance < 0.025) & truth)
    return truth.mean(), share_above(surrogate, axes), np.mean((chance > 0.5) != truth), sure


@pytest.mark.parametrize("crash", [False, True])
def test_a_boundary_is_known_from_few_points_and_rarely_surely_wrong(crash):
    truth, share, wrong, sure = judged(5, crash=crash, points=50)
    assert 0.1 < truth < 0.9
    assert wrong < 0.01
    assert sure < 0.002
    # The truth is itself known to a part in a thousand.
    assert share.low - 0.001 <= truth <= share.high + 0.001


@pytest.mark.long
@pytest.mark.parametrize(
    ("axes", "crash", "points", "repetitions"), [(2, False, 80, 60), (2, True, 80, 60), (6, True, 160, 20)]
)
def test_the_interval_of_the_failing_share_holds_it(axes, crash, points, repetitions):
    found = [judged(seed, axes, crash, points) for seed in range(repetitions)]
    inside = [share.low <= truth <= share.high for truth, share, _, _ in found]
    wrong = [each for _, _, each, _ in found]
    print(f"{axes} axes: {np.mean(inside):.3f} inside; wrong {np.mean(wrong):.4f}, at most {max(wrong):.4f}")
    # 95 %, less two standard deviations of so many repetitions.
    assert np.mean(inside) >= 0.95 - 2.0 * (0.95 * 0.05 / repetitions) ** 0.5


def test_points_go_where_the_side_is_least_certain():
    places = spread_places(2, 4, 0)
    values = places[:, 0] - 0.6
    chosen = next_places(places, values, 4, 0)
    assert len({tuple(place) for place in chosen}) == 4
    surrogate = fitted(np.vstack([places, chosen]), np.append(values, chosen[:, 0] - 0.6))
    mean, deviation = surrogate.predict(np.array([[0.1, 0.5], [0.6, 0.5]]))
    assert abs(mean[0] + 0.5) < 0.05
    assert deviation[1] < 0.1
    with threadpool_limits(2):
        assert (next_places(places, values, 4, 0) == chosen).all()


def test_what_is_far_from_the_limit_hides_nothing():
    far = response(np.array([0.0, 0.125, 0.25, 0.5, 2.5]), 0.25)
    np.testing.assert_allclose(far, [-1.0, -1 / 3, 0.0, 1 / 3, 9 / 11])
    # The excess over a requirement: by half of its limit, and by ten times of it.
    np.testing.assert_allclose(response(np.array([-0.5, 0.0, 0.5, 10.0]), 0.0), [-0.2, 0.0, 0.2, 10 / 12])


@pytest.mark.parametrize("axis", [Linspace(0.02, 0.03, 4), Logspace(0.01, 1.0, 4), Uniform(-1.0, 3.0)])
def test_the_share_of_a_value_is_that_of_its_quantile(axis):
    assert [share_of(axis, axis.quantile(p)) for p in (0.0, 0.3, 1.0)] == pytest.approx([0.0, 0.3, 1.0])


def test_the_score_of_a_point_is_the_median_of_its_flights_and_invalid_ones_say_nothing():
    def row(asked, outcome, score):
        return {"asked": asked, "outcome": outcome, "s": score, "a": 0.1 * asked}

    rows = [row(0, "completed", 0.1), row(0, "crashed", None), row(0, "broken", 0.3), row(1, "invalid", None)]
    places, scores = places_and_scores(rows, {"a": Uniform(0.0, 1.0)}, "s", 2.5)
    assert (places.tolist(), scores.tolist()) == ([[0.0]], [0.3])


# --- a study

FREQUENCY, LATENCY = "plant.attitude_frequency", "radio.latency"
TREE = {
    "name": "edge",
    "base": {"preset": "lab", "duration": 4.0},
    "alternatives": {"MPC": {}, "PID": {"controller": "pid"}},
    "axes": {FREQUENCY: {"uniform": [3.0, 16.0]}, LATENCY: {"uniform": [0.0, 0.2]}},
    "score": "sustained.position",
    "metrics": ["sustained.position"],
    "design": {"kind": "boundary", "limit": 0.25, "points": 26, "first": 16},
}
THREE = TREE | {"axes": TREE["axes"] | {"plant.mass": {"uniform": [0.022, 0.036]}}}


def rough(task: Task) -> Flown:
    """A flight that takes no time: late radio and slow attitude make it err, and it crashes in the end."""
    e = json.loads(task.experiment)
    score = 0.05 * np.exp(e["radio"]["latency"] / 0.05) * (6.0 / e["plant"]["attitude_frequency"]) ** 1.5
    score *= (e["plant"]["mass"] / 0.028) ** 4 * (1.3 if e["controller"]["kind"] == "pid" else 1.0)
    row = {"id": task.id, "outcome": "diverged" if score > 0.5 else "completed", "outcome_text": ""}
    return Flown(row if score > 0.5 else {**row, "sustained.position": float(score), "effort": 0.1})


class Stopped(Exception):
    pass


def test_a_study_is_the_same_in_one_go_and_in_two_and_its_page_tells_it(tmp_path):
    run_study(study_of(TREE), tmp_path / "one", backend=InProcess, work=rough)
    left = iter(range(41))

    def stops(task):
        if next(left, None) is None:
            raise Stopped
        return rough(task)

    class Dies(InProcess):
        def trouble(self, error):
            raise error

    with pytest.raises(Stopped):
        run_study(study_of(TREE), tmp_path / "two", backend=Dies, work=stops)
    assert "Boundary" in [section.title for section in progress._parts(tmp_path / "two")]
    again = run_study(study_of(TREE), tmp_path / "two", backend=InProcess, work=rough)
    assert again.flown == 2 * 26 - 41
    one, two = (rows_of(tmp_path / name) for name in ("one", "two"))
    assert one == two
    assert len(one) == plan_of(study_of(TREE)).count()
    near = [row for row in one if row["asked"] >= 16]
    assert np.median([abs(np.log((row["sustained.position"] or 2.5) / 0.25)) for row in near]) < 0.3
    page = write_report(tmp_path / "one").read_text()
    assert "MPC fails on 4" in page
    assert "PID fails on 5" in page
    assert "Failing is a sustained position error above 25 cm, or a crash." in page
    assert (tmp_path / "one" / "figures" / "boundary.svg").read_text().count("% fail") == 2


def test_three_axes_are_drawn_as_slices_through_the_base(tmp_path):
    tree = THREE | {"alternatives": {}, "design": TREE["design"] | {"points": 22, "first": 20, "round": 1}}
    run_study(study_of(tree), tmp_path, backend=InProcess, work=rough)
    page = write_report(tmp_path).read_text()
    assert "Slices through plant.attitude_frequency 14 rad/s, radio.latency 5 ms and plant.mass 28 g." in page
    assert (tmp_path / "figures" / "boundary-0.svg").read_text().count("% fail") == 3


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            {"axes": {LATENCY: {"uniform": [0.0, 0.2]}}},
            "in 2 to 6 axes, not 1: of one axis take design.kind = 'margin'",
        ),
        (
            {"axes": {**TREE["axes"], "plant.mass": [0.02, 0.03]}},
            "axis 'plant.mass': a boundary is searched in a range",
        ),
        ({"design": {"kind": "boundary", "points": 20}}, "design.first = 20: it has to be below design.points = 20"),
        ({"penalty": 0.2}, "it has to be below the score of a crash, penalty = 0.2"),
    ],
)
def test_what_has_no_boundary_is_told(change, words):
    with pytest.raises(StudyError) as refusal:
        plan_of(study_of({**TREE, **change}))
    assert words in str(refusal.value)


def test_without_scikit_learn_it_says_what_to_install(monkeypatch):
    monkeypatch.setattr(boundary_design, "find_spec", lambda name: None)
    with pytest.raises(StudyError, match=r"pip install 'heli-twin\[boundary\]'"):
        plan_of(study_of(TREE))


@pytest.mark.long
def test_eighty_flights_map_what_four_hundred_do(tmp_path):
    """Attitude bandwidth and delay of the loop, in the lab: 20 x 20 flights against the boundary from 80."""
    shipped = load_study("boundary")
    few, many = tmp_path / "few", tmp_path / "many"
    run_study(shipped, few)
    spans = {path: written["uniform"] for path, written in shipped.axes.items()}
    axes = {path: {"linspace": [*ends, 20]} for path, ends in spans.items()}
    run_study(replace(shipped, name="grid", axes=axes, design=Grid()), many)
    ranges = {path: Uniform(*ends) for path, ends in spans.items()}
    places, scores = places_and_scores(rows_of(few), ranges, shipped.score, shipped.penalty)
    assert len(scores) == 80
    by_cell = [{**row, "asked": row["point"]} for row in rows_of(many)]
    cells, truth = places_and_scores(by_cell, ranges, shipped.score, shipped.penalty)
    limit = shipped.design.limit
    chance = fitted(places, response(scores, limit)).above(cells)
    wrong = np.mean((chance > 0.5) != (truth > limit))
    print(f"{100 * wrong:.2f} % of 400 cells in disagreement, {100 * np.mean(truth > limit):.1f} % of them fail")
    assert wrong < 0.03
