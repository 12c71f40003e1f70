"""The shadow is quiet beside a sound helicopter, and loud soon after something has changed."""

import io
import json
from types import SimpleNamespace

import numpy as np
import pytest

from heli_twin.cli import main
from heli_twin.errors import HeliTwinError
from heli_twin.experiment.text import load
from heli_twin.mission import fly
from heli_twin.validation.band import DEFAULT, learned
from heli_twin.validation.shadow import Alarm, from_log, watched
from heli_twin.validation.watch import STATISTICS, Watched
from heli_twin.validation.wire import from_lines, to_lines

TWIN = load("detailed")
BEGIN_S = 9.0
"""Of the faults: the watch takes six seconds to learn what is normal."""


def flown(*overrides):
    return fly(load("detailed", ["duration=11", "trajectory=lemniscate", "seed=5", *overrides]), log_dir=None)


@pytest.fixture(scope="module")
def sound():
    return flown()


def events(log, rate=1.0):
    alarm = Alarm(DEFAULT, rate)
    return [event for seen in watched(TWIN, from_log(log)) for event in alarm.events(seen)]


def test_a_sound_helicopter_is_not_told(sound):
    assert events(sound.log) == []


@pytest.mark.parametrize(
    ("fault", "statistics", "within"),
    [
        (["motor_loss"], {"torque", "yaw", "thrust"}, 0.5),
        (["servo_weak"], {"pitch", "pitch_trim", "x"}, 1.5),
    ],
)
def test_a_fault_is_told_and_named(fault, statistics, within):
    told = events(flown(*(f"faults.{name}={v}" for n in fault for name, v in ((n, "on"), (f"{n}.start", BEGIN_S)))).log)
    assert told, "nothing was told"
    assert told[0].event == "left"
    assert told[0].statistic in statistics
    assert BEGIN_S < told[0].time < BEGIN_S + within


def made(value, seconds=70.0, rate=10):
    """Statistics that all have one value, or one by time."""
    return [Watched(int(1e9 * t), np.full(len(STATISTICS), value(t))) for t in np.arange(0.0, seconds, 1.0 / rate)]


def test_the_band_is_exceeded_as_often_as_it_says():
    rng = np.random.default_rng(0)
    # The greatest of twenty exponential values follows a Gumbel distribution closely.
    hours = 20.0
    blocks = rng.exponential(1.0, (int(hours * 720), 20, len(STATISTICS))).max(axis=1)
    quiet = [[Watched(int(5e9 * i), row) for i, row in enumerate(blocks[:400])]]
    limits = learned(quiet).limits(20.0)
    alarms = (blocks > limits).sum() / hours
    # 400 blocks know the scale to 5 %, and so the rate of alarms, seven scales beyond the mean, to a third.
    assert 10.0 < alarms < 40.0


def test_events_have_hysteresis():
    alarm = Alarm(DEFAULT, 1.0)
    limit = float(alarm.limits[0])
    flicker = made(lambda t: limit * (1.02 if int(10 * t) % 2 else 0.98) if 10 < t < 20 else 0.0, 40.0)
    told = [event for seen in flicker for event in alarm.events(seen) if event.statistic == "x"]
    assert [event.event for event in told] == ["left", "back"]
    assert told[1].time > 20.0
    json.dumps(told[0].plain(), allow_nan=False)


def test_a_minute_of_quiet_flight_is_needed():
    with pytest.raises(HeliTwinError, match=r"hold 25 s that can be learned from: give 60 s"):
        learned([made(lambda t: 1.0 + t, 30.0)])


def test_lines_say_what_the_log_says(sound):
    messages = list(from_log(sound.log))
    again = list(from_lines(to_lines(messages)))
    assert len(again) == len(messages)
    for a, b in zip(messages, again, strict=True):
        assert type(a) is type(b)
        assert repr(a) == repr(b)


def test_a_pipe_is_watched_as_a_log(sound, tmp_path, monkeypatch, capsys):
    lines = "\n".join(to_lines(from_log(sound.log))) + "\n"
    monkeypatch.setattr("sys.stdin", SimpleNamespace(buffer=io.BytesIO(lines.encode())))
    # Believed to have half its pitch gain.
    assert main(["shadow", "-", "detailed", "controller.model.b_x=1", "--json"]) == 1
    piped = capsys.readouterr().out.splitlines()
    path = tmp_path / "flight.mcap"
    path.write_bytes(sound.data)
    assert main(["shadow", str(path), "detailed", "controller.model.b_x=1", "--json"]) == 1
    assert capsys.readouterr().out.splitlines() == piped
    assert json.loads(piped[-1])["changes"] == sum(json.loads(line)["event"] == "left" for line in piped)
    assert main(["shadow", str(path)]) == 0
    assert "nothing has changed in 11.0 s" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "line 1 is '': the first line has to be 'heli_twin 1'"),
        ("heli_twin 2\n", "the first line has to be 'heli_twin 1'"),
        ("heli_twin 1\n1 2 3\n", "line 2 is '1 2 3', which has 3 numbers"),
        ("heli_twin 1\n\n5 0 0 zero 0\n", "line 3 is '5 0 0 zero 0', which is no row of numbers"),
        ("heli_twin 1\n5 0 0 2 0\n", "fractions of full stick, -1 to 1"),
        ("heli_twin 1\n-5 0 0 0 0\n", "no row of numbers with times in ns"),
        ("heli_twin 1\n5 0 0 0 1_0\n", "no row of numbers"),
        ("heli_twin 1\n5 0 0 0.5 0\n", "there is nothing to watch"),
    ],
)
def test_a_wrong_line_is_told_in_a_sentence(text, sentence, monkeypatch, capsys):
    monkeypatch.setattr("sys.stdin", SimpleNamespace(buffer=io.BytesIO(text.encode())))
    assert main(["shadow", "-"]) == 2
    said = capsys.readouterr().err
    assert sentence in said
    assert len(said) < 500


def test_a_log_without_commands_is_refused(tmp_path, capsys):
    rows = [f"{0.01 * i:.2f},{0.002 * i:.4f},0,1,0" for i in range(80)]
    (tmp_path / "take.csv").write_text("\n".join(["time,x,y,z,yaw", *rows, ""]))
    assert main(["import", str(tmp_path / "take.csv")]) == 0
    assert main(["shadow", str(tmp_path / "take.mcap")]) == 2
    assert "take.mcap lacks sent commands: the twin needs all four inputs" in capsys.readouterr().err
