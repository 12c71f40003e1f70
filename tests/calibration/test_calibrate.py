"""A hidden helicopter is found in its flights; what is written flies."""

import json
import tomllib
from dataclasses import replace

import numpy as np
import pytest

from controllers.detailed_model import DetailedModel
from controllers.model import GRAVITY
from heli_twin.calibration.calibrate import EFFECTS, calibrate, flights_of
from heli_twin.calibration.coverage import covered
from heli_twin.calibration.noise import COMPONENTS
from heli_twin.calibration.output import _details, as_toml, twin_of
from heli_twin.calibration.parameters import NAMES, of_experiment
from heli_twin.calibration.planning import bounds, gain, information
from heli_twin.calibration.posterior import draws, ensemble, posterior
from heli_twin.experiment.envelope import envelope_in
from heli_twin.experiment.text import load
from heli_twin.metrics.reach import planned_reach
from heli_twin.mission import fly
from heli_twin.studies.plan import plan_of
from heli_twin.studies.study import load_study, study_of

HIDDEN = [
    "plant.mass=0.030",
    "plant.thrust_gain=0.6",
    "plant.pitch_gain=0.18",
    "plant.yaw_gain=0.0027",
    "plant.roll_trim=0.02",
    "plant.thrust_lag=0.05",
    "plant.input_delay=0.005",
    # How many of ten windows have a lost frame is luck.
    "radio.loss=0",
]


@pytest.fixture(scope="module")
def logs():
    lab, logs = load("lab_simple", HIDDEN), []
    for seed, name in enumerate(("calibrate_plane", "calibrate_height_yaw"), 40):
        there = load(name)
        flight = replace(lab, trajectory=there.trajectory, excitation=there.excitation, duration=11.5, seed=seed)
        logs.append((name, fly(flight, log_dir=None).log, seed))
    return logs


@pytest.fixture(scope="module")
def calibrated(logs):
    base = load("lab_simple")
    return calibrate(flights_of(logs, base), base, mass=0.030)


def test_the_hidden_helicopter_is_inside_its_intervals(calibrated):
    truth, known = of_experiment(load("lab_simple", HIDDEN)), calibrated.parameters
    of_effects = {name for names in EFFECTS.values() for name in names}
    told = [name for name in NAMES if name not in of_effects and known[name].told]
    assert len(told) >= 12
    # Of some twenty intervals of 95 %, four outside happen one time in 60.
    assert sum(not known[name].low <= truth[name] <= known[name].high for name in told) <= 3
    # A tenth of the difference to what was believed.
    assert known["pitch_gain"].value == pytest.approx(0.18, rel=0.015)
    assert known["thrust_per_mass"].value == pytest.approx(20.0, rel=0.02)
    assert calibrated.fit.last_step < 0.1
    assert calibrated.kept == ()


def test_the_radios_frames_are_found(calibrated):
    assert all(phase is not None for phase in calibrated.fit.state.framed)


def test_frames_in_doubt_are_no_noise(calibrated):
    noises = dict(zip(COMPONENTS, np.exp(calibrated.fit.state.eta), strict=True))
    # With the doubt taken as noise: 0.8 rad/s^2.
    assert noises["yaw_jitter"] < 0.3


def test_the_plan_says_what_a_calibration_then_knows(calibrated, logs):
    base = load("lab_simple", HIDDEN)
    plane, height = (information(flight, base) for flight in flights_of(logs, base))
    once, planned = bounds([plane], base), bounds([plane, height], base)
    known = dict(zip(NAMES, calibrated.fit.deviation, strict=True))
    told = [bound for bound in planned if bound.told]
    assert len(told) >= 12
    ratios = np.log([bound.deviation / known[bound.name] for bound in told])
    # Ten windows know the small noise of the yaw, on which its trim depends, to a factor of two.
    assert np.abs(ratios).max() < np.log(2.0)
    assert np.abs(np.mean(ratios)) < np.log(1.25)
    # More flights tell more: twice the same halves the variances that the prior leaves alone.
    assert all(b.deviation <= a.deviation for a, b in zip(once, planned, strict=True))
    assert gain(plane, plane, base) == pytest.approx(0.5 * np.log(2.0), abs=0.15)


def test_the_structure_of_a_right_twin_is_accepted(calibrated):
    assert calibrated.structure.worst[2] < 1.0
    # 6 channels of 10 windows of 85 bins: a variance of 1, known to 2 %, less what parameters took.
    assert np.mean(list(calibrated.structure.variance.values())) == pytest.approx(1.0, abs=0.1)


def test_what_is_printed_for_programs_is_finite_json(calibrated):
    text = json.dumps(calibrated.as_json(), allow_nan=False)
    parameters = json.loads(text)["parameters"]
    assert all(p["interval"][0] <= p["value"] <= p["interval"][1] for p in parameters.values())
    json.dumps(posterior(calibrated), allow_nan=False)


