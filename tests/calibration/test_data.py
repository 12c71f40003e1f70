"""Windows and inputs: what the fit compares, and what acts at the helicopter."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from heli_twin.calibration.calibrate import CalibrationError, flights_of
from heli_twin.calibration.data import BIN_STEPS, BINS, STEP_S, WINDOW_STEPS, Doubt, flight_of
from heli_twin.calibration.drive import GRID_S, SERVO_PERIOD_S, drives_of
from heli_twin.calibration.parameters import INDEX, NAMES, lab_of, of_experiment, vector
from heli_twin.calibration.problem import Problem
from heli_twin.calibration.unknowns import Later
from heli_twin.experiment.text import load
from heli_twin.mission import fly

LAB = load("lab_simple", ["plant.input_delay=0.004", "mocap.dropout=0.02"])


@pytest.fixture(scope="module")
def log():
    flight = load("calibrate_height_yaw")
    return fly(replace(LAB, trajectory=flight.trajectory, excitation=flight.excitation, duration=8.0), log_dir=None).log


def at_the_helicopter(log, t):
    """The input that really acts at times t (n,), s."""
    i = np.searchsorted(log.acting.time, np.round((t - 0.004) * 1e9).astype(np.int64), side="right") - 1
    return log.acting.u[np.maximum(i, 0)]


def test_the_mean_wait_for_a_frame_is_unbiased_and_known_frames_are_nearly_exact(log):
    flight = flight_of(log, "flight", lab_of(LAB), None)
    t = STEP_S * np.arange(1000, 7000)
    true, delay = at_the_helicopter(log, t), of_experiment(LAB)["delay"] + GRID_S
    phase = float(np.median(np.mod(1e-9 * log.acting.time[1:], 0.022))) + 0.004
    unknown, known = (flight.sent.acting(delay, t, phase) - true for phase in (None, phase))
    assert np.abs(unknown.mean(axis=0)).max() < 2e-3
    # What is left with known frames is the jitter of the compute time, and lost frames.
    assert (known.std(axis=0) < 0.5 * unknown.std(axis=0)).all()


def test_the_jitter_leaves_open_what_one_frame_in_ten_carries(log):
    sent, t = flight_of(log, "flight", lab_of(LAB), None).sent, STEP_S * np.arange(1000, 7000)
    delay = of_experiment(LAB)["delay"] + GRID_S
    phase = float(np.median(np.mod(1e-9 * log.acting.time[1:], 0.022))) + 0.004
    acts = sent.doubtful(delay - 0.011, np.append(t, t[-1] + STEP_S), phase)
    acts = acts[acts > t[0]]
    assert len(acts) == pytest.approx(6.0 / 0.22, abs=3)
    expected, true = sent.acting(delay, t, phase), at_the_helicopter(log, t)
    since = t - acts[np.maximum(np.searchsorted(acts, t) - 1, 0)]
    # Steps at both ends of a frame are shared with the next ones.
    inside, outside = (since > 0.001) & (since < 0.020), since > 0.023
    miss = np.abs(expected - true).max(axis=1)
    # Beside the doubts, all is known but a lost frame, to some hundredths of a command's step.
    assert np.mean(miss[outside] > 0.02) < 0.02 < 0.2 < np.mean(miss[inside] > 0.02)


def test_a_doubt_moves_its_own_frames_by_one_standard_deviation(log):
    sent, t = flight_of(log, "flight", lab_of(LAB), None).sent, STEP_S * np.arange(1000, 7000)
    delay, phase = of_experiment(LAB)["delay"] + GRID_S, 0.0131
    edges = np.append(t, t[-1] + STEP_S)
    acts = sent.doubtful(delay - 0.011, edges, phase)
    expected = sent.acting(delay, t, phase)
    moved = [np.abs(sent.acting(delay, t, phase, Doubt(i, 3)) - expected).max(axis=1) > 1e-12 for i in range(3)]
    # No step is in two parts, and every part's steps are within its frames.
    assert not np.any(sum(part.astype(int) for part in moved) > 1)
    for i, part in enumerate(moved):
        own = acts[i::3]
        since = t[part] + STEP_S - own[np.searchsorted(own, t[part] + STEP_S) - 1]
        assert part.any()
        assert since.max() < 0.022 + STEP_S
    # The deviation of a choice between two commands with probability p is sqrt(p (1 - p)) of their difference.
    now, then = sent.frames(delay - 0.011, edges, phase), sent.frames(delay - 0.011, edges, phase, Doubt(0, 1))
    assert 0.0 < np.abs(then.u - now.u).max() <= 0.5 * np.abs(np.diff(sent.u, axis=0)).max()


def test_no_window_has_two_frames_in_doubt_of_a_part(log):
    flight = flight_of(log, "flight", lab_of(LAB), None)
    theta = vector(np.array([of_experiment(LAB)[name] for name in NAMES]))
    problem = Problem([flight], lab_of(LAB), theta)
    assert problem.doubts(problem.initial()) == []
    state = problem.initial()._replace(theta=theta, framed=(0.003,))
    hasty = Problem([flight_of(log, "flight", replace(lab_of(LAB), jitter=0.01), None)], lab_of(LAB), theta)
    assert hasty.doubts(state) == []
    parts = [later.doubt for later in problem.doubts(state)]
    assert [part.number for part in parts] == list(range(parts[0].every))
    drives = problem._drives(state, [theta] * (1 + len(parts)), [Later(), *problem.doubts(state)])
    for j in range(1, 1 + len(parts)):
        moved = np.abs(drives[:, j] - drives[:, 0]).max(axis=1)
        # A frame lasts for 22 ms, and what the lags of the actuators leave of it 0.3 s; the next of a part is 2 s away.
        for window in moved.T:
            at = np.flatnonzero(window > 0.02 * moved.max())
            assert len(at) == 0 or at[-1] - at[0] < 400


def test_windows_hold_every_pose_once_and_average_the_steps_they_were_taken_at(log):
    windows = flight_of(log, "flight", lab_of(LAB), None).windows
    assert len(windows.first) == 3
    assert (np.diff(windows.first) >= WINDOW_STEPS).all()
    assert windows.frames.sum() == pytest.approx(600 * 0.98, abs=15)
    full = windows.frames > 0
    shares = windows.weights[:, :WINDOW_STEPS].reshape(3, BINS, BIN_STEPS).sum(axis=2) + windows.early
    assert shares == pytest.approx(full.astype(float), abs=1e-12)
    # The first state is where the poses are; 2 mm of noise and curvature.
    assert np.abs(windows.start[:, :3] - windows.y[:, 0, :3]).max() < 0.02


def test_logs_that_cannot_be_used_are_refused_in_a_sentence(log):
    with pytest.raises(CalibrationError, match=r"a and b were flown with the same seed, 5: .* seed=6"):
        flights_of([("a", log, 5), ("b", log, 5)], LAB)
    deaf = SimpleNamespace(pose=log.pose, sent=log.sent._replace(u=log.sent.u * [1.0, np.nan, 1.0, 1.0]))
    with pytest.raises(CalibrationError, match="lacks a sent command"):
        flights_of([("deaf", deaf, None)], LAB)
    blind = SimpleNamespace(pose=log.pose._replace(position=log.pose.position * [1, 1, 0.1]), sent=log.sent)
    with pytest.raises(CalibrationError, match="low has no usable flight"):
        flights_of([("low", blind, None)], LAB)


@pytest.mark.parametrize("sent", [0.003, None])
def test_a_longer_delay_moves_what_acts_as_a_whole(log, sent):
    theta = vector(np.array([of_experiment(load("lab", ["plant.effects.battery=off"]))[name] for name in NAMES]))
    problem = Problem([flight_of(log, "flight", lab_of(LAB), None)], lab_of(LAB), theta)
    later = theta + 0.003 * (np.arange(len(theta)) == INDEX["delay"])
    now, then = np.moveaxis(
        problem._drives(problem.initial()._replace(framed=(sent,)), [theta, later], [Later(), Later()]), 1, 0
    )
    # Three steps; the windows begin anew.
    assert np.abs(then[3:] - now[:-3]).max() < 1e-9
    assert np.abs(then - now).max() > 0.01


def test_a_later_frame_may_carry_another_command(log):
    theta = vector(np.array([of_experiment(load("lab", ["plant.effects.battery=off"]))[name] for name in NAMES]))
    problem = Problem([flight_of(log, "flight", lab_of(LAB), None)], lab_of(LAB), theta)
    state = problem.initial()._replace(framed=(0.003,))
    now, then = np.moveaxis(problem._drives(state, [theta, theta], [Later(), Later(frames=0.003)]), 1, 0)
    # Those of the servos, pitch and roll, too.
    assert (np.abs(then[3:] - now[:-3]).max(axis=(0, 2)) > 0.005).all()


@pytest.mark.parametrize("phase_known", [True, False])
def test_servos_with_play_move_as_in_the_twin(phase_known):
    there = load("calibrate_plane")
    certain = ["radio.loss=0", "compute.spread=0"] if phase_known else []
    lab = load("lab", ["supervisor=off", "plant.effects.servo.deadband=0", *certain])
    log = fly(replace(lab, trajectory=there.trajectory, excitation=there.excitation, duration=6.0), log_dir=None).log
    flight = flight_of(log, "flight", lab_of(lab), None)
    phase = float(np.median(np.mod(1e-9 * log.acting.time[1:], 0.022))) + lab.plant.input_delay
    theta = vector(np.array([of_experiment(lab)[name] for name in NAMES]))
    # The servos' periods begin with the flight, and reach the swashplate after the delay.
    begin = np.mod(lab.plant.input_delay - phase, SERVO_PERIOD_S)
    drive = drives_of(flight, [theta], [phase if phase_known else None], [begin])[0]
    step = log.truth.stamp // 1_000_000
    step = step[(step > 1000) & (step < flight.steps - 10)].astype(int)
    for i, modelled in enumerate((drive.pitch, drive.roll)):
        true = np.interp(step, log.truth.stamp / 1e6, log.truth.actuators[:, i])
        # A step's value is reached at its end.
        misses = [float(np.std(modelled[step - 1 + late] - true)) for late in range(-5, 6)]
        assert not phase_known or np.argmin(misses) == 5
        assert min(misses) < (0.002 if phase_known else 0.04)
        assert np.polyfit(modelled[step - 1], true, 1)[0] == pytest.approx(1.0, abs=0.02)
