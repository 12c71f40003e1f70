from math import exp

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from scipy.stats import binom, chi2, norm

from controllers.estimators.kalman import heading
from heli_twin.experiment.families import members
from heli_twin.lab.mocap import PerfectMocap, Vicon, rotated
from heli_twin.lab.plant.ideal import Ideal

MS = 1_000_000
TRUTH = Ideal().start(np.array([0.3, -0.2, 1.0, 0.7, 0.5, -0.4, 0.1, 1.5])).truth()
ELSEWHERE = Ideal().start(np.array([-1.0, 0.4, 0.5, -2.0, 0.0, 0.0, 0.0, 0.0])).truth()
CLEAN = {"jitter": 0.0, "position_noise": 0.0, "bias": 0.0, "orientation_noise": 0.0, "dropout": 0.0}


def seen(frames, truth=TRUTH, seed=0, **fields):
    cameras = Vicon(**(CLEAN | fields)).start(np.random.default_rng(seed))
    return [cameras.capture(cameras.due, truth) for _ in range(frames)]


def inside(value, n):
    """Whether a sum of n squared unit normals is one that happens: 0.1 % on either side."""
    return chi2.ppf(0.001, n) < value < chi2.ppf(0.999, n)


@pytest.mark.parametrize("kind", list(members("heli_twin.lab.mocap")))
def test_every_mocap_looks_at_its_rate_and_stamps_what_it_saw(kind):
    spec = members("heli_twin.lab.mocap")[kind](rate=50.0)
    cameras = spec.start(np.random.default_rng(0))
    assert 0 <= cameras.due < 20 * MS
    for _ in range(20):
        now = cameras.due
        arrival = cameras.capture(now, TRUTH)
        assert cameras.due == now + 20 * MS
        if arrival is not None:
            assert arrival.pose.stamp == now
            assert arrival.at >= now
            # Noise of 0.3 mm, a bias of 0.5 mm and 5 mrad: ten deviations.
            np.testing.assert_allclose(arrival.pose.position, TRUTH.position, rtol=0, atol=0.008)
            assert heading(arrival.pose.quat_wxyz) == pytest.approx(TRUTH.yaw, abs=0.052)


def test_off_sees_the_truth():
    cameras = PerfectMocap(latency=0.04).start(np.random.default_rng(0))
    assert cameras.due == 0
    arrival = cameras.capture(0, TRUTH)
    assert arrival.at == 40 * MS
    np.testing.assert_array_equal(arrival.pose.position, TRUTH.position)
    np.testing.assert_array_equal(arrival.pose.quat_wxyz, TRUTH.quat_wxyz)


def test_without_errors_vicon_sees_the_truth():
    for arrival in seen(10):
        np.testing.assert_array_equal(arrival.pose.position, TRUTH.position)
        # Turned by nothing and normalised: rounding.
        np.testing.assert_allclose(arrival.pose.quat_wxyz, TRUTH.quat_wxyz, rtol=0, atol=1e-15)
        assert arrival.at - arrival.pose.stamp == 10 * MS


def test_position_noise_is_white_and_as_strong_as_is_said():
    errors = np.array([a.pose.position - TRUTH.position for a in seen(2000, position_noise=0.003)]) / 0.003
    assert inside((errors**2).sum(), errors.size)
    # The correlation of white noise with its own last value has a deviation of 1 / sqrt(n).
    assert abs((errors[1:] * errors[:-1]).mean()) < 4 / np.sqrt(errors.size)


def test_the_slow_error_is_stationary_and_slow():
    starts = np.array([seen(1, seed=seed, bias=0.004)[0].pose.position - TRUTH.position for seed in range(400)]) / 0.004
    assert inside((starts**2).sum(), starts.size)
    walk = np.array([a.pose.position - TRUTH.position for a in seen(40_000, bias=0.004, bias_time=0.1)]) / 0.004
    lag = 10
    # 0.1 s later e^-1 of it is left; 400 s hold 4000 independent pieces of each of three axes.
    correlation = (walk[lag:] * walk[:-lag]).mean() / (walk**2).mean()
    assert correlation == pytest.approx(exp(-1), abs=5 / np.sqrt(12_000))
    assert (walk**2).mean() == pytest.approx(1.0, abs=5 * np.sqrt(2 / 12_000))


