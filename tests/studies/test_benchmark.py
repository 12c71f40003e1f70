"""A million rows: stored, aggregated, reported. Run with `pytest tests/studies --benchmark-only`."""

from itertools import count, islice

import numpy as np

from heli_twin.studies.campaign import Campaign
from heli_twin.studies.columns import metric_names
from heli_twin.studies.plan import PlannedFlight, plan_of
from heli_twin.studies.report import write_report
from heli_twin.studies.results import RESULTS, write_parquet
from heli_twin.studies.store import Store
from heli_twin.studies.study import study_of

SIDE, SEEDS = 50, 200
CHUNK = 20_000
CHANGES = {"plant.mass": 0.03}


def synthetic_runs():
    """Coordinates and scores of 50 x 50 points, two alternatives and 200 seeds."""
    rng = np.random.default_rng(0)
    n = count()
    for i in range(SIDE):
        for j in range(SIDE):
            scores = rng.gamma(2.0, 0.01 * (1 + i + j), (2, SEEDS))
            for alternative, name in enumerate(("one", "other")):
                for seed in range(SEEDS):
                    place = {"point": i * SIDE + j, "alternative": name, "replicate": seed, "seed": seed}
                    axes = {"plant.mass": 0.024 + 0.0002 * i, "radio.latency": 0.001 * j}
                    yield next(n), place | axes, float(scores[alternative, seed])


def fill(folder):
    """What a million flights leave behind."""
    axes = {"plant.mass": {"linspace": [0.024, 0.0338, SIDE]}, "radio.latency": {"linspace": [0.0, 0.049, SIDE]}}
    alternatives = {"one": {}, "other": {"controller": {"coupling": "full"}}}
    tree = {"name": "million", "axes": axes, "alternatives": alternatives, "replicates": SEEDS, "max_runs": 1_000_000}
    plan = plan_of(study_of(tree))
    metrics = dict.fromkeys(metric_names(), 0.0123456789)
    with Store(folder, write=True) as store:
        store.begin(Campaign(plan, store, folder).about())
        runs = synthetic_runs()
        while chunk := list(islice(runs, CHUNK)):
            store.ask((n, PlannedFlight(f"{n:016x}", "", place, CHANGES)) for n, place, _ in chunk)
            rows = []
            for n, _, score in chunk:
                failed = score > 1.5
                row = {
                    "id": f"{n:016x}",
                    "outcome": "crashed" if failed else "completed",
                    "outcome_text": "",
                    **metrics,
                }
                rows.append((row | {"rmse.position": score}, None if failed else score, False))
            store.add(rows)
        write_parquet(store, folder / RESULTS)
        store.note({"finished": "now"})


def test_a_million_rows_are_stored_aggregated_and_reported(benchmark, tmp_path):
    def work():
        fill(tmp_path)
        return write_report(tmp_path)

    page = benchmark.pedantic(work, rounds=1)
    assert "1,000,000 flights" in page.read_text()
