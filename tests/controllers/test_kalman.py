from dataclasses import replace
from math import cos, exp, pi, sin

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2

from controllers.estimators.kalman import Kalman, heading
from controllers.model import Model, advance
from controllers.signals import Pose

MS = 1_000_000
MODEL = Model()
AT_REST = (0.1, -0.2, 1.0, 0.5, 0.0, 0.0, 0.0, 0.0)


def attitude(yaw, pitch=0.0, roll=0.0):
    """Yaw, then pitch, then roll, as a quaternion."""

    def about(axis, angle):
        q = np.zeros(4)
        q[0], q[axis] = cos(angle / 2), sin(angle / 2)
        return q

    def times(p, q):
        w, v = p[0] * q[0] - p[1:] @ q[1:], p[0] * q[1:] + q[0] * p[1:] + np.cross(p[1:], q[1:])
        return np.array([w, *v])

    return times(times(about(3, yaw), about(2, pitch)), about(1, roll))


def pose_of(x, stamp=0):
    return Pose(stamp, np.array(x[:3]), attitude(x[3]))


def swinging(t):
    """Inputs (4,) that move all axes, at a control time in s."""
    return np.array([0.3 * sin(5 * t), 0.2 * cos(3 * t), MODEL.u_hover[2] + 0.02 * sin(2 * t), 0.05 * sin(t)])


class Lab:
    """The model flown in steps of 1 ms, seen every 10 ms, commanded every 20 ms."""

    def __init__(self, spec, x=AT_REST, *, push=(0.0, 0.0, 0.0, 0.0), latency=12 * MS, see=lambda pose: pose):
        self.filter = spec.start(MODEL)
        self.estimates, self.truth = {}, {}
        self._x, self._push, self._latency, self._see = x, push, latency, see
        self._delay, self._acting, self._t = round(spec.command_delay * 1e9), np.array(MODEL.u_hover), 0
        self._sent, self._poses = [], []

    def fly(self, seconds, u=swinging):
        until = self._t + round(1000 * seconds) * MS
        while self._t < until:
            t = self._t
            self.truth[t] = self._x
            if t % (10 * MS) == 0 and (seen := self._see(pose_of(self._x, t))):
                self._poses.append((t + self._latency, seen))
            if t % (20 * MS) == 0:
                while self._poses and self._poses[0][0] <= t:
                    self.filter.receive(*self._poses.pop(0))
                self.estimates[t] = self.filter.estimate(t)
                command = u(1e-9 * t)
                self.filter.command_sent(t, command)
                self._sent.append((t + self._delay, command))
            while self._sent and self._sent[0][0] <= t:
                self._acting = self._sent.pop(0)[1]
            self._x = advance(MODEL, self._x, tuple(self._acting), 0.001, self._push)
            self._t += MS
        return self

    def errors(self, since=0.0):
        """Estimate minus truth at the moment the estimate holds for, (n, 8)."""
        held = [e for t, e in self.estimates.items() if e and t >= since * 1e9 and e.stamp in self.truth]
        assert held
        return np.array([e.x - self.truth[e.stamp] for e in held])


@pytest.mark.parametrize("latency", [0, 12 * MS, 45 * MS])
@pytest.mark.parametrize("delay", [0.0, 0.022, 0.05])
def test_exact_poses_give_the_exact_state_when_the_command_will_act(latency, delay):
    lab = Lab(Kalman(command_delay=delay), latency=latency).fly(3.0)
    assert all(e.stamp == t + round(delay * 1e9) for t, e in lab.estimates.items() if e)
    # Steps of 1 ms against steps of up to 20 ms: the longer one's Runge-Kutta error, 1e-9 a step.
    assert np.abs(lab.errors()).max() < 1e-7


def test_a_wrong_delay_is_seen():
    """The counterpart of the law above: it could not hold by luck."""
    lab = Lab(Kalman(command_delay=0.022), latency=12 * MS)
    lab.filter = Kalman(command_delay=0.042).start(MODEL)
    lab.fly(3.0)
    assert np.abs(lab.errors()).max() > 1e-3


