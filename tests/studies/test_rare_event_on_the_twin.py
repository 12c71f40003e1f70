"""The twin itself judges the search for rare events: three searches and 5000 plain flights tell the same probability.

About 7500 flights of 10 s, 30 minutes of processor time. With a folder in HELI_TWIN_PROOFS it keeps what it has flown
and goes on from there.
"""

import os
from pathlib import Path

import pytest

from heli_twin.reporting.intervals import wilson
from heli_twin.studies.campaign import embedded, run_study
from heli_twin.studies.report.rare_event import searches
from heli_twin.studies.report.results import Results, results_of
from heli_twin.studies.study import load_study

STEADY = 'requirements.steady="always[2s,end] error.position < 5.5 cm"'
"""Of 500 flights with seeds from 10 000 000 on, one in a hundred strays further."""
CHANGES = (STEADY, "axes={}", "logs={failed=0, worst=0, sampled=0}")


def flown(folder: Path, *overrides: str) -> Results:
    study = load_study("rare_event", [*CHANGES, *overrides])
    run_study(study, folder, backend=lambda plan, timeout: embedded(plan, timeout, 1))
    return results_of(folder)


@pytest.mark.long
def test_three_searches_agree_with_5000_plain_flights(tmp_path: Path) -> None:
    folder = Path(os.environ.get("HELI_TWIN_PROOFS", tmp_path))
    estimates = [searches(flown(folder / f"rare{seed}", f"seed={seed}"))[0].estimate for seed in (1, 2, 3)]
    plain = flown(folder / "plain", "seed=0", 'design={kind="monte_carlo", flights=5000}')
    rate = wilson(int(plain.failed.sum()), len(plain))
    print(rate, [(each.probability, each.low, each.high, each.evaluations) for each in estimates])
    assert rate.n == 5000
    assert 0.003 < rate.value < 0.03
    assert all(each.low <= rate.high and rate.low <= each.high for each in estimates)