def test_the_file_flies_and_keeps_truth_and_belief_apart(calibrated, tmp_path):
    path = tmp_path / "calibration.toml"
    path.write_text(as_toml(calibrated))
    assert {"plant", "controller", "envelope"} <= set(tomllib.loads(path.read_text()))
    experiment = load(str(path), ["duration=3"])
    found, wanted = of_experiment(experiment), {name: k.value for name, k in calibrated.parameters.items()}
    # The delay is held to whole steps, with the remainder in a comment.
    for name in ("thrust_per_mass", "pitch_gain", "izz_per_iyy", "drag_y_per_mass", "thrust_lag"):
        assert found[name] == pytest.approx(wanted[name], rel=1e-6)
    assert abs(found["delay"] - wanted["delay"]) <= 0.5e-3 + 1e-9
    assert experiment.plant.mass == 0.030
    assert experiment.controller.model.b_z == pytest.approx(wanted["thrust_per_mass"], rel=1e-5)
    assert fly(experiment, log_dir=None).outcome.kind == "completed"


def test_a_law_of_any_kind_believes_what_was_calibrated(calibrated, tmp_path):
    path, hidden = tmp_path / "calibration.toml", load("lab_simple", [*HIDDEN, "duration=8", "trajectory=lemniscate"])
    path.write_text(as_toml(calibrated))
    detailed = ["controller=detailed_mpc", "estimator=detailed_kalman"]

    def error(believed):
        flown = fly(replace(hidden, controller=believed.controller, estimator=believed.estimator), log_dir=None)
        return flown.summary()["rmse"]

    believed, true = load(str(path), detailed), of_experiment(hidden)
    model = believed.controller.model
    assert model.b_z == pytest.approx(true["thrust_per_mass"], rel=0.02)
    assert model.roll_frequency == pytest.approx(true["attitude_frequency"] * true["iyy_per_ixx"] ** 0.5, rel=0.1)
    assert model.thrust_lag == pytest.approx(true["thrust_lag"], rel=0.1)
    assert model.gust_strength == pytest.approx(0.25, rel=0.3)
    assert believed.estimator.command_delay == pytest.approx(true["delay"], abs=0.002)
    right, wrong = error(believed), error(load("lab_simple", detailed))
    # The filter finds pushes and trims by itself; a wrong gain of the yaw shows where the heading turns fast.
    assert right["yaw"] < 0.5 * wrong["yaw"]
    assert right["x"] + right["y"] < wrong["x"] + wrong["y"]
    # The paper's laws take the paper's parameters.
    for kind in ("ltv_mpc", "pid"):
        assert load(str(path), [f"controller={kind}"]).controller.model.b_z == model.b_z
    assert load(str(path), ["controller=pid", "controller.model.b_z=17"]).controller.model.b_z == 17


def test_the_envelope_is_read_back_and_left(calibrated, tmp_path):
    path = tmp_path / "calibration.toml"
    path.write_text(as_toml(calibrated))
    envelope = envelope_in(str(path))
    assert envelope.left_by(covered(calibrated.fit.problem.flights)) == []
    fast = planned_reach(load(str(path), ["trajectory=circle", "trajectory.radius=1", "trajectory.rate=3"]))
    assert any("speed up to" in phrase for phrase in envelope.left_by(fast))


def test_the_ensemble_is_a_study_of_what_the_flights_leave_open(calibrated, tmp_path):
    many = draws(calibrated, 400)
    spread = np.std([np.log(p["drag_x_per_mass"]) for p in many])
    # 400 draws know a standard deviation to 4 %.
    i = NAMES.index("drag_x_per_mass")
    assert spread == pytest.approx(np.sqrt(1.5 * calibrated.fit.covariance[i, i]), rel=0.15)
    path = tmp_path / "ensemble.toml"
    path.write_text(ensemble(calibrated, 3))
    assert len(plan_of(load_study(str(path))).space.alternatives) == 3
    assert plan_of(study_of({"axes": {"plant": {"ensemble": str(path)}}})).count() == 3


def test_a_detailed_law_believes_in_the_play_and_the_hubs_drag():
    believed = of_experiment(load("lab"))
    details = _details(believed, dict.fromkeys(COMPONENTS, 0.1))
    model = DetailedModel(**details)
    assert model.servo_play == believed["servo_backlash"] == 0.03
    assert model.servo_slew == pytest.approx(1.0 / believed["servo_slowness"]) == 2.5
    assert model.hub_drag == pytest.approx(GRAVITY * believed["hub_drag_per_iyy"] / believed["attitude_frequency"] ** 2)


def test_effects_that_are_kept_are_in_the_helicopter(calibrated):
    believed = of_experiment(load("lab"))
    twin = twin_of(calibrated.base, believed, 0.028, tuple(EFFECTS))
    again = of_experiment(replace(calibrated.base, plant=twin.plant))
    for name in NAMES:
        assert again[name] == pytest.approx(believed[name], rel=1e-6, abs=2e-3 if name == "delay" else 1e-9), name