def test_without_roll_forward_the_newest_pose_is_taken_for_now():
    spec = Kalman(roll_forward=False)
    lab = Lab(spec, latency=40 * MS).fly(3.0)
    for t, e in lab.estimates.items():
        if e:
            assert e.stamp == t
            assert e.pose_stamp == t - 40 * MS
            # The Runge-Kutta error of the filter's longer steps.
            np.testing.assert_allclose(e.x, lab.truth[e.pose_stamp], rtol=0, atol=1e-7)


@pytest.mark.parametrize("roll_forward", [True, False])
def test_the_lead_is_how_far_ahead_estimates_hold(roll_forward):
    spec = Kalman(roll_forward=roll_forward, command_delay=0.03)
    kalman = spec.start(MODEL)
    kalman.receive(0, pose_of(AT_REST))
    assert kalman.estimate(20 * MS).stamp == 20 * MS + round(1e9 * spec.lead)


def test_before_the_first_pose_there_is_no_estimate():
    kalman = Kalman().start(MODEL)
    kalman.command_sent(0, np.array(MODEL.u_hover))
    assert kalman.estimate(20 * MS) is None


def test_an_unknown_motion_is_learnt():
    lab = Lab(Kalman(), (0.1, -0.2, 1.0, 0.5, 0.6, -0.4, 0.2, 2.0)).fly(8.0)
    errors = np.abs(lab.errors(since=0.5)), np.abs(lab.errors(since=6.0))
    # Half a second tells the speed to a few cm/s; the disturbance that was blamed meanwhile decays with 1 s.
    assert errors[0][:, 4:7].max() < 0.1
    assert errors[1].max() < 1e-3


def test_a_constant_push_is_learnt():
    push = (0.1, -0.05, 0.2, 2.0)
    lab = Lab(Kalman(), push=push).fly(8.0)
    # The filter's slowest time constant is 1 s: exp(-8) = 3e-4 of the push.
    np.testing.assert_allclose(lab.estimates[7980 * MS].disturbance, push, rtol=2e-3, atol=0)
    assert np.abs(lab.errors(since=7.0)).max() < 1e-4


def noisy(rng):
    def see(pose):
        position = pose.position + 0.0005 * rng.standard_normal(3)
        return Pose(pose.stamp, position, attitude(heading(pose.quat_wxyz) + 0.0052 * rng.standard_normal()))

    return see


def test_it_coasts_through_an_outage():
    rng = np.random.default_rng(0)
    see = noisy(rng)
    lab = Lab(Kalman(), see=lambda pose: None if 3000 * MS <= pose.stamp < 3300 * MS else see(pose)).fly(5.0)
    blind = [t for t, e in lab.estimates.items() if e and 3012 * MS <= t < 3312 * MS]
    assert {lab.estimates[t].pose_stamp for t in blind} == {2990 * MS}
    variances = np.array([lab.estimates[t].variance for t in blind])
    assert (np.diff(variances, axis=0) > 0).all()
    off = np.abs(lab.errors(since=3.0))
    # 0.02 m/s and 0.1 rad/s of what was not known when the lights went out, 0.1 m/s^2 and 1 rad/s^2, for 0.34 s.
    assert off[:, :3].max() < 0.02
    assert off[:, 3].max() < 0.1
    assert off[:, 4:7].max() < 0.06
    assert off[:, 7].max() < 0.5
    # Half a second later it is as good as before, within the luck of a hundred poses; none was refused for the gap.
    assert np.abs(lab.errors(since=3.8)[:, :3]).max() < 1.5 * np.abs(lab.errors(since=1.0)[:95, :3]).max()
    assert lab.estimates[3600 * MS].rejected == lab.estimates[3000 * MS].rejected


