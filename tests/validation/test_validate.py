"""A twin with the right parameters agrees with a flight, another one differs; the measures are what they say."""

import json
from dataclasses import replace

import numpy as np
import pytest

from heli_twin.calibration.expected import expected_noise
from heli_twin.cli import main
from heli_twin.errors import HeliTwinError
from heli_twin.experiment.text import load
from heli_twin.mission import fly
from heli_twin.recording import Attachment, read_log
from heli_twin.recording.attach import attach
from heli_twin.validation.agreement import HORIZONS_S, agreements
from heli_twin.validation.closed_loop import FIRST_SEED, closed_loop, tracking_rms
from heli_twin.validation.forecast import HORIZON_BINS, Forecast
from heli_twin.validation.twins import noise_in, twin_of
from heli_twin.validation.validate import Effort, twins_of, validate

HIDDEN = ["plant.thrust_gain=0.53", "plant.pitch_gain=0.17", "plant.yaw_gain=0.0026", "plant.roll_trim=0.02"]
# Without frames of the radio, no phase of them is looked for.
FLIGHT = load("lab_simple", ["duration=7", "seed=3", "supervisor=off", "radio=off", *HIDDEN])
PRIOR = load("lab_simple", ["radio=off"])


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return fly(FLIGHT, log_dir=tmp_path_factory.mktemp("flown")).path


@pytest.fixture(scope="module")
def result(path):
    log = read_log(path)
    twins = twins_of(log, FLIGHT, expected_noise(PRIOR), PRIOR)
    return validate(log, "check.mcap", twins, Effort(0, 1))


def test_the_true_parameters_agree_and_others_do_not(result):
    assert [side.name for side in result.sides] == ["twin", "uncalibrated"]
    assert result.verdict == "agrees", result.reasons
    right, wrong = (side.open_loop[1.0] for side in result.sides)
    # The yaw gain is 16 % off; a circle at one height tells little of the thrust.
    assert wrong["yaw"].rms > 4.0 * right["yaw"].rms
    assert wrong["pitch"].rms > 1.2 * right["pitch"].rms


def test_a_wrong_twin_is_told_in_sentences(result):
    wrong = replace(result, sides=result.sides[::-1])
    assert wrong.verdict == "differs"
    assert any("yaw errs" in reason and "times what gusts and cameras explain" in reason for reason in wrong.reasons)
    json.dumps(wrong.as_json(), allow_nan=False)


def test_the_envelope_is_what_the_flight_covers(result):
    e, log = result.envelope, fly(FLIGHT, log_dir=None).log
    speed = np.hypot(*log.truth.velocity[log.truth.time > 1.5e9, :2].T).max()
    # Of differences over 0.1 s.
    assert e.speed == pytest.approx(speed, rel=0.05)
    assert 0.5 < e.height[0] <= e.height[1] < 1.5
    assert e.duration == pytest.approx(7.0, abs=0.05)


def made(error, motion=1.0):
    """Predictions that all err by `error` (w,), of a motion that all make."""
    w = len(error)
    flown = np.broadcast_to(motion * np.linspace(0.01, 1.0, HORIZON_BINS)[:, None], (w, HORIZON_BINS, 6)).copy()
    predicted = flown - np.asarray(error)[:, None, None]
    return Forecast(np.arange(float(w)), flown, predicted, np.full_like(flown, 0.1), np.zeros((w, 6)))


def test_the_measures_of_a_made_error():
    rng = np.random.default_rng(0)
    error = 0.2 + 0.1 * rng.standard_normal(400)
    a = agreements(made(error))[HORIZONS_S[0]]["z"]
    assert a.rms == pytest.approx(np.sqrt(np.mean(error**2)))
    assert a.ratio == pytest.approx(a.rms / 0.1)
    assert a.bias_low < 0.2 < a.bias_high
    # 400 errors of 0.1, of which no two overlap.
    assert a.bias_high - a.bias_low == pytest.approx(2 * 1.96 * 0.1 / 20, rel=0.25)
    assert agreements(made(np.zeros(5)))[1.0]["x"].theil == 0.0
    mirrored = made(np.zeros(5))
    assert agreements(mirrored._replace(predicted=-mirrored.predicted))[1.0]["x"].theil == pytest.approx(1.0)


