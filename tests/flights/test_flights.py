import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from controllers.flatness import state
from heli_twin import Experiment, fly, load, read_log
from heli_twin.experiment import Volume
from heli_twin.experiment.tree import ExperimentError, from_json
from heli_twin.flight import Flight, reproducible, verdict
from heli_twin.lab.chance import generator
from heli_twin.lab.plant import STILL_AIR
from heli_twin.lab.plant.mujoco import MuJoCo
from heli_twin.logbook import begin_log, planned_path
from heli_twin.metrics.tracking import SETTLING_S, tracking_error
from heli_twin.mission import Result
from heli_twin.recording import Recorder
from heli_twin.recording.schema import TIMING, WIRES

MS = 1_000_000
ROOT = Path(__file__).parents[2]


def flown(preset: str, *overrides: str) -> Result:
    return fly(load(preset, overrides), log_dir=None)


def largest(result: Result) -> dict[str, float]:
    return result.summary()["max_abs_error"]


@pytest.fixture(scope="module")
def lab() -> Result:
    """Four seconds of the circle with everything realistic."""
    return flown("lab", "duration=4")


def test_the_believed_model_flies_the_circle_to_a_millimetre():
    # The whole first round: the ramp and two seconds of settling are left out of the numbers.
    error = largest(flown("ideal", "duration=8"))
    # What the held input makes of a turn of 0.02 rad a period: 0.2 and 0.4 mm (the issue allows 2 mm).
    assert error["x"] < 0.001
    assert error["y"] < 0.001
    # Height is not turned: what the solver's tolerance leaves.
    assert error["z"] < 0.0001
    assert error["yaw"] < 0.001


def test_the_believed_model_hovers_to_a_tenth_of_a_millimetre():
    result = flown("ideal", "trajectory=hover", "duration=4")
    error = largest(result)
    assert max(error["x"], error["y"], error["z"]) < 0.0001
    # From the first moment, not only after settling.
    assert np.abs(tracking_error(result.log).error).max() < 0.0001


def test_forty_milliseconds_of_unknown_delay_are_the_paper_s_simulation():
    error = largest(flown("ideal", "mocap.latency=0.04", "estimator.roll_forward=false", "duration=9"))
    # Fig. 3 reads "approximately 2.5 cm" in x and in y.
    assert 0.022 < error["x"] < 0.028
    assert 0.022 < error["y"] < 0.028
    # And the same delay, known, is none.
    known = largest(flown("ideal", "mocap.latency=0.04", "duration=5"))
    assert max(known["x"], known["y"]) < 0.001


@pytest.mark.parametrize(("preset", "reach"), [("lab", 0.12), ("lab_simple", 0.09)])
def test_the_lab_flies_within_a_hand_s_breadth(preset, reach):
    flight = flown(preset, "duration=4")
    assert flight.outcome.kind == "completed"
    error = largest(flight)
    # Gust, bias, noise, lags and delay: 4 to 9 cm on the circle, 2 cm in height, 3 degrees. Drag at the hubs, which the
    # model does not know, adds 4 cm.
    assert max(error["x"], error["y"]) < reach
    assert error["z"] < 0.02
    assert error["yaw"] < np.radians(3)


@pytest.mark.parametrize("fault", ["pose_nan", "pose_outage"])
def test_lost_poses_do_not_end_the_flight(fault):
    result = flown("lab", f"faults.{fault}=on", f"faults.{fault}.start=1.5", "duration=3")
    assert result.outcome.kind == "completed"
    pose, begin = result.log.pose, 1500 * MS
    inside = (pose.stamp >= begin) & (pose.stamp < begin + (100 if fault == "pose_nan" else 300) * MS)
    assert np.isnan(pose.position[inside]).all()
    assert inside.any() == (fault == "pose_nan")
    # Every pose that is none was refused, and a person is told; of the others, one in 250 by chance.
    refused = result.log.estimate.rejected[-1]
    assert inside.sum() <= refused <= inside.sum() + 4
    assert ("pose_rejected" in {event.name for event in result.log.events}) == (refused > 0)
    # 0.3 s on the model alone: a gust of 0.25 m/s through a drag of 0.5 1/s is 1 cm, and the state was known to 5 cm/s.
    assert np.abs(tracking_error(result.log, 1.5).error[:, :3]).max() < 0.12


