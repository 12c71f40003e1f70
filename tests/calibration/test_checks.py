"""Each fault of a recording is refused in one sentence that names it; the same recording without it is not."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from controllers.rotations import rotate_to_world
from heli_twin.calibration.calibrate import flights_of
from heli_twin.calibration.checks import CalibrationError, check_form, check_recording
from heli_twin.calibration.parameters import NAMES, of_experiment, vector
from heli_twin.calibration.structure import Structure
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
    with pytest.raises(CalibrationError, match=r"positions are turned by (8[5-9]|9[0-5]) deg") as refusal:
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
