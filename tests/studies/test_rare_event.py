"""Rare events: a linear plant with a closed-form answer judges the estimate and its interval; the study goes on."""

import json
from math import inf

import numpy as np
import pytest
from in_process import InProcess
from scipy.stats import norm

from heli_twin.lab.chance import mixed
from heli_twin.studies.campaign import run_study
from heli_twin.studies.designs.rare_event import estimate_of
from heli_twin.studies.errors import StudyError
from heli_twin.studies.least_failure import (
    RANDOM,
    length,
    narrowings,
    parts_of,
    random_states,
    some_of,
    steepest,
)
from heli_twin.studies.plan import plan_of
from heli_twin.studies.report import write_report
from heli_twin.studies.report.rare_event import searches, told_rare_event
from heli_twin.studies.report.results import results_of
from heli_twin.studies.results import rows_of
from heli_twin.studies.study import study_of
from heli_twin.studies.subset_simulation import State, fresh, mean_state, moved, scaled, size, subset_simulation
from heli_twin.workers.task import Flown, Task

DIMENSIONS = 10


def linear(state: State) -> float:
    """A standard normal number: the sum of all axes and of the noise, scaled."""
    noise = mixed(state.noise)(0, "gust").standard_normal(DIMENSIONS)
    return float((np.sum(noise) + np.sum(state.place)) / np.sqrt(DIMENSIONS + len(state.place)))


def searched(limit, samples=200, levels=6, seed=0, score=linear, axes=2):
    search = subset_simulation(axes, limit, samples, levels, seed)
    states = next(search)
    try:
        while True:
            states = search.send([score(state) for state in states])
    except StopIteration as end:
        return end.value


def covered(repetitions, probability, samples, seed=0):
    limit = norm.isf(probability)
    found = [searched(limit, samples, seed=seed + i) for i in range(repetitions)]
    return [estimate.low <= probability <= estimate.high for estimate in found], found


def test_the_interval_holds_the_probability_of_a_linear_plant():
    inside, found = covered(8, 1e-3, 200)
    assert sum(inside) >= 6
    assert np.mean([estimate.probability for estimate in found]) == pytest.approx(1e-3, rel=0.5)
    assert all(estimate.high / estimate.low < 30.0 for estimate in found)


@pytest.mark.long
def test_at_one_in_a_hundred_thousand_184_of_200_intervals_hold_it():
    inside, found = covered(200, 1e-5, 1080, seed=1000)
    print(f"{sum(inside)} of 200; mean {np.mean([e.probability for e in found]):.3g}")
    assert max(estimate.evaluations for estimate in found) <= 6000
    assert sum(inside) >= 184


def test_what_is_not_rare_is_plain_monte_carlo_with_its_textbook_interval():
    found = searched(norm.isf(0.3), samples=1000)
    failures = found.probability * 1000
    assert (len(found.levels), found.evaluations) == (1, 1000)
    assert found.probability == pytest.approx(0.3, abs=0.05)
    width = 1.96 * np.sqrt((1.0 - found.probability) / failures)
    assert np.log(found.high / found.probability) == pytest.approx(width, rel=0.02)


def test_the_same_seed_finds_the_same_and_another_one_something_else():
    one, again, other = (searched(2.0, seed=seed) for seed in (3, 3, 4))
    assert (one.probability, one.failures) == (again.probability, again.failures)
    assert one.probability != other.probability


def test_where_nothing_fails_there_is_an_upper_limit():
    found = searched(100.0, samples=50, levels=2)
    assert (found.probability, found.low, found.failures) == (0.0, 0.0, ())
    assert found.high == pytest.approx(3.0 * 0.1 / 50)


def test_crashes_are_above_every_score():
    found = searched(5.0, samples=100, score=lambda state: inf if linear(state) > 1.0 else linear(state))
    assert found.probability == pytest.approx(norm.sf(1.0), abs=0.1)


def test_a_step_keeps_the_distribution_and_its_share_of_the_state():
    state, share = fresh(1, 500), 0.6
    other = moved(state, share, 2)
    assert sum(w * w for _, w in other.noise) == pytest.approx(1.0)
    new = np.array(fresh(2, 500).place)
    assert np.array(other.place) == pytest.approx(0.8 * np.array(state.place) + 0.6 * new)
    assert other.noise == ((1, pytest.approx(0.8)), (2, 0.6))