def test_a_helicopter_too_weak_to_hover_crashes_and_says_so():
    result = flown("lab", "plant.thrust_gain=0.2", "duration=4")
    assert result.outcome.kind == "crashed"
    # From 1 m at 9.81 - 0.2 / 0.028 m/s^2 it takes 0.9 s at full throttle, less with the rotors at hover.
    assert 0.4e9 < result.outcome.time < 1.2e9
    assert result.outcome.text.startswith("hit the floor at 0.")
    assert result.log.outcome == "crashed"
    last = result.log.events[-1]
    assert (last.severity, last.name) == ("error", "crashed")
    # The event says what happened, the outcome why, too.
    assert result.outcome.text.startswith(f"{last.text}; it is too heavy to hover")
    assert result.summary()["max_abs_error"] == dict.fromkeys(("x", "y", "z", "yaw"))
    json.dumps(result.summary(), allow_nan=False)


def test_a_helicopter_that_is_pushed_away_leaves_the_volume():
    result = flown("lab", "disturbances.bias.x=3", "duration=6")
    assert result.outcome.kind == "left_volume"
    assert result.log.truth.position[-1, 0] > load().volume.half_width
    assert result.log.truth.position[:-1].max() <= load().volume.half_width


@pytest.mark.parametrize("preset", ["ideal", "lab"])
@pytest.mark.parametrize("duration", [0.001, 0.02, 0.25, 1.015])
def test_a_flight_may_end_between_two_control_steps(preset, duration):
    result = flown(preset, f"duration={duration}")
    end = round(1e9 * duration)
    assert result.outcome[:2] == ("completed", end)
    assert result.log.truth.stamp[-1] == result.log.reference.stamp[-1] == end
    assert len(result.log.sent.time) == -(-end // (20 * MS))


def test_tipping_over_on_the_floor_is_noticed():
    """The hinges stop at 75 degrees, and on its side it lies on the rim of the rotors at 56."""
    plant, said = MuJoCo().start(np.array([0, 0, 0.3, 0, 0, 2.0, 0, 0])), []
    for k in range(1, 300):
        throttle = 0.3 if k < 150 else 0.0
        plant.advance(k * 10 * MS, np.array([0.0, 1.0, throttle, 0.0]), STILL_AIR)
        said.append(verdict(k * 10 * MS, plant.truth(), 0.05, Volume(half_width=50.0)))
    first = next(outcome for outcome in said if outcome)
    assert first.text.startswith("tipped over")
    assert (said[-1].kind, said[-1].text.split(" at ")[0]) == ("crashed", "tipped over on the floor")


def test_standing_on_the_floor_is_no_crash():
    plant = MuJoCo().start(np.array([0, 0, 0.045, 0, 0, 0, 0, 0]))
    assert plant.truth().touching
    plant.advance(1000 * MS, np.zeros(4), STILL_AIR)
    # Thrust to zero settles within a millimetre: the skids sink in by less than 0.01 mm.
    assert plant.truth().touching
    assert plant.truth().position[2] == pytest.approx(0.045, abs=1e-4)
    assert verdict(1000 * MS, plant.truth(), 0.05, Volume()) is None


def test_every_wire_is_recorded(lab):
    for topic in WIRES:
        assert len(lab.log.messages[topic.name].data), f"nothing on {topic.name}"
    steps = np.arange(0, 4000, 20) * MS
    for wire in (lab.log.sent, lab.log.timing, lab.log.qp):
        np.testing.assert_array_equal(wire.time, steps)
    for wire in (lab.log.truth, lab.log.reference):
        np.testing.assert_array_equal(wire.stamp, [*steps, 4000 * MS])
    np.testing.assert_array_equal(lab.log.disturbance.time[: len(steps)], steps)
    # The first pose takes up to 10 ms to be seen and 10 ms to arrive: no estimate and no plan before.
    assert len(lab.log.estimate.time) == len(lab.log.plan.time) >= len(steps) - 2
    # 100 Hz, less 0.5 % lost.
    assert 380 < len(lab.log.pose.time) <= 400
    # 20 ms of control, 22 ms of radio frames: ten of eleven get through, less 0.3 % lost, and the trim at the start.
    assert len(lab.log.acting.time) == pytest.approx(4000 / 22, abs=5)


def test_nothing_acts_before_it_was_decided_and_nothing_is_seen_before_it_happened(lab):
    acting, pose = lab.log.acting, lab.log.pose
    delay = (acting.time - acting.stamp)[acting.stamp >= 0]
    # Computing takes 5 to 7 ms, a frame is waited for up to 22 ms and flies 5 ms; 1 ms of physics grid.
    assert delay.min() >= 10 * MS
    assert delay.max() <= 35 * MS
    assert (np.diff(acting.stamp) > 0).all()
    # The estimator believes the mean of that, the control period's beat against the frames averaged out.
    assert delay.mean() == pytest.approx(1e9 * load().estimator.command_delay, abs=2 * MS)
    late = pose.time - pose.stamp
    # 10 ms, give or take five times the jitter.
    assert (np.abs(late - 10 * MS) < 5 * MS).all()
    for sent, u in zip(acting.stamp[1:], acting.u[1:], strict=True):
        decided = lab.log.sent.u[lab.log.sent.stamp == sent][0]
        # What acts is what was sent, to half of the radio's 682 steps.
        np.testing.assert_allclose(u, decided, rtol=0, atol=1 / 682 + 1e-12)


def test_the_ground_station_never_sees_the_truth(lab):
    """What it is told differs from what is, by the noise of the cameras and more."""
    truth = dict(zip(lab.log.truth.stamp.tolist(), lab.log.truth.position, strict=True))
    estimate = lab.log.estimate
    off = np.array([x[:3] - truth[t] for t, x in zip(estimate.time.tolist(), estimate.x, strict=True)])
    assert (np.abs(off).max(axis=1) > 0).all()


def test_same_experiment_same_flight(lab):
    again = flown("lab", "duration=4")
    assert again.flight_digest == lab.flight_digest == lab.log.digest
    for topic, messages in lab.log.messages.items():
        if topic != TIMING:
            assert list(messages.times) == list(again.log.messages[topic].times)
            assert list(map(bytes, messages.data)) == list(map(bytes, again.log.messages[topic].data)), topic


@pytest.mark.parametrize("preset", ["ideal", "lab"])
def test_the_next_flight_of_a_process_is_the_first_one_again(preset):
    """Whatever lies about in memory by then: a study flies hundreds of flights in each process."""
    rng, elsewhere, digests = np.random.default_rng(0), [], set()
    for _ in range(8):
        elsewhere.extend(bytearray(n) for n in rng.integers(1, 20_000, 20).tolist())
        digests.add(flown(preset, "duration=0.5").flight_digest)
    assert len(digests) == 1


def test_the_log_flies_again(lab):
    assert fly(from_json(lab.log.experiment), log_dir=None).flight_digest == lab.flight_digest


@pytest.mark.parametrize("change", ["seed=1", "plant.mass=0.0281", "controller.horizon=17", "volume.height=2.4"])
def test_another_experiment_another_digest(change, lab):
    assert flown("lab", "duration=4", change).flight_digest != lab.flight_digest


def test_two_processes_and_any_number_of_threads_fly_the_same_flight(lab):
    """More threads would add numbers in another order."""

    def digest(threads: str) -> str:
        limits = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), threads)
        command = [sys.executable, "-m", "heli_twin", "fly", "lab", "duration=4", "--no-log", "--json"]
        environment = os.environ | limits | {"PYTHONPATH": str(ROOT), "PYTHONHASHSEED": threads}
        done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment, timeout=60)
        return json.loads(done.stdout)["flight_digest"]

    assert digest("1") == digest("2") == lab.flight_digest


