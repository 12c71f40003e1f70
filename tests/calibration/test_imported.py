"""A calibration on Motive's export of flights holds its intervals as one on the flights themselves."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hidden_twins import hidden, truth
from motive_take import commands_of, motive_take

from heli_twin.calibration.calibrate import calibrate, flights_of
from heli_twin.calibration.flights import planned
from heli_twin.exchange.import_poses import Reading, import_poses
from heli_twin.experiment.text import load
from heli_twin.mission import fly
from heli_twin.recording import read_log
from heli_twin.workers.fleet import fleet

GAPS = [(7.0, 7.3), (21.0, 21.8), (40.0, 40.1)]
"""Three times the cameras lose the body, s."""
TWINS = range(320, 324)


def both_ways(folder: str, seed: int) -> dict:
    """Told parameters from the log, and from every second pose with gaps: whether inside, and half-widths."""
    experiment, base = hidden("lab_simple", seed), load("lab")
    direct, imported = [], []
    for flight in planned(experiment)[:2]:
        log = fly(flight.experiment, log_dir=None).log
        direct.append((flight.name, log, flight.experiment.seed))
        stem = Path(folder) / f"{flight.name}{seed}"
        take = motive_take(log, stem.with_suffix(".csv"), every=2, gaps=GAPS)
        sent = commands_of(log, stem.with_suffix(".sent.csv"))
        import_poses(take, stem.with_suffix(".mcap"), Reading(commands=sent))
        imported.append((flight.name, read_log(stem.with_suffix(".mcap")), None))
    true, out = truth(experiment), {}
    for way, logs in (("log", direct), ("export", imported)):
        found = calibrate(flights_of(logs, base), base, anyway=True).parameters
        told = {name: k for name, k in found.items() if k.told}
        out[way] = {name: (k.low <= true[name] <= k.high, 0.5 * (k.high - k.low)) for name, k in told.items()}
    return out


@pytest.mark.long
def test_a_motive_export_calibrates_as_the_log(tmp_path):
    with fleet() as run:
        rows = list(run(partial(both_ways, str(tmp_path)), TWINS))
    for way in ("log", "export"):
        inside = [hit for row in rows for hit, _ in row[way].values()]
        print(f"\n{way}: {np.mean(inside):.3f} of {len(inside)} told parameters inside, at least", end=" ")
        print(min(len(row[way]) for row in rows), "told")
    wider = [
        row["export"][name][1] / row["log"][name][1] for row in rows for name in row["export"] if name in row["log"]
    ]
    print(f"intervals of the export are {np.median(wider):.2f} times as wide, {min(wider):.2f} to {max(wider):.2f}")
    assert np.mean([hit for row in rows for hit, _ in row["export"].values()]) >= 0.90
    assert min(len(row["export"]) for row in rows) >= 12
    # Half as many poses, and 2 % of them lost: the wind limits most of the parameters, not the cameras.
    assert np.median(wider) < 1.3
