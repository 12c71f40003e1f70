"""A calibrated twin predicts flights that it was not fitted to as the true parameters do, and flies as the hidden."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hidden_twins import calibrated, hidden

from heli_twin.calibration.output import as_toml
from heli_twin.experiment.text import changed, load
from heli_twin.mission import fly
from heli_twin.validation.twins import noise_in
from heli_twin.validation.validate import Effort, twins_of, validate
from heli_twin.workers.fleet import fleet

FLIGHTS = ("circle", "lemniscate")
SEEDS = range(300, 303)


def held_out(lab: str, folder: str, seed: int) -> dict:
    """Errors of the calibrated twin by those of the true parameters: after 1 s in open loop, and in closed loop."""
    experiment = hidden(lab, seed)
    path = Path(folder) / f"{lab}{seed}.toml"
    found = calibrated(experiment, anyway=True)
    path.write_text(as_toml(found))
    twin, ratios = load(str(path)), {}
    for i, trajectory in enumerate(FLIGHTS):
        flight = changed(experiment, [f"trajectory={trajectory}", f"seed={10 * seed + 5 + i}", "duration=30"])
        log = fly(flight, log_dir=None).log
        judged, true = (
            validate(
                log,
                trajectory,
                # The prior is the twin itself: only the truth stands beside it.
                twins_of(log, twin, noise_in(str(path), twin), twin),
                Effort(4, 1),
            )
        ).sides
        for channel, a in judged.open_loop[1.0].items():
            ratios[trajectory, "open", channel] = a.rms / true.open_loop[1.0][channel].rms
        for axis, loop in judged.loop.items():
            ratios[trajectory, "closed", axis] = loop.twin / true.loop[axis].twin
    return ratios


@pytest.mark.long
@pytest.mark.parametrize("lab", ["lab_simple", "lab"])
def test_held_out_flights_are_predicted_as_by_the_true_parameters(lab, tmp_path):
    with fleet() as run:
        rows = list(run(partial(held_out, lab, str(tmp_path)), SEEDS))
    print(f"\n{lab}, {len(rows)} hidden twins: error of the calibrated by that of the true parameters")
    for key in rows[0]:
        ratios = [row[key] for row in rows]
        print(f"  {' '.join(key):<24} median {np.median(ratios):.3f}, {min(ratios):.3f} to {max(ratios):.3f}")
    for key in rows[0]:
        median = float(np.median([row[key] for row in rows]))
        if key[1] == "open":
            assert median <= 1.10, key
        else:
            assert 0.90 <= median <= 1.10, key