@pytest.mark.parametrize("u_yaw", [0.4, -0.4])
def test_yaw_unwraps_over_many_turns(u_yaw):
    lab = Lab(Kalman()).fly(8.0, lambda t: np.array([0, 0, MODEL.u_hover[2], u_yaw]))
    # 8.9 rad/s: eleven turns.
    assert abs(lab.truth[7999 * MS][3]) > 60
    # The Runge-Kutta error of yaw is none; 1e-14 rad of rounding a pose, held up by the filter.
    assert np.abs(lab.errors()[:, 3]).max() < 1e-9


def test_yaw_unwraps_through_noise_at_the_seam():
    lab = Lab(Kalman(), (0, 0, 1, pi, 0, 0, 0, 0), see=noisy(np.random.default_rng(1))).fly(3.0, lambda t: MODEL_HOVER)
    # The first pose may be read as -pi as well as pi: one of the two it stays.
    yaw = np.array([e.x[3] for e in lab.estimates.values() if e])
    assert np.ptp(yaw) < 0.05
    assert abs(abs(yaw[0]) - pi) < 0.05


MODEL_HOVER = np.array(MODEL.u_hover)
GOOD = pose_of(AT_REST)


def broken():
    for i in range(3):
        for value in (np.nan, np.inf, -np.inf):
            yield GOOD._replace(position=np.where(np.arange(3) == i, value, GOOD.position))
    for i in range(4):
        for value in (np.nan, np.inf):
            yield GOOD._replace(quat_wxyz=np.where(np.arange(4) == i, value, GOOD.quat_wxyz))
    yield GOOD._replace(quat_wxyz=np.zeros(4))
    for size in (0.49, 2.01):
        yield GOOD._replace(quat_wxyz=size * GOOD.quat_wxyz)
    yield GOOD._replace(position=np.full(3, np.nan), quat_wxyz=np.full(4, np.nan))


@pytest.mark.parametrize("bad", list(broken()))
def test_a_pose_that_is_none_is_refused_and_counted(bad):
    kalman, undisturbed = Kalman().start(MODEL), Kalman().start(MODEL)
    kalman.receive(0, bad)
    assert kalman.estimate(0) is None
    for k in range(1, 5):
        for f in (kalman, undisturbed):
            f.receive(10 * k * MS, GOOD._replace(stamp=10 * k * MS))
        kalman.receive(10 * k * MS, bad._replace(stamp=(10 * k + 1) * MS))
    estimate, expected = kalman.estimate(50 * MS), undisturbed.estimate(50 * MS)
    assert estimate.rejected == 5
    assert expected.rejected == 0
    for value, wanted in zip(estimate._replace(rejected=0), expected, strict=True):
        np.testing.assert_array_equal(value, wanted)


@pytest.mark.parametrize(
    "leap", [[0.05, 0, 0, 0], [0, -0.05, 0, 0], [0, 0, 0.05, 0], [0, 0, 0, 0.5]], ids=["x", "y", "z", "yaw"]
)
def test_an_outlier_is_gated(leap):
    """A marker swap: 5 cm or 30 degrees, where a hundred poses of 0.5 mm have said otherwise."""

    def see(pose):
        if pose.stamp != 2000 * MS:
            return pose
        return Pose(pose.stamp, pose.position + leap[:3], attitude(heading(pose.quat_wxyz) + leap[3]))

    lab = Lab(Kalman(), see=see).fly(3.0)
    assert lab.estimates[2980 * MS].rejected == 1
    # As if that frame had not been seen; an exact model does not miss it.
    assert np.abs(lab.errors()).max() < 1e-7


def test_noise_as_it_is_believed_to_be_is_not_gated():
    lab = Lab(Kalman(), see=noisy(np.random.default_rng(2))).fly(10.0)
    # 1000 poses of 4 numbers, each refused with 0.1 %: 4 expected.
    assert lab.estimates[9980 * MS].rejected < 12