def test_poses_that_are_missing_are_left_out():
    holes = made(np.full(10, 0.1))
    holes.flown[::2] = np.nan
    a = agreements(holes)[2.0]["x"]
    assert a.pieces == 5
    assert a.rms == pytest.approx(0.1)
    holes.flown[:] = np.nan
    with np.errstate(all="ignore"), pytest.warns(RuntimeWarning):
        assert agreements(holes)[2.0]["x"].plain()["rms"] is None


def test_closed_loop_repeats_a_flight_of_the_same_helicopter():
    short = load("lab_simple", ["duration=3", f"seed={FIRST_SEED}"])
    flown = tracking_rms(fly(short, log_dir=None).log)
    (loop,) = closed_loop(flown, [short], 1, processes=1)
    assert {axis: one.twin for axis, one in loop.items()} == {axis: one.flown for axis, one in loop.items()}
    (crashed,) = closed_loop(flown, [load("lab_simple", ["duration=3", "plant.mass=0.09"])], 1, processes=1)
    assert "1 of 1 flights of the twin failed: it " in crashed


def test_an_attachment_changes_neither_messages_nor_digest(path, tmp_path):
    copy = tmp_path / "copy.mcap"
    copy.write_bytes(path.read_bytes())
    before = read_log(copy)
    for text in (b"{}", b"[1]"):
        attach(copy, Attachment("validation.json", "application/json", text))
    after = read_log(copy)
    assert after.attachments["validation.json"].data == b"[1]"
    assert after.digest == before.digest
    assert after.experiment == before.experiment
    for topic, messages in before.messages.items():
        assert list(messages.times) == list(after.messages[topic].times)
        assert list(map(bytes, messages.data)) == list(map(bytes, after.messages[topic].data))
    assert [p.name for p in tmp_path.iterdir()] == ["copy.mcap"]


def test_the_command_prints_tables_or_json_and_attaches(path, result, tmp_path, capsys, monkeypatch):
    copy = tmp_path / "copy.mcap"
    copy.write_bytes(path.read_bytes())
    monkeypatch.setattr("heli_twin.validation.validate.validate", lambda *_, **__: result)
    assert main(["validate", str(copy), "lab_simple", "--json", "--attach"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["verdict"] == "agrees"
    assert json.loads(read_log(copy).attachments["validation.json"].data) == said
    monkeypatch.setattr(
        "heli_twin.validation.validate.validate", lambda *_, **__: replace(result, sides=result.sides[::-1])
    )
    assert main(["validate", str(copy)]) == 1
    assert "the twin differs from the helicopter" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--flights", "99"], "--flights 99: give 0 to 50"),
        (["nothing.toml"], "cannot read nothing.toml"),
        (["lab_simpel"], "did you mean 'lab_simple'"),
    ],
)
def test_mistakes_are_told_in_a_sentence(path, words, sentence, capsys):
    assert main(["validate", str(path), *words]) == 2
    assert sentence in capsys.readouterr().err


def test_a_log_that_is_too_short_is_refused():
    log = fly(load("lab_simple", ["duration=2.6"]), log_dir=None).log
    with pytest.raises(HeliTwinError, match=r"short\.mcap is too short for a prediction: it takes 3 s"):
        validate(log, "short.mcap", [twin_of("twin", PRIOR, expected_noise(PRIOR))], Effort(0, 1))


def test_a_calibrations_noise_is_expected_and_nonsense_refused(tmp_path):
    file = tmp_path / "c.toml"
    file.write_text("[envelope]\nspeed = 1\n[noise]\nyaw_noise = 0.01\n")
    assert noise_in(str(file), PRIOR)["yaw_noise"] == 0.01
    for text, sentence in (("jaw = 1", "noise.jaw is unknown"), ("yaw_noise = -1", "a standard deviation above 0")):
        file.write_text(f"[noise]\n{text}\n")
        with pytest.raises(HeliTwinError, match=sentence):
            noise_in(str(file), PRIOR)
