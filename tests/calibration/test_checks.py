"""Each fault of a recording is refused in one sentence that names it; the same recording without it is not."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from controllers.rotations import rotate_to_world
from heli_twin.calibration.calibrate import flights_of
from heli_twin.calibration.checks import CalibrationError, check_clock, check_form, remarks
from heli_twin.calibration.parameters import INDEX, NAMES, Lab, of_experiment, vector
from heli_twin.calibration.recording_faults import check_recording
from heli_twin.calibration.structure import Structure
from heli_twin.calibration.unknowns import LEVER, N_LOG
from heli_twin.experiment.text import load
from heli_twin.mission import fly
from heli_twin.reporting.svg import write_svg

BASE = load("lab_simple")
BELIEVED = vector(np.array([of_experiment(BASE)[name] for name in NAMES]))


@pytest.fixture(scope="module", params=["calibrate_plane", "calibrate_height_yaw"])
def log(request):
    there = load(request.param)
    # A helicopter that is not the believed one.
    lab = load("lab_simple", ["plant.pitch_gain=0.16", "plant.thrust_gain=0.6", "plant.attitude_frequency=17"])
    flight = replace(lab, trajectory=there.trajectory, excitation=there.excitation, duration=9.5)
    return fly(flight, log_dir=None).log


def check(log, *, sent=1.0, turn=0.0, scale=1.0, mirror=1.0, times=1):
    position = log.pose.position * [scale * mirror, scale, scale]
    position[:, :2] = rotate_to_world(position[:, :2], np.full(len(position), turn))
    # Above the floor, in any unit.
    position[:, 2] += 1.0 - position[:, 2].mean() if scale != 1.0 else 0.0
    faulty = SimpleNamespace(
        pose=log.pose._replace(position=position), sent=log.sent._replace(u=log.sent.u * np.asarray(sent))
    )
    check_recording(flights_of([(f"flight {i}", faulty, None) for i in range(times)], BASE), BELIEVED)


def test_a_right_recording_is_accepted(log):
    check(log)


@pytest.mark.parametrize(("stick", "name"), list(enumerate(["pitch", "roll", "thrust", "yaw"])))
def test_a_stick_with_the_wrong_sign_is_named(log, stick, name):
    signs = np.ones(4)
    if name == "thrust":
        # A thrust is positive: what is wrong is its direction about hover.
        hover = log.sent.u[:, 2].mean()
        log = SimpleNamespace(pose=log.pose, sent=log.sent._replace(u=log.sent.u.copy()))
        log.sent.u[:, 2] = 2.0 * hover - log.sent.u[:, 2]
    else:
        signs[stick] = -1.0
    with pytest.raises(CalibrationError, match=f"the {name} .* stick has the wrong sign"):
        check(log, sent=signs)


def test_turned_and_mirrored_positions_and_wrong_units_are_named(log, tmp_path):
    # Gusts of 9.5 s turn it by up to 8 degrees (four seeds of each flight).
    with pytest.raises(CalibrationError, match=r"positions are turned by (8\d|9\d|100) deg") as refusal:
        check(log, turn=0.5 * np.pi)
    write_svg(refusal.value.figure, tmp_path / "axes.svg")
    with pytest.raises(CalibrationError, match="positions are mirrored"):
        check(log, mirror=-1.0)
    with pytest.raises(CalibrationError, match="unit of length is wrong"):
        check(log, scale=0.0254)


def test_a_flight_given_twice_is_named(log):
    with pytest.raises(CalibrationError, match="flight 0 and flight 1 hold the same poses"):
        check(log, times=2)


def test_a_wrong_form_is_named_with_its_channel():
    fine = dict.fromkeys(("x", "y", "z", "yaw", "pitch", "roll"), 1.0)
    curves = {c: np.ones(21) for c in fine}
    check_form(Structure(fine, fine, fine, curves))
    with pytest.raises(CalibrationError, match=r"wrong in pitch: .* past, 19.0 times .*load on a string"):
        check_form(Structure(fine | {"pitch": 19.0}, fine, fine, curves))


def fitted(delay: float, lever=(0.0, 0.0, 0.0)):
    """A fit with one log, as far as clock and markers go; 24 ms of delay were expected, 11 of them for a frame."""
    theta, prior = np.zeros(len(NAMES)), np.zeros(len(NAMES))
    theta[INDEX["delay"]], prior[INDEX["delay"]] = delay, 0.024
    nuisance = np.zeros((1, N_LOG))
    nuisance[0, LEVER] = lever
    return SimpleNamespace(
        state=SimpleNamespace(theta=theta, nuisance=nuisance),
        deviation=np.full(len(NAMES), 0.0005),
        nuisance_deviation=np.full((1, N_LOG), 0.0005),
        problem=SimpleNamespace(prior=prior, lab=Lab(0.022, 682), flights=[SimpleNamespace(name="monday.mcap")]),
    )


def test_clocks_that_differ_are_named_with_their_difference():
    check_clock(fitted(0.024))
    check_clock(fitted(0.040))
    with pytest.raises(CalibrationError, match=r"6 ms after .*stamped late.* move the commands by -30 ms"):
        check_clock(fitted(-0.006))
    with pytest.raises(CalibrationError, match=r"54 ms after .*stamped early.* radio.latency=0.035"):
        check_clock(fitted(0.054))


def test_markers_beside_the_centre_of_gravity_are_told():
    assert not list(remarks(fitted(0.024, (0.001, 0.0, 0.002))))
    (sentence,) = remarks(fitted(0.024, (0.01, 0.0, 0.02)))
    assert "monday.mcap: the markers sit 1.0 cm ahead, 0.0 cm to port and 2.0 cm above" in sentence
