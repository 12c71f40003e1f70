"""The detailed filter's transitions: what walks spreads with the time, what is constant stays."""

import numpy as np
import pytest

from controllers.detailed_model import DetailedModel
from controllers.estimators.detailed_kalman import DetailedKalman
from controllers.model import GRAVITY
from controllers.signals import Pose

MS = 1_000_000


def test_walks_spread_with_the_time():
    spec = DetailedKalman()
    (_, one), (_, chains) = spec.start(DetailedModel())._transition_over(20 * MS)
    (_, two), (_, twice) = spec.start(DetailedModel())._transition_over(40 * MS)
    plane = [0.0, spec.velocity_walk, 0.0, spec.tilt_walk, spec.trim_walk, spec.push_walk]
    walks = [0, 1, 2, 3, 5, 6]
    np.testing.assert_allclose(one[:, walks, walks], [np.square(plane) * 0.02] * 2, rtol=1e-12)
    np.testing.assert_allclose(two[:, walks, walks], 2.0 * one[:, walks, walks], rtol=1e-12)
    # A stationary gust: what fades of it in that time comes back as noise.
    model = DetailedModel()
    gusts = np.square(model.gust_acceleration) * (1.0 - np.exp(-2.0 * 0.02 / model.gust_time))
    np.testing.assert_allclose(one[:, 4, 4], gusts, rtol=1e-12)
    expected = np.square([[spec.climb_walk, spec.lift_walk], [spec.yaw_rate_walk, spec.yaw_push_walk]]) * 0.02
    np.testing.assert_allclose(chains[:, [1, 2], [1, 2]], expected, rtol=1e-12)
    np.testing.assert_allclose(twice[:, [1, 2], [1, 2]], 2.0 * expected, rtol=1e-12)
    for noise in (one, chains):
        np.testing.assert_array_equal(noise * (1.0 - np.eye(len(noise[0]))), 0.0)


def test_trim_and_push_stay_and_the_slow_error_of_the_cameras_fades():
    spec = DetailedKalman()
    (F, noise), (chains, chain_noise) = spec.start(DetailedModel())._transition_over(20 * MS)
    keep = np.exp(-0.02 / spec.camera_bias_time)
    np.testing.assert_array_equal(F[:, 5:7], [np.eye(8)[5:7]] * 2)
    np.testing.assert_allclose(F[:, 7], [keep * np.eye(8)[7]] * 2, rtol=1e-12)
    np.testing.assert_array_equal(chains[:, 2], [np.eye(4)[2]] * 2)
    np.testing.assert_allclose(chains[:, 3], [keep * np.eye(4)[3]] * 2, rtol=1e-12)
    # A stationary error: what fades comes back as noise. The yaw has none.
    slow = spec.camera_bias**2 * (1.0 - keep**2)
    np.testing.assert_allclose([*noise[:, 7, 7], *chain_noise[:, 3, 3]], [slow, slow, slow, 0.0], rtol=1e-12)


def test_after_one_pose_each_axis_is_as_uncertain_as_its_measurement():
    estimator = DetailedKalman().start(DetailedModel())
    spread = estimator._unknown()
    np.testing.assert_array_equal(spread.plane[:, 0, 0], [estimator._R[0]] * 2)
    np.testing.assert_array_equal(spread.chains[:, 0, 0], estimator._R[2:])
    assert estimator._R[2] != estimator._R[3]


