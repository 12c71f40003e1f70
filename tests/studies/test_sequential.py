"""Sequential stopping: fewer flights for the same answer."""

from pathlib import Path

import numpy as np
import pytest
from hooks import scored_by_seed

from heli_twin.reporting.intervals import mean_interval
from heli_twin.studies.campaign import embedded, run_study
from heli_twin.studies.errors import StudyError
from heli_twin.studies.plan import plan_of
from heli_twin.studies.results import rows_of
from heli_twin.studies.sequential import MOST, PILOT, seeds_needed
from heli_twin.studies.study import study_of, study_tree

FLOWN = np.loadtxt(Path(__file__).with_name("flown_scores.txt"))
"""rmse.position, m, of `fly lab_simple controller=pid trajectory=hover duration=2` with 2000 seeds."""


def stopped(drawn: np.ndarray, half_width: float) -> tuple[float, float, int]:
    """Mean and half-width of a study that flies these scores, NaN for a crash, and the number of its flights."""
    flown, wanted = 0, PILOT
    while wanted > flown:
        flown = wanted
        scores = drawn[:flown][~np.isnan(drawn[:flown])]
        wanted = min(seeds_needed(scores, flown, half_width), len(drawn))
    found = mean_interval(drawn[:flown])
    return found.value, 0.5 * (found.high - found.low), flown


def coverage(studies: int, half_width: float, crashes: float) -> tuple[float, float]:
    """Share of resampled studies whose interval holds the true mean, and their mean number of flights."""
    rng, true = np.random.default_rng(0), FLOWN.mean()
    held, flights = 0, 0
    for _ in range(studies):
        drawn = rng.choice(FLOWN, 400)
        drawn[rng.random(400) < crashes] = np.nan
        mean, reached, n = stopped(drawn, half_width)
        held += abs(mean - true) <= reached
        flights += n
    return held / studies, flights / studies


@pytest.mark.parametrize("crashes", [0.0, 0.02])
def test_the_interval_of_a_study_that_stopped_holds_the_mean(crashes):
    held, flights = coverage(1500, 0.002, crashes)
    # Three deviations of a share of 1500 below 94.5 %.
    assert held > 0.945 - 3 * np.sqrt(0.945 * 0.055 / 1500)
    assert PILOT < flights < 150


@pytest.mark.long
@pytest.mark.parametrize("crashes", [0.0, 0.02])
@pytest.mark.parametrize("half_width", [0.0015, 0.0021, 0.0024])
def test_coverage_of_20000_studies(half_width, crashes):
    assert coverage(20_000, half_width, crashes)[0] >= 0.94


def test_more_scatter_needs_more_seeds_and_none_needs_none():
    rng = np.random.default_rng(0)
    values = rng.standard_normal(PILOT)
    few, many = (seeds_needed(scale * values, PILOT, 0.1) for scale in (1.0, 2.0))
    assert many == pytest.approx(4 * few, rel=0.02)
    assert seeds_needed(np.ones(PILOT), PILOT, 0.1) == PILOT
    # Half of the flights crashed: as many of the next will.
    assert seeds_needed(values, 2 * PILOT, 0.1) == pytest.approx(2 * few, rel=0.02)
    assert seeds_needed([], PILOT, 0.1) == 2 * PILOT


def auto(small, **fields):
    return study_of(study_tree(small) | {"replicates": "auto", "half_width": 0.22, "score": "rmse.x"} | fields)


def one_process(plan, timeout):
    return embedded(plan, timeout, 1)


def test_a_study_stops_by_itself_says_what_it_saved_and_goes_on_from_there(small, tmp_path):
    study = auto(small)
    count = run_study(study, tmp_path, backend=one_process, work=scored_by_seed)
    rows = rows_of(tmp_path)
    points = {row["point"] for row in rows}
    seeds = {point: {row["seed"] for row in rows if row["point"] == point} for point in points}
    # All points flew the same seeds: their differences are paired.
    (flown,) = {frozenset(s) for s in seeds.values()}
    assert PILOT < len(flown) < MOST
    assert count.done == len(rows) == len(points) * len(flown)
    assert count.saved == len(points) * (MOST - len(flown))
    for point in points:
        found = mean_interval(np.array([row["rmse.x"] for row in rows if row["point"] == point]))
        assert found.high - found.low <= 2 * 0.22
    again = run_study(study, tmp_path, backend=one_process, work=scored_by_seed)
    assert (again.flown, again.done) == (0, len(rows))


def test_never_more_than_replicates(small, tmp_path):
    study = study_of(study_tree(small) | {"replicates": 70, "half_width": 1e-6, "score": "rmse.x"})
    count = run_study(study, tmp_path, backend=one_process, work=scored_by_seed)
    assert (count.done, count.saved) == (plan_of(study).count(), 0)


def test_auto_needs_a_half_width_and_a_design_that_does_not_search(small):
    with pytest.raises(StudyError, match='replicates = "auto" needs half_width'):
        auto(small, half_width=0.0)
    with pytest.raises(StudyError, match=r"half_width = 0\.22 does not go with the design margin"):
        plan_of(auto(small, design={"kind": "margin"}, max_runs=10**6))
