"""Flights that tell little, and a fit that has not converged: what is said, and what is refused."""

from dataclasses import replace

import pytest

from heli_twin.calibration import calibrate as stages
from heli_twin.calibration.calibrate import calibrate, flights_of
from heli_twin.calibration.checks import CalibrationError
from heli_twin.calibration.output import as_toml
from heli_twin.calibration.parameters import of_experiment
from heli_twin.experiment.text import load
from heli_twin.mission import fly

# Frames of the radio would have to be looked for.
BASE = load("lab_simple", ["radio=off"])


@pytest.fixture(scope="module")
def flights():
    hover = load("lab_simple", ["radio=off", "trajectory=hover", "duration=8", "plant.yaw_lag=0.008"])
    return flights_of([("hover.mcap", fly(hover, log_dir=None).log, hover.seed)], BASE)


def test_what_a_hover_does_not_tell_is_named_and_stays_as_believed(flights):
    found, believed = calibrate(flights, BASE), of_experiment(BASE)
    known = found.parameters
    untold = {name for name, k in known.items() if not k.told}
    # Hardly any speed, no quick motion: the table of `heli-twin calibrate --plan` says so before.
    assert {"drag_x_per_mass", "drag_y_per_mass", "servo_lag", "yaw_lag", "izz_per_iyy"} <= untold
    assert known["yaw_lag"].value == pytest.approx(believed["yaw_lag"], rel=0.5)
    assert known["yaw_lag"].low < 0.008 < known["yaw_lag"].high
    assert not found.as_json()["parameters"]["yaw_lag"]["told"]
    first = as_toml(found).splitlines()[1]
    assert first.startswith("# not told by these flights, as believed before: ")
    assert "yaw_lag" in first
    assert "thrust_per_mass" not in first


def test_a_fit_that_has_not_converged_is_refused(flights, monkeypatch):
    fit = stages.fit
    monkeypatch.setattr(stages, "fit", lambda problem, begin, progress, **_: fit(problem, begin, progress, limit=1))
    far = replace(BASE, plant=replace(BASE.plant, thrust_gain=0.65, attitude_frequency=22.0))
    with pytest.raises(
        CalibrationError, match=r"not converged: its last step was [\d.]+ standard.*limit 0\.1\); .*--anyway"
    ):
        calibrate(flights, far)