def carried_away(kalman):
    """Seven turns, then somebody carries it away: when the filter believes so, and the yaw rate until then."""
    turned = 7 * 2 * pi + 0.5
    for k in range(1001):
        kalman.receive(10 * k * MS, pose_of((*AT_REST[:3], 0.5 + (turned - 0.5) * k / 1000), 10 * k * MS))
    elsewhere = (1.5, -1.0, 0.5, turned + 1.0, 0, 0, 0, 0)
    now = 10_000 * MS
    turning = kalman.estimate(now).x[7]
    assert turning == pytest.approx(7 * 2 * pi / 10, rel=0.01)
    while abs(kalman.estimate(now).x[0] - AT_REST[0]) < 0.02:
        now += 10 * MS
        # A micrometre to and fro: poses that repeat themselves would be frozen.
        kalman.receive(now, pose_of((1.5, -1.0, 0.5 + 1e-6 * (now // MS % 20), *elsewhere[3:]), now))
        assert now < 12_000 * MS
    return now, elsewhere, turning


@pytest.mark.parametrize(
    ("spec", "poses"),
    [(Kalman(reset_after=n, withstand_faults=False), n) for n in (1, 5, 20)]
    + [(Kalman(jump_time=t), 1 + round(100 * t)) for t in (0.3, 0.6)],
)
def test_a_jump_that_lasts_is_believed_and_the_motion_kept(spec, poses):
    kalman = replace(spec, command_delay=0.0).start(MODEL)
    now, elsewhere, turning = carried_away(kalman)
    estimate = kalman.estimate(now)
    assert now == 10_000 * MS + 10 * poses * MS
    assert estimate.rejected == poses
    assert estimate.pose_stamp == now
    # It is where it was just seen, with the turns it has made.
    np.testing.assert_allclose(estimate.x[:4], elsewhere[:4], rtol=0, atol=1e-5)
    np.testing.assert_allclose(estimate.x[4:7], 0.0, rtol=0, atol=1e-9)
    # It turns on, for the disturbance balances drag; where jumps are doubted, that fades with what is its mean: 1 %.
    assert estimate.x[7] == pytest.approx(turning, rel=0.01 if spec.withstand_faults else 1e-9)
    assert not estimate.disturbance.any()


def test_one_good_pose_starts_the_count_anew():
    kalman = Kalman(reset_after=3).start(MODEL)
    for k in range(60):
        leap = 0.5 if k % 3 else 0.0
        kalman.receive(10 * k * MS, pose_of((AT_REST[0] + leap, *AT_REST[1:]), 10 * k * MS))
    estimate = kalman.estimate(600 * MS)
    assert estimate.rejected == 40
    assert estimate.x[0] == pytest.approx(AT_REST[0], abs=1e-6)


@pytest.mark.parametrize("age", [0, 1, 10 * MS])
def test_a_stale_pose_is_refused(age):
    kalman = Kalman().start(MODEL)
    kalman.receive(100 * MS, pose_of(AT_REST, 90 * MS))
    before = kalman.estimate(100 * MS)
    # Near enough not to be gated.
    kalman.receive(101 * MS, pose_of((AT_REST[0] + 0.0003, *AT_REST[1:]), 90 * MS - age))
    after = kalman.estimate(100 * MS)
    assert after.rejected == 1
    for a, b in zip(after._replace(rejected=0), before, strict=True):
        np.testing.assert_array_equal(a, b)


def test_after_the_first_pose_the_motion_is_unknown():
    spec = Kalman(command_delay=0.0)
    kalman = spec.start(MODEL)
    kalman.receive(0, pose_of(AT_REST, 0))
    seen, seen_yaw = spec.position_noise**2, spec.yaw_noise**2
    # 1 m/s, 3 rad/s, 0.3 m/s^2 and 3 rad/s^2, standard deviations.
    expected = [[seen, 1.0, 0.09]] * 3 + [[seen_yaw, 9.0, 9.0]]
    np.testing.assert_allclose(kalman.estimate(0).variance, expected, rtol=1e-12)


def test_without_poses_an_unknown_motion_spreads_with_the_time():
    """The variances are those at the time of the estimate: 100 ms after the pose, 140 ms with a command's delay.

    Without roll-forward it is as old as the pose was on its arrival.
    """
    model = replace(MODEL, k_x=0.0, k_y=0.0, k_yaw=0.0)
    for command_delay, roll_forward, t in ((0.0, True, 0.1), (0.04, True, 0.14), (0.04, False, 0.09)):
        spec = Kalman(command_delay=command_delay, roll_forward=roll_forward)
        kalman = spec.start(model)
        kalman.receive(10 * MS, pose_of(AT_REST, 0))
        # p + v t + d t^2 / 2 and v + d t, with 1 m/s, 3 rad/s, 0.3 m/s^2 and 3 rad/s^2 at first.
        expected = [
            [noise**2 + v * t**2 + d * t**4 / 4, v + d * t**2 + speed_walk**2 * t, d + walk**2 * t]
            for noise, v, d, speed_walk, walk in [
                (spec.position_noise, 1.0, 0.09, spec.velocity_walk, spec.disturbance_walk),
                (spec.yaw_noise, 9.0, 9.0, spec.yaw_rate_walk, spec.yaw_disturbance_walk),
            ]
        ]
        variance = kalman.estimate(100 * MS).variance
        np.testing.assert_allclose(variance, [expected[0]] * 3 + [expected[1]], rtol=1e-9)


def test_errors_are_as_large_as_the_filter_says():
    """A helicopter without drag that is pushed about exactly as the filter believes, 300 times."""
    spec = Kalman(command_delay=0.0, gate=1e9)
    model, rng = replace(MODEL, k_x=0.0, k_y=0.0, k_yaw=0.0), np.random.default_rng(0)
    noise = np.array([spec.position_noise] * 3 + [spec.yaw_noise])
    walk = np.array([spec.velocity_walk] * 3 + [spec.yaw_rate_walk]) * 0.1
    drift = np.array([spec.disturbance_walk] * 3 + [spec.yaw_disturbance_walk]) * 0.1
    runs, ratios = 300, []
    for _ in range(runs):
        kalman = spec.start(model)
        # High up, for the filter knows the floor.
        place, speed, push = np.array([0, 0, 10, 0.3]), rng.normal(0, [1, 1, 1, 3]), rng.normal(0, [0.3, 0.3, 0.3, 3])
        for k in range(40):
            seen = place + noise * rng.standard_normal(4)
            kalman.receive(10 * k * MS, pose_of(seen, 10 * k * MS))
            before = place, speed, push
            place, speed = place + 0.01 * speed + 0.5e-4 * push, speed + 0.01 * push
            speed, push = speed + walk * rng.standard_normal(4), push + drift * rng.standard_normal(4)
        place, speed, push = before
        estimate = kalman.estimate(390 * MS)
        c, s = cos(estimate.x[3]), sin(estimate.x[3])
        vx, vy = estimate.x[4:6]
        rates = np.array([c * vx - s * vy, s * vx + c * vy, *estimate.x[6:]])
        error = np.stack([estimate.x[:4] - place, rates - speed, estimate.disturbance - push], axis=1)
        ratios.append(error**2 / estimate.variance)
    total = np.sum(ratios, axis=0)
    # 12 sums of 300 squared unit normals each: chi^2, at 0.1 % on either side.
    assert (total > chi2.ppf(0.001, runs)).all()
    assert (total < chi2.ppf(0.999, runs)).all()


@given(st.floats(-3.1, 3.1), st.floats(-1.4, 1.4), st.floats(-3, 3), st.floats(0.8, 1.2), st.sampled_from([1, -1]))
def test_heading_is_the_yaw_of_any_attitude(yaw, pitch, roll, size, sign):
    # Rounding, magnified by 1 / cos(1.4) near the pole.
    assert heading(sign * size * attitude(yaw, pitch, roll)) == pytest.approx(yaw, abs=1e-13)


def lost(start, duration):
    """No poses from `start` for `duration` s."""
    return lambda pose: None if start <= 1e-9 * pose.stamp < start + duration else pose


def changed(start, duration, change):
    """Poses that a tracker gets wrong from `start` for `duration` s."""
    return lambda pose: change(pose) if start <= 1e-9 * pose.stamp < start + duration else pose


def half_turn(axis):
    def change(pose):
        w, x, y, z = pose.quat_wxyz
        return pose._replace(quat_wxyz=np.array([(-x, w, z, -y), (-y, -z, w, x), (-z, y, -x, w)][axis]))

    return change


def seen_through(fault, seed=3):
    """A noisy flight of 5 s whose poses pass a fault."""
    see = noisy(np.random.default_rng(seed))
    return Lab(Kalman(), push=(0.1, -0.05, 0.0, 0.0), see=lambda pose: fault(see(pose))).fly(5.0)


def assert_same_estimates(lab, expected):
    for t, estimate in lab.estimates.items():
        if estimate:
            for a, b in zip(estimate._replace(rejected=0), expected.estimates[t]._replace(rejected=0), strict=True):
                np.testing.assert_array_equal(a, b)


def test_frozen_poses_are_lost_poses():
    last = []

    def freeze(pose):
        frozen = pose if not last or not 3.0 <= 1e-9 * pose.stamp < 3.5 else last[-1]._replace(stamp=pose.stamp)
        last.append(frozen)
        return frozen

    assert_same_estimates(seen_through(freeze), seen_through(lost(3.0, 0.5)))


def test_exact_poses_of_a_helicopter_that_stands_still_are_not_frozen():
    lab = Lab(Kalman()).fly(2.0, lambda t: MODEL_HOVER)
    assert lab.estimates[1980 * MS].rejected == 0


@pytest.mark.parametrize("duration", [0.01, 0.2, 2.0])
@pytest.mark.parametrize("axis", [0, 1, 2], ids="xyz")
def test_a_flipped_attitude_is_turned_back(axis, duration):
    lab, sound = seen_through(changed(3.0, duration, half_turn(axis))), seen_through(lambda pose: pose)
    for t, estimate in lab.estimates.items():
        if estimate:
            assert estimate.rejected == sound.estimates[t].rejected
            # Rounding of the half turn.
            np.testing.assert_allclose(estimate.x, sound.estimates[t].x, rtol=0, atol=1e-9)


def test_a_first_pose_that_is_flipped_does_not_stay():
    lab = seen_through(changed(0.0, 0.2, half_turn(2)))
    # Within `reset_after` poses of the first right one; the wrong motion learnt meanwhile is gone half a second later.
    assert np.abs(np.sin(lab.errors(since=0.8)[:, 3])).max() < 0.05
    assert np.cos(lab.errors(since=0.3)[:, 3]).min() > 0.5


@pytest.mark.parametrize("size", [0.05, 0.3, 1.0])
@pytest.mark.parametrize("yaw", [0.0, 0.5])
def test_a_jump_that_does_not_last_is_not_believed(size, yaw):
    rng = np.random.default_rng(0)
    leap = rng.normal(size=3)
    leap *= size / np.linalg.norm(leap)

    def swap(pose):
        return Pose(pose.stamp, pose.position + leap, attitude(heading(pose.quat_wxyz) + yaw))

    assert_same_estimates(seen_through(changed(3.0, 0.3, swap)), seen_through(lost(3.0, 0.3)))


@pytest.mark.parametrize("kick", [(0.8, 0.0, 0.0), (0.0, -0.8, 0.0), (0.0, 0.0, 0.5)])
def test_a_helicopter_that_was_hit_is_followed(kick):
    """No jump: the poses move on from where it was, at a speed that nobody foresaw."""
    kicked = changed(3.0, 9.0, lambda p: p._replace(position=p.position + (1e-9 * p.stamp - 3.0) * np.array(kick)))
    lab = seen_through(kicked)
    errors = lab.errors(since=3.0)[:, :3] - np.outer(np.arange(0.022, 2.0, 0.02)[: len(lab.errors(since=3.0))], kick)
    # Five refused poses and the age of the newest: 0.8 m/s for 0.1 s; then it is as good as ever.
    assert np.abs(errors).max() < 0.1
    assert np.abs(errors[30:]).max() < 0.01


def test_a_disturbance_fades_to_its_mean_on_every_axis():
    spec = Kalman()
    kalman = spec.start(MODEL)
    kalman._stamp, kalman._d, kalman._d_mean = 0, (1.0, -2.0, 3.0, 4.0), (0.1, 0.2, -0.3, 0.4)
    # Of the gust, 1 / e is left after its correlation time, which begins 0.1 s after the pose.
    expected = [m + (d - m) / np.e for d, m in zip(kalman._d, kalman._d_mean, strict=True)]
    until = 100 * MS + round(spec.gust_time * 1e9)
    assert kalman._push(until) == pytest.approx(expected, rel=1e-8)
    assert kalman._push(100 * MS) == kalman._d


def test_while_nobody_looks_the_disturbance_fades_to_its_mean():
    """A push for 2 s that is a gust: half of it is the mean of 4 s, and after an outage of 3 s only that is left."""
    lab = Lab(Kalman(mean_time=4.0), see=lost(4.0, 3.5))
    lab.fly(2.0)
    lab._push = (0.3, 0.0, 0.0, 0.0)
    lab.fly(5.4)
    blind = np.array([e.disturbance[0] for t, e in lab.estimates.items() if e and t >= 4040 * MS])
    assert blind[0] == pytest.approx(0.3, rel=0.2)
    assert (np.diff(blind) <= 0).all()
    assert blind[-1] == pytest.approx(0.13, abs=0.03)
    # From 0.1 s after the last pose on; control steps are 20 ms apart.
    fades = np.diff(blind[10:])
    np.testing.assert_allclose(fades[1:] / fades[:-1], exp(-0.02 / Kalman().gust_time), rtol=1e-6)


def test_covariances_are_symmetric_and_say_what_the_estimate_says():
    estimator = Kalman().start(MODEL)
    for k in range(30):
        estimator.receive(10 * k * MS, pose_of(AT_REST, 10 * k * MS))
    now = 300 * MS
    estimate = estimator.estimate(now)
    covariance = estimator.covariance(estimate.stamp)
    np.testing.assert_array_equal(covariance, covariance.transpose(0, 2, 1))
    np.testing.assert_array_equal(covariance.diagonal(axis1=1, axis2=2), estimate.variance)
    assert (np.abs(covariance[:, 0, 1]) > 0.0).all()
    assert (np.linalg.eigvalsh(covariance) > 0.0).all()


def test_after_one_pose_no_push_is_known():
    estimator = Kalman().start(MODEL)
    estimator.receive(0, pose_of(AT_REST))
    for later in (0, 500 * MS, 5000 * MS):
        np.testing.assert_array_equal(estimator.estimate(later).disturbance, 0.0)


@pytest.mark.parametrize(("gap", "mean"), [(1000, 0.25), (4000, 1.0), (9000, 1.0)])
def test_the_mean_of_the_disturbance_is_over_the_mean_time(gap, mean):
    """After 4 s without a push the mean takes in a push of 1 m/s^2 by its share of the time, and at most whole."""
    kalman = Kalman(mean_time=4.0).start(MODEL)
    kalman._d = (0.0, 0.0, 0.0, 0.0)
    kalman._average(4000 * MS)
    kalman._d = (1.0, -1.0, 2.0, 3.0)
    kalman._average(gap * MS)
    assert kalman._d_mean == pytest.approx((mean, -mean, 2.0 * mean, 3.0 * mean))