def test_the_mean_failure_is_near_the_most_likely_one():
    found = searched(norm.isf(1e-3), samples=400)
    mean = mean_state(found.failures)
    assert linear(mean) > norm.isf(1e-3)
    # The most likely failure has this distance in all; single failures have about the root of the dimensions.
    assert linear(scaled(mean, 0.5)) == pytest.approx(0.5 * linear(mean))
    assert size(mean)[1] < 0.6
    assert size(State((3.0, 4.0), ((1, 0.6), (2, 0.8)))) == (5.0, 1.0)


GUST = "disturbances.gust.strength"
TREE = {
    "name": "rare",
    "base": {"preset": "ideal", "duration": 1.0, "disturbances": {"gust": "on"}},
    "axes": {GUST: {"uniform": [0.0, 1.0]}},
    "alternatives": {"first": {}, "second": {"controller": {"coupling": "full"}}},
    "design": {"kind": "rare_event", "limit": 1.5, "samples": 50, "levels": 3},
}


def noisy(task: Task) -> Flown:
    """A flight that takes no time: its score is its gust and one normal number of its noise."""
    experiment = json.loads(task.experiment)
    noise = mixed([tuple(part) for part in experiment["noise"]])(0, "gust").standard_normal()
    score = experiment["disturbances"]["gust"]["strength"] + 0.5 * float(noise)
    crashed = score > 2.2
    row = {"id": task.id, "outcome": "crashed" if crashed else "completed", "outcome_text": ""}
    return Flown(row if crashed else {**row, "rmse.position": score}, b"log" if task.keep_log else None)


class Stopped(Exception):
    pass


def stops_after(number):
    left = iter(range(number))

    def work(task):
        if next(left, None) is None:
            raise Stopped
        return noisy(task)

    return work


def test_a_study_of_a_rare_event_is_the_same_in_one_go_and_in_two(tmp_path):
    study = study_of(TREE)
    run_study(study, tmp_path / "one", backend=InProcess, work=noisy)

    class Dies(InProcess):
        def trouble(self, error):
            raise error

    with pytest.raises(Stopped):
        run_study(study, tmp_path / "two", backend=Dies, work=stops_after(130))
    run_study(study, tmp_path / "two", backend=InProcess, work=noisy)
    one, two = (rows_of(tmp_path / name) for name in ("one", "two"))
    assert [(row["id"], row["state"], row["rmse.position"]) for row in one] == [
        (row["id"], row["state"], row["rmse.position"]) for row in two
    ]
    mine = [row for row in one if row["alternative"] == "second" and row["change"] == "search"]
    scores = [inf if row["rmse.position"] is None else row["rmse.position"] for row in mine]
    found = estimate_of(study.design, 1, 0, scores)
    assert found.evaluations == len(scores)
    # Of a uniform number and half a normal one, 4.15 % exceed 1.5.
    assert found.low < 0.0415 < found.high
    assert estimate_of(study.design, 1, 0, scores[:-1]) is None


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """One alternative; half a normal number from 0.5 on reaches the limit at two standard deviations."""
    out = tmp_path_factory.mktemp("least") / "rare"
    run_study(
        study_of({**TREE, "alternatives": {}, "logs": {"failed": 0, "worst": 0, "sampled": 0}}),
        out,
        backend=InProcess,
        work=noisy,
    )
    return results_of(out)


def test_the_least_failure_just_fails_and_none_is_found_where_there_is_none(found):
    (search,) = searches(found)
    score, noise = found["rmse.position"], found["noise_size"].astype(float)
    assert set(search.least) == {"all", "noise"}
    for change, least in search.least.items():
        mine = np.flatnonzero(found["change"] == change)
        assert change == "all" or not (score[mine][noise[mine] < least.noise] >= 1.5).any()
        # Two passes of eight flights: a 64th of the changes that are tried.
        assert 1.5 <= score[least.row] < 1.5 + 0.05
    # Without noise the strongest gust has a score of 1.
    assert found[GUST][search.least["noise"].row] == 0.5
    assert search.least["noise"].axes == 0.0
    told = list(told_rare_event(found))
    assert told[-1] == "  axes alone: none found"
    least = search.least["all"]
    assert told[1].startswith(
        f"  least change that fails: {least.noise:.2f} of usual noise, {least.axes:.1f} standard deviations: {GUST} "
    )