def test_on_the_floor_it_stands_where_it_was_and_looks_where_it_did():
    estimator = DetailedKalman(floor=0.05).start(DetailedModel())
    for k in range(5):
        quat = np.array([np.cos(0.2), 0.0, 0.0, np.sin(0.2)])
        estimator.receive(10 * k * MS, Pose(10 * k * MS, np.array([0.3, -0.2, 0.051]), quat))
    before = estimator._motion._replace(yaw=np.array([0.4, 2.0, *estimator._motion.yaw[2:]]))
    moved = before._replace(
        position=before.position + 0.1,
        plane=before.plane + 0.3,
        z=np.array([0.02, -0.5, *before.z[2:]]),
        yaw=np.array([0.6, 3.0, *before.yaw[2:]]),
    )
    stands = estimator._on_the_floor(before, moved)
    np.testing.assert_array_equal(stands.position, before.position)
    assert stands.yaw[:2].tolist() == [0.4, 0.0]
    assert stands.z[:2].tolist() == [before.z[0], 0.0]
    # From more than 3 mm above the floor it sinks to what is predicted, and at most to the floor.
    high = before._replace(z=np.array([0.0535, *before.z[1:]]))
    for predicted, expected in ((0.052, 0.052), (0.02, 0.05)):
        sunk = estimator._on_the_floor(high, moved._replace(z=np.array([predicted, -0.5, *before.z[2:]])))
        assert sunk.z[:2].tolist() == [expected, 0.0]
    # Velocity, acceleration and jerk of a gust's tilt are gone, what is believed of the air stays.
    assert (np.count_nonzero(stands.plane == 0.0, axis=1) >= 3).all()


def test_a_jump_that_lasts_is_where_it_is_and_counted_until_it_is_believed():
    """Carried 0.5 m north, 0.3 m up and turned by 0.4 rad: the motion goes on from there."""
    spec = DetailedKalman()
    estimator = spec.start(DetailedModel())
    still = np.array([1.0, 0.0, 0.0, 0.0])
    for k in range(100):
        estimator.receive(10 * k * MS, Pose(10 * k * MS, np.array([0.0, 0.0, 1.0 + 1e-6 * (k % 20)]), still))
    assert estimator.estimate(990 * MS).rejected == 0
    turned = np.array([np.cos(0.2), 0.0, 0.0, np.sin(0.2)])
    refused = 0
    while estimator.estimate(990 * MS).x[0] < 0.25:
        refused += 1
        now = (990 + 10 * refused) * MS
        estimator.receive(now, Pose(now, np.array([0.5, 0.0, 1.3 + 1e-6 * (refused % 20)]), turned))
        assert refused < 200
    assert refused == 1 + round(100 * spec.jump_time)
    x = estimator.estimate(now).x
    np.testing.assert_allclose(x[:4], [0.5, 0.0, 1.3, 0.4], atol=0.02)
    assert estimator.estimate(now).rejected == refused


@pytest.mark.parametrize("place", range(3))
def test_a_pose_that_is_not_finite_is_refused_and_counted(place):
    estimator, still = DetailedKalman().start(DetailedModel()), np.array([1.0, 0.0, 0.0, 0.0])
    estimator.receive(0, Pose(0, np.array([0.0, 0.0, 1.0]), still))
    before = estimator.estimate(20 * MS)
    estimator.receive(10 * MS, Pose(10 * MS, np.where(np.arange(3) == place, np.nan, [0.0, 0.0, 1.0]), still))
    after = estimator.estimate(20 * MS)
    np.testing.assert_array_equal(after.x, before.x)
    assert (before.rejected, after.rejected) == (0, 1)


def test_a_tilt_is_fused_up_to_twice_the_gate_of_a_position():
    """In standard deviations; one beyond changes nothing, however far it is."""

    def seen(share: float) -> tuple[np.ndarray, float, float]:
        """The estimate after a tilt to the north, whose square is this share of the limit, and what it is made of."""
        estimator = DetailedKalman().start(DetailedModel())
        for k in range(30):
            angle = 0.0 if k < 29 else np.sqrt(4.0 * DetailedKalman().gate * share * variance) / GRAVITY
            quat = np.array([np.cos(0.5 * angle), 0.0, np.sin(0.5 * angle), 0.0])
            estimator.receive(10 * k * MS, Pose(10 * k * MS, np.array([1e-6 * (k % 20), 0.0, 1.0]), quat))
        tilt, spread = estimator.tilt_innovation
        return np.array(estimator.estimate(300 * MS).extra), float(tilt[0]), float(spread[0])

    variance = 0.0
    variance = seen(0.0)[2]
    fused, tilt, _ = seen(0.9)
    assert tilt**2 == pytest.approx(3.6 * DetailedKalman().gate * variance, rel=0.05)
    left, further = seen(1.15)[0], seen(1.4)[0]
    np.testing.assert_array_equal(left, further)
    assert np.abs(fused - left).max() > 1e-3
