"""Where the helicopter was: by the truth, and by the cameras of a log that has none."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from heli_twin import fly, load
from heli_twin.metrics.motion import errors, motion, outages, statistics
from heli_twin.metrics.tracking import tracking_error
from heli_twin.recording.records import Messages


@pytest.fixture(scope="module")
def flown():
    words = [
        "trajectory=pirouette",
        "trajectory.rate=2",
        "duration=4",
        "disturbances.bias=on",
        "disturbances.bias.x=0.3",
    ]
    return fly(load("ideal", words), log_dir=None).log


@pytest.fixture(scope="module")
def seen(flown):
    return replace(flown, messages={name: topic for name, topic in flown.messages.items() if name != "/truth"})


def test_perfect_cameras_see_the_truth(flown, seen):
    by_truth, by_cameras = motion(flown), motion(seen)
    assert (by_truth.by_cameras, by_cameras.by_cameras) == (False, True)
    there = np.column_stack([np.interp(by_truth.time, by_cameras.time, column) for column in by_cameras.state.T])
    early = by_truth.time <= by_cameras.time[-1]
    assert there[early] == pytest.approx(by_truth.state[early], abs=1e-6)


def test_errors_by_cameras_are_those_of_the_truth(flown, seen):
    time, error = errors(seen)
    truth = tracking_error(flown)
    assert len(time) > 100
    assert time == pytest.approx(truth.time[: len(time)])
    assert error == pytest.approx(truth.error[: len(time)], abs=1e-6)
    assert np.abs(error[:, 3]).max() < np.pi
    assert np.abs(error[:, 0]).max() > 0.001
    assert errors(flown)[1] == pytest.approx(truth.error)
    no_plan = {topic: messages for topic, messages in seen.messages.items() if topic != "/reference"}
    assert errors(replace(seen, messages=no_plan))[1].shape == (0, 4)


def test_statistics_are_those_of_the_magnitudes_between_two_times(flown):
    truth = tracking_error(flown)
    kept = truth.error[(truth.time >= 1.0) & (truth.time <= 3.0)]
    distance, yaw = np.linalg.norm(kept[:, :3], axis=1), np.abs(kept[:, 3])
    told = statistics(flown, 1.0, 3.0)
    for name, values in (("position", distance), ("yaw", yaw)):
        assert told[name] == pytest.approx(
            {
                "rmse": np.sqrt(np.mean(values**2)),
                "mean": values.mean(),
                "median": np.median(values),
                "std": values.std(),
                "min": values.min(),
                "max": values.max(),
                "sse": np.sum(values**2),
            }
        )
    assert statistics(flown, 9.0) is None


def test_a_gap_between_poses_of_a_tenth_of_a_second_is_an_outage_and_a_shorter_one_is_none():
    stamp = np.concatenate([np.arange(0, 100), np.arange(110, 200), np.arange(206, 300)]) * 10_000_000
    log = SimpleNamespace(pose=SimpleNamespace(stamp=stamp), ending=SimpleNamespace(time=3_000_000_000))
    (gap,) = outages(log)
    assert (gap.start, gap.end) == pytest.approx((0.99, 1.10))


def test_one_pose_and_none_after_it_is_an_outage_to_the_end():
    log = SimpleNamespace(
        pose=SimpleNamespace(stamp=np.array([500_000_000])), ending=SimpleNamespace(time=2_000_000_000)
    )
    assert outages(log) == [(0.5, 2.0, "no poses")]


def test_of_slow_cameras_four_periods_are_a_gap():
    stamp = np.array([0, 1, 2, 3, 6, 11]) * 100_000_000
    log = SimpleNamespace(pose=SimpleNamespace(stamp=stamp), ending=SimpleNamespace(time=1_200_000_000))
    assert [(gap.start, gap.end) for gap in outages(log)] == [pytest.approx((0.6, 1.1))]


@pytest.mark.parametrize(("poses", "found"), [(0, 0), (2, 1), (4, 2)])
def test_a_control_step_between_two_poses_has_an_error(seen, poses, found):
    pose = seen.messages["/mocap/pose"]
    few = replace(
        seen, messages={**seen.messages, "/mocap/pose": Messages(*(column[50 : 50 + poses] for column in pose))}
    )
    time, error = errors(few)
    assert len(motion(few).time) == poses
    assert (time.shape, error.shape) == ((found,), (found, 4))