def test_orientation_noise_is_as_strong_as_is_said_about_every_axis():
    arrivals = seen(2000, orientation_noise=0.01)
    w, x, y, z = TRUTH.quat_wxyz
    back = np.array([[w, x, y, z], [-x, w, z, -y], [-y, -z, w, x], [-z, y, -x, w]])
    errors = np.array([2 * (back @ a.pose.quat_wxyz)[1:] for a in arrivals]) / 0.01
    for axis in range(3):
        assert inside((errors[:, axis] ** 2).sum(), len(errors))


def test_latency_varies_as_is_said_and_never_beats_time():
    late = np.array([a.at - a.pose.stamp for a in seen(2000, latency=0.01, jitter=0.002)])
    assert inside((((late - 10 * MS) / (2 * MS)) ** 2).sum(), len(late))
    wild = np.array([a.at - a.pose.stamp for a in seen(2000, latency=0.001, jitter=0.01)])
    assert wild.min() == 0
    # What would have been early: a normal number below -0.1, within four deviations of its count.
    early = (wild == 0).mean()
    assert early == pytest.approx(norm.cdf(-0.1), abs=4 * 0.5 / np.sqrt(2000))


@pytest.mark.parametrize("dropout", [0.0, 0.1, 0.9])
def test_frames_are_lost_as_often_as_is_said(dropout):
    lost = sum(a is None for a in seen(2000, dropout=dropout))
    assert binom.ppf(0.001, 2000, dropout) <= lost <= binom.ppf(0.999, 2000, dropout)


def test_errors_depend_neither_on_the_truth_nor_on_lost_frames():
    """Shared random numbers: two flights of one seed see through the same cameras."""
    fields = {"position_noise": 0.001, "bias": 0.001, "orientation_noise": 0.01, "jitter": 0.001}
    here, there = seen(200, **fields), seen(200, ELSEWHERE, **fields)
    lossy = seen(200, **fields, dropout=0.3)
    assert sum(a is None for a in lossy) > 20
    for a, b, c in zip(here, there, lossy, strict=True):
        assert a.at == b.at
        # Differences of numbers of up to 1 m.
        error = a.pose.position - TRUTH.position
        np.testing.assert_allclose(error, b.pose.position - ELSEWHERE.position, rtol=0, atol=1e-15)
        if c is not None:
            np.testing.assert_array_equal(a.pose.position, c.pose.position)
            assert a.at == c.at


def test_phases_differ_from_flight_to_flight():
    due = [Vicon().start(np.random.default_rng(seed)).due for seed in range(200)]
    # Uniform over 10 ms: 200 draws leave no gap of a quarter of it (1e-24).
    assert np.diff(sorted(due)).max() < 2.5 * MS
    assert max(due) < 10 * MS


@given(st.floats(-3.1, 3.1), st.floats(-0.1, 0.1))
def test_a_turn_about_the_mast_turns_the_heading(yaw, angle):
    level = np.array([np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)])
    quat = rotated(level, np.array([0, 0, angle]))
    assert np.linalg.norm(rotated(quat, np.array([0.3, -0.8, 0.5]))) == pytest.approx(1.0, abs=1e-15)
    assert np.linalg.norm(quat) == pytest.approx(1.0, abs=1e-15)
    off = (heading(quat) - yaw - angle + np.pi) % (2 * np.pi) - np.pi
    # The small angle's own error: angle^3 / 12.
    assert abs(off) < 0.1**3 / 10


@given(*[st.floats(-1, 1)] * 4, *[st.floats(-0.05, 0.05)] * 3)
def test_a_small_turn_is_one_about_the_axes_of_the_body(w, x, y, z, a, b, c):
    quat = np.array([w + 2.0, x, y, z]) / np.linalg.norm([w + 2.0, x, y, z])
    expected = Rotation.from_quat(quat, scalar_first=True) * Rotation.from_rotvec([a, b, c])
    off = expected.inv() * Rotation.from_quat(rotated(quat, np.array([a, b, c])), scalar_first=True)
    # The small angle's own error: angle^3 / 12.
    assert off.magnitude() < 0.1**3 / 10
