"""Flights and studies that leave what a calibration covered are told, others are not."""

import pytest

from heli_twin.cli import main
from heli_twin.experiment.envelope import Envelope, envelope_in
from heli_twin.experiment.text import load
from heli_twin.experiment.tree import ExperimentError
from heli_twin.metrics.reach import flown_reach, planned_reach
from heli_twin.mission import fly
from heli_twin.studies.plan import outside, plan_of
from heli_twin.studies.study import study_of

CIRCLE = load("ideal", ["duration=3"])


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "calibration.toml"
    path.write_text('[plant]\nkind = "ideal"\n[envelope]\nspeed = 0.6\nheight = [0.8, 1.2]\nduration = 60\n')
    return path


def test_a_flight_is_inside_of_what_it_reached_itself():
    reached = flown_reach(fly(CIRCLE, log_dir=None).log)
    assert reached.left_by(reached) == []
    # An ideal circle of 0.5 m at 1 rad/s is flown as planned, to a millimetre.
    planned = planned_reach(CIRCLE)
    assert reached.speed == pytest.approx(planned.speed, rel=0.02)
    assert reached.yaw_rate == pytest.approx(planned.yaw_rate, rel=0.02)


def test_each_range_is_told_when_it_is_left():
    covered = Envelope(1.0, 0.5, 2.0, 0.2, (0.5, 1.5), (-0.2, -0.2, 0.4, -0.2), (0.2, 0.2, 0.7, 0.2), 60.0)
    beyond = Envelope(1.2, 0.6, 2.4, 0.3, (0.3, 1.5), (-0.4, -0.2, 0.4, -0.2), (0.2, 0.2, 0.9, 0.2), 90.0)
    assert [phrase.partition(" ")[0] for phrase in covered.left_by(beyond)] == [
        *("speed", "vertical", "yaw", "tilt", "a", "height", "pitch", "thrust"),
    ]
    # A tenth is the scatter of gusts; what is not known is not told.
    assert covered.left_by(Envelope(1.09, height=(0.41, 1.59))) == []
    assert Envelope().left_by(beyond) == []


def test_fly_warns_outside(file, capsys):
    assert main(["fly", str(file), "duration=2.5", "--no-log"]) == 0
    assert "guess" not in capsys.readouterr().err
    assert main(["fly", str(file), "duration=2.5", "trajectory.height=1.5", "--no-log", "--json"]) == 0
    said = capsys.readouterr()
    assert "calibration.toml is a guess for this flight" in said.err
    assert "height 1.50 to 1.50 m (covered: 0.80 to 1.20)" in said.err
    assert said.out.startswith("{")


def test_studies_warn_outside(file):
    axes = {"trajectory.rate": [0.5, 1.0, 2.0]}
    (phrase,) = outside(plan_of(study_of({"base": {"preset": str(file), "duration": 10.0}, "axes": axes})))
    assert phrase == "speed up to 1 m/s (covered: 0.6)"
    by_value = {"preset": "ideal", "envelope": {"duration": 5}}
    assert outside(plan_of(study_of({"base": by_value}))) == ["a flight of 30 s (covered: 5)"]
    assert outside(plan_of(study_of({"base": {"preset": "ideal"}}))) == []


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[envelope]\nspead = 1", r"envelope\.spead is no range\. Available: speed, climb"),
        ("[envelope]\nspeed = 'fast'", r"envelope\.speed = fast: write a number"),
        ("[envelope]\nheight = 1", r"envelope\.height = 1: write a list of 2 numbers"),
        ("envelope = 3", r"envelope = 3 is not a table"),
    ],
)
def test_nonsense_is_told_in_a_sentence(text, sentence, tmp_path):
    path = tmp_path / "calibration.toml"
    path.write_text(text)
    with pytest.raises(ExperimentError, match=sentence):
        envelope_in(str(path))