def test_the_log_of_the_least_failure_is_kept_and_named(found):
    (search,) = searches(found)
    log = found.folder / "logs" / f"{found['id'][search.least['all'].row]}.mcap"
    assert log.exists()
    assert any(str(log) in line and "replay" in line for line in told_rare_event(found))
    page = write_report(found.folder).read_text()
    assert str(log) in page
    assert f"{search.estimate.probability:.2g}" in page
    assert "of usual noise" in page


def test_random_directions_are_as_far_as_the_least_failure_and_fail_seldom(found):
    (search,) = searches(found)
    least = search.least["all"]
    rows = found.where(found["change"] == "random")
    assert len(rows) == RANDOM
    for state in random_states(State((0.6, -0.8), ((5, 0.6), (7, 0.8))), 10**12 - RANDOM):
        assert size(state) == pytest.approx((1.0, 1.0))
    assert (search.random >= 1.5).mean() < 0.5
    # One axis: up or down by as much.
    far = {round(abs(norm.ppf(value)), 6) for value in rows[GUST]}
    assert far == {round(least.axes, 6)}


def test_several_replicates_and_a_limit_above_a_crash_are_refused():
    with pytest.raises(StudyError, match="leave replicates at 1"):
        plan_of(study_of({**TREE, "replicates": 3}))
    with pytest.raises(StudyError, match="it has to be below the score of a crash"):
        plan_of(study_of({**TREE, "penalty": 1.0}))


def test_the_number_of_flights_is_told_before():
    plan = plan_of(study_of(TREE))
    assert plan.count() == 2 * (50 + 2 * 45 + 4 * 16 + 16 + 20)


def test_where_flights_fail_in_many_ways_their_small_mean_is_scaled_up_to_all_usual_noise():
    everything, noise, axes = narrowings(State((0.3, 0.4), ((1, 0.06), (2, 0.08))))
    assert [size(scaled(each.state, each.high)) for each in (everything, noise, axes)] == [
        pytest.approx((5.0, 1.0)),
        pytest.approx((0.0, 1.0)),
        pytest.approx((4.0, 0.0)),
    ]
    assert [each.change for each in narrowings(State((), ((1, 1.0),)))] == ["all"]


def test_the_nearest_failure_of_a_linear_plant_is_found_in_the_span_of_the_parts():
    """With three independent parts of slopes 3, 0 and -4 the nearest failure lies along (3, 0, -4), nearer than any."""
    parts = [State((), ((seed, 1.0),)) for seed in (1, 2, 3)]
    direction = steepest(parts, [3.0, 0.0, -4.0])
    assert dict(direction.noise) == {1: pytest.approx(0.6), 2: 0.0, 3: pytest.approx(-0.8)}
    assert steepest(parts, [3.0, inf, 0.0]) is None
    assert steepest(parts, [0.0, 0.0, 0.0]) is None
    assert steepest([], []) is None
    # Two parts that are nearly the same count as one.
    twins = [State((), ((1, 1.0),)), State((), ((1, 0.99999), (2, 0.001))), State((), ((3, 1.0),))]
    assert dict(steepest(twins, [1.0, 1.0, 1.0]).noise)[3] == pytest.approx(0.7, abs=0.02)


def test_families_of_failures_are_parts_of_size_one():
    family = [State((2.0,), ((1, 0.6), (seed, 0.8))) for seed in (5, 6)]
    parts = parts_of([*family, State((0.0,), ((2, 1.0),))])
    assert [length(*size(part), 1) for part in parts] == [pytest.approx(1.0)] * 2
    assert [part.noise[0][0] for part in parts] == [1, 2]
    assert len(some_of([family[0]] * 1001)) == 91
    assert len(some_of(family)) == 2
