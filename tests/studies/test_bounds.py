"""Plain Monte Carlo: flights are independent draws, and the report and the command say what they show."""

import json

import numpy as np
import pytest
from in_process import InProcess
from scipy.stats import kstest

from heli_twin.commands.study import tell
from heli_twin.studies.campaign import run_study
from heli_twin.studies.errors import StudyError
from heli_twin.studies.plan import plan_of
from heli_twin.studies.report.bounds import bounds, samples, told_bounds
from heli_twin.studies.report.page import SECTIONS
from heli_twin.studies.report.results import results_of
from heli_twin.studies.study import study_of
from heli_twin.workers.task import Flown, Task

MASS = "plant.mass"
TREE = {
    "name": "often",
    "base": {"preset": "lab", "duration": 1.0},
    "axes": {MASS: {"uniform": [0.026, 0.030]}, "radio.latency": {"uniform": [0.0, 0.01]}},
    "alternatives": {"first": {}, "second": {"controller": {"coupling": "full"}}},
    "design": {"kind": "monte_carlo", "flights": 100},
    "logs": {"failed": 0, "worst": 0, "sampled": 0},
}


def by_mass(task: Task) -> Flown:
    """A flight that takes no time: its score is its mass in kg, and a full controller crashes above 29.8 g."""
    experiment = json.loads(task.experiment)
    mass = experiment["plant"]["mass"]
    crashed = experiment["controller"]["coupling"] == "full" and mass > 0.0298
    row = {"id": task.id, "outcome": "crashed" if crashed else "completed", "outcome_text": ""}
    return Flown(row if crashed else {**row, "rmse.position": mass})


def flown(tmp_path, **changes):
    run_study(study_of({**TREE, **changes}), tmp_path / "often", backend=InProcess, work=by_mass)
    return results_of(tmp_path / "often")


def test_each_flight_has_its_own_seed_and_independent_draws_of_the_axes():
    plan = plan_of(study_of(TREE))
    (batch,) = plan.batches()
    points = list(batch)
    assert len({point.seeds for point in points}) == plan.count() / 2 == 100
    mass, latency = np.array([[point.changes[path] for path in TREE["axes"]] for point in points]).T
    assert kstest(mass, "uniform", (0.026, 0.004)).pvalue > 0.01
    # Of independent numbers; a Latin hypercube would fill each slice once, as chance almost never does.
    assert abs(np.corrcoef(mass, latency)[0, 1]) < 0.25
    assert len(np.unique((mass - 0.026) // (0.004 / 100))) < 80
    with pytest.raises(StudyError, match=r"leave replicates at 1 and raise design\.flights"):
        plan_of(study_of({**TREE, "replicates": 5}))


def test_the_page_and_the_terminal_say_what_the_flights_show(tmp_path, capsys):
    results = flown(tmp_path)
    first, second = samples(results)
    crashed = int((results.of("second")[MASS] > 0.0298).sum())
    assert (first.failures, second.failures, first.flights) == (0, crashed, 100)
    assert 1 < crashed < 12
    # Of uniform numbers 95 % are below 29.8 g; the bound is the second greatest of 100.
    assert first.bound == np.sort(results.of("first")[MASS])[-2]
    assert first.bound > 0.0298
    told = list(told_bounds(results))
    assert told[0] == "first: 100 flights without a failure: 97 % of flights, 95 % confidence"
    assert told[1].startswith(f"second: 100 flights with {crashed} failures: ")
    (page,) = bounds(results)
    assert page.rows[0][2] == "100 flights without a failure: 97 % of flights, 95 % confidence"
    assert page.rows[1][1].startswith(f"{crashed} of 100, ")
    assert "59 flights without a failure show 95 %, 299 show 99 %" in page.sentence
    assert bounds in SECTIONS
    tell(results.folder)
    assert capsys.readouterr().out.splitlines() == told


def test_59_flights_show_95_percent_and_what_is_shown_is_rounded_down(tmp_path):
    one = {"alternatives": {}, "design": {"kind": "monte_carlo", "flights": 59}}
    assert list(told_bounds(flown(tmp_path, **one))) == [
        "59 flights without a failure: 95 % of flights, 95 % confidence"
    ]


def test_each_point_of_a_grid_is_a_sample_and_chosen_flights_are_none(tmp_path):
    grid = {"axes": {MASS: [0.027, 0.029]}, "alternatives": {}, "design": {"kind": "grid"}, "replicates": 10}
    assert [sample.name for sample in samples(flown(tmp_path, **grid))] == [f"{MASS} 27 g", f"{MASS} 29 g"]
    search = {"design": {"kind": "worst_case", "trials": 12}, "alternatives": {}}
    assert samples(flown(tmp_path / "search", **search)) == []
    few = {**grid, "replicates": 9}
    assert samples(flown(tmp_path / "few", **few)) == []