def test_what_is_kept_in_a_file_is_what_was_flown(tmp_path, lab):
    result = fly(load("lab", ["duration=4"]), log_dir=tmp_path / "new" / "folder")
    assert result.path is not None
    assert [result.path] == list((tmp_path / "new" / "folder").iterdir())
    log = read_log(result.path)
    assert log.digest == result.flight_digest == lab.flight_digest
    assert log.outcome == "completed"
    assert from_json(log.experiment) == result.experiment


def same(a, b):
    return all(np.array_equal(x, y) for x, y in zip(a, b, strict=True))


@pytest.mark.parametrize(
    "change",
    ["controller.horizon=8", "controller.coupling=full", "mocap.position_noise=0.002", "radio=off", "mocap=off"],
)
def test_two_flights_of_one_seed_meet_the_same_wind(change, lab):
    """Shared random numbers: what one part draws, or does, does not shift another's chance."""
    other = flown("lab", "duration=4", change)
    assert same(lab.log.disturbance, other.log.disturbance)
    assert not np.array_equal(lab.log.truth.position, other.log.truth.position)


@pytest.mark.parametrize("change", ["controller.horizon=8", "disturbances.gust=off", "radio=off", "plant=ideal"])
def test_two_flights_of_one_seed_are_seen_by_the_same_cameras(change, lab):
    other = flown("lab", "duration=4", change)
    np.testing.assert_array_equal(lab.log.pose.stamp, other.log.pose.stamp)
    np.testing.assert_array_equal(lab.log.pose.time, other.log.pose.time)


def flown_by(chance, *overrides: str):
    """The log of a flight whose random numbers come from `chance`."""
    e = load("lab", overrides)
    recorder = Recorder()
    outcome = Flight(e, e.plant.start(state(e.trajectory.flat(np.zeros(1)))[0]), recorder, chance=chance).run()
    recorder.close(outcome.kind, outcome.time)
    return recorder.log()


def test_every_part_that_rolls_dice_has_its_own():
    taken = []

    def spied(seed, component):
        taken.append((seed, component))
        return generator(seed, component)

    log = flown_by(spied, "duration=0.1", "seed=7")
    assert log.messages["/truth"].data == flown("lab", "duration=0.1", "seed=7").log.messages["/truth"].data
    assert {seed for seed, _ in taken} == {7}
    names = [name for _, name in taken]
    assert {"mocap", "radio", "compute", "gust"} <= set(names)
    assert len(set(names)) == len(names)


class Calm(np.random.Generator):
    """Normal numbers that are all 0: the place where a search for rare flights puts its own."""

    def standard_normal(self, size=None, **_):
        return 0.0 if size is None else np.zeros(size)


def test_all_gusts_and_noise_come_from_the_chance_that_a_flight_is_given():
    log = flown_by(lambda *_: Calm(np.random.PCG64(0)), "duration=0.5", "mocap.dropout=0", "radio.loss=0")
    assert not log.disturbance.wind.any()
    _, seen, true = np.intersect1d(log.pose.stamp // (20 * MS), log.truth.time // (20 * MS), return_indices=True)
    # In 20 ms it flies no farther than this.
    assert np.abs(log.pose.position[seen] - log.truth.position[true]).max() < 0.01
    assert (np.diff(log.pose.stamp) == 10 * MS).all()
    assert set(log.messages["/mocap/pose"].times - log.pose.stamp) == {10 * MS}


def test_a_longer_flight_begins_like_a_shorter_one():
    short, long = (flown("lab", f"duration={duration}").log for duration in (0.5, 6.0))
    for topic in (topic.name for topic in WIRES if topic.name not in (TIMING, "/events")):
        ours, theirs = short.messages[topic], long.messages[topic]
        n = sum(t < 500 * MS for t in ours.times)
        assert n > 20
        assert [*map(bytes, ours.data[:n])] == [*map(bytes, theirs.data[:n])], topic


def test_another_seed_another_wind(lab):
    assert not np.array_equal(lab.log.disturbance.wind, flown("lab", "duration=4", "seed=1").log.disturbance.wind)


def test_roll_forward_keeps_the_heading_from_swinging():
    """The delay-critical axis: with 45 ms of loop delay that nobody accounts for, yaw limit-cycles."""
    slow = ["trajectory=hover", "duration=4", "compute.latency=0.014", "mocap.latency=0.015"]
    on, off = (
        flown("lab", *slow, "estimator.command_delay=0.03", f"estimator.roll_forward={b}") for b in ("true", "false")
    )
    swings = [np.ptp(tracking_error(result.log, SETTLING_S).error[:, 3]) for result in (on, off)]
    assert swings[0] < np.radians(3)
    assert swings[1] > 3 * swings[0]


def test_an_experiment_made_in_python_is_checked_like_one_from_a_file():
    with pytest.raises(ExperimentError, match="duration = -1"):
        fly(Experiment(duration=-1.0), log_dir=None)
    assert fly(Experiment(duration=0.1), log_dir=None).flight_digest == flown("lab", "duration=0.1").flight_digest


def test_progress_is_told_at_every_control_step():
    told: list[float] = []
    fly(load("ideal", ["duration=0.2"]), log_dir=None, progress=told.append)
    # Nanoseconds as seconds: rounding.
    np.testing.assert_allclose(told, 0.02 * np.arange(10), rtol=0, atol=1e-12)


def test_a_flight_is_one_screen():
    """The loop is what a newcomer reads first."""
    loop = (Flight.advance, Flight.tick, Flight.coast)
    assert len({line for part in loop for *_, line in part.__code__.co_lines() if line}) < 40


def test_a_flight_can_be_flown_in_slices_from_outside():
    """A room with several helicopters stops each of them at common times."""
    e = load("lab_simple", ["duration=1", "faults.pose_outage.start=0.3"])
    plant = e.plant.start(state(e.trajectory.flat(np.zeros(1)))[0])
    with begin_log(None, e, mjcf=plant.description()) as recorder, reproducible():
        recorder.reference_path(0, planned_path(e))
        flight, slices = Flight(e, plant, recorder), 0
        while (outcome := flight.advance(flight.now + flight.on_grid(7_000_000))) is None:
            slices += 1
    assert slices > 100
    assert outcome.kind == "completed"
    assert recorder.digest == flown("lab_simple", "duration=1", "faults.pose_outage.start=0.3").flight_digest
