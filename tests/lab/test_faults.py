from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from controllers.estimators.kalman import heading
from controllers.signals import Command, Pose
from heli_twin import fly
from heli_twin.experiment.families import members
from heli_twin.experiment.text import load
from heli_twin.experiment.values import SMALLEST
from heli_twin.lab.compute import Modelled, NoComputeTime
from heli_twin.lab.faults import Faults, Hooks, Spells
from heli_twin.lab.faults.clock_error import ClockError
from heli_twin.lab.faults.command_duplicate import CommandDuplicate
from heli_twin.lab.faults.command_reorder import CommandReorder
from heli_twin.lab.faults.compute_stall import ComputeStall
from heli_twin.lab.faults.gyro_failure import GyroFailure
from heli_twin.lab.faults.identity_swap import IdentitySwap
from heli_twin.lab.faults.motor_loss import MotorLoss
from heli_twin.lab.faults.pose_burst import PoseBurst
from heli_twin.lab.faults.pose_drift import PoseDrift
from heli_twin.lab.faults.pose_flip import PoseFlip
from heli_twin.lab.faults.pose_frozen import PoseFrozen
from heli_twin.lab.faults.pose_half_rate import PoseHalfRate
from heli_twin.lab.faults.pose_nan import PoseNan
from heli_twin.lab.faults.pose_outage import PoseOutage
from heli_twin.lab.faults.pose_swap import PoseSwap
from heli_twin.lab.faults.radio_outage import RadioOutage
from heli_twin.lab.faults.servo_stuck import ServoStuck
from heli_twin.lab.faults.servo_weak import ServoWeak
from heli_twin.lab.mocap import Arrival
from heli_twin.lab.plant import STILL_AIR
from heli_twin.lab.plant.ideal import Ideal
from heli_twin.lab.plant.mujoco import MuJoCo

FAMILY = members("heli_twin.lab.faults")
MS = 1_000_000
U = np.array([0.1, -0.2, 0.545, 0.03])


def rng(seed=0):
    return np.random.default_rng(seed)


def pose(ms, x=0.1):
    return Arrival((ms + 10) * MS, Pose(ms * MS, np.array([x, 0.2, 1.0]), np.array([1.0, 0, 0, 0])))


def plant():
    return Ideal().start(np.array([0, 0, 1.0, 0, 0, 0, 0, 0]))


def beside(truth):
    """Another helicopter near this one."""
    return truth._replace(position=truth.position + 0.3)


def effects(spec, every=10, seed=0, until=6_000):
    """Everything that a fault does to one flight, as plain values by wire and ms."""
    faults, helicopter = Faults([spec.hooks(rng(seed))]), plant()
    for ms in range(0, until, every):
        seen = faults.pose(pose(ms, x=0.001 * ms))
        sent = faults.commands(ms * MS, 6 * MS, Command(ms * MS, U + 1e-6 * ms))
        u = faults.input(ms * MS, U + 1e-6 * ms, helicopter)
        flat = None if seen is None else (seen.at, seen.pose.stamp, *seen.pose.position, *seen.pose.quat_wxyz)
        truth = helicopter.truth()
        taken = faults.seen(ms * MS, truth, [beside(truth)]).position - truth.position
        yield ms, flat, [(at, c.stamp, *c.u) for at, c in sent], tuple(u), helicopter.gyro_works, tuple(taken)


def untouched(ms):
    a, u = pose(ms, x=0.001 * ms), U + 1e-6 * ms
    seen = (a.at, a.pose.stamp, *a.pose.position, *a.pose.quat_wxyz)
    return ms, seen, [((ms + 6) * MS, ms * MS, *u)], tuple(u), True, tuple(np.zeros(3))


def differs(one, other):
    return str(one) != str(other)


@pytest.mark.parametrize("kind", FAMILY)
class TestEveryFault:
    def test_is_a_value(self, kind):
        spec = FAMILY[kind]()
        assert spec.kind == kind
        assert spec == FAMILY[kind]()
        assert hash(spec) == hash(FAMILY[kind]())
        with pytest.raises(FrozenInstanceError):
            spec.kind = "other"

    def test_does_the_same_to_two_flights_of_one_seed(self, kind):
        spec = FAMILY[kind](start=0.5, duration=0.1, rate=2.0)
        assert str([*effects(spec, seed=3)]) == str([*effects(spec, seed=3)])

    def test_leaves_what_it_was_given_alone(self, kind):
        given_pose, command, u = pose(5050), Command(5050 * MS, U.copy()), U.copy()
        faults = Faults([FAMILY[kind]().hooks(rng())])
        faults.pose(given_pose)
        faults.commands(5050 * MS, 0, command)
        faults.input(5050 * MS, u, plant())
        np.testing.assert_array_equal(
            [*given_pose.pose.position, *given_pose.pose.quat_wxyz], [0.1, 0.2, 1, 1, 0, 0, 0]
        )
        np.testing.assert_array_equal([*command.u, *u], [*U, *U])

    def test_does_something_between_start_and_end_and_nothing_outside(self, kind):
        spec = FAMILY[kind](start=2.0, duration=1.0)
        changed = [each[0] for each in effects(spec) if differs(each, untouched(each[0]))]
        assert changed
        # What was kept back comes with a later command, and a repetition after its delay.
        assert min(changed) >= 2000 - 6
        assert max(changed) < 3000 + 50
        assert not [each for each in effects(FAMILY[kind](start=100.0)) if differs(each, untouched(each[0]))]

    def test_two_of_them_are_both_there(self, kind):
        one, two = FAMILY[kind](start=1.0, duration=0.5), FAMILY[kind](start=3.0, duration=0.5)
        both, helicopter = Faults([one.hooks(rng(0)), two.hooks(rng(1))]), plant()
        touched = set()
        for ms in range(0, 5000, 10):
            seen = both.pose(pose(ms, x=0.001 * ms))
            sent = both.commands(ms * MS, 6 * MS, Command(ms * MS, U))
            u = both.input(ms * MS, U, helicopter)
            plain = pose(ms, x=0.001 * ms)
            calm = seen is not None and seen.at == plain.at and str(seen.pose) == str(plain.pose)
            calm &= [(at, c.stamp) for at, c in sent] == [((ms + 6) * MS, ms * MS)] and helicopter.gyro_works
            truth = helicopter.truth()
            calm &= both.seen(ms * MS, truth, [beside(truth)]) is truth
            if not calm or not np.array_equal(u, U):
                touched.add(ms // 500)
        assert {2, 6} <= touched <= {2, 3, 6, 7} or kind.startswith("servo_stuck")

    def test_is_off_unless_asked_for(self, kind):
        assert load().faults == ()
        assert load("lab", [f"faults.{kind}=on"]).faults == (FAMILY[kind](),)

    def test_flies_in_the_lab(self, kind):
        changes = ["duration=1", f"faults.{kind}.start=0.2", f"faults.{kind}.duration=0.3"]
        flown, again = (fly(load("lab", changes), log_dir=None) for _ in range(2))
        assert flown.flight_digest == again.flight_digest
        without = fly(load("lab", ["duration=1"]), log_dir=None)
        unchanged = np.array_equal(flown.log.truth.position, without.log.truth.position)
        # Alone in the room, a helicopter is not confused with another.
        assert unchanged == (kind == "identity_swap")


def test_comes_by_chance_as_often_as_its_rate_says():
    spec = PoseOutage(start=1.0, duration=0.01, rate=0.5)
    spells, starts, last = Spells(spec, rng(1)), [], None
    for ms in range(0, 400_000, 5):
        began = spells.began(ms * MS)
        if began is not None and began != last:
            starts.append(began)
        last = began or last
    # 200 expected in 400 s: four deviations of a Poisson count, less the few that lie within another.
    assert 200 - 60 < len(starts) < 200 + 57
    assert min(starts) >= 1000 * MS


# --- poses ----------------------------------------------------------------------------------------------------------


def seen(spec, ms, seed=0):
    return Faults([spec.hooks(rng(seed))]).pose(pose(ms))


spans = st.tuples(st.integers(0, 5000), st.integers(0, 2000))


@given(spans, st.integers(0, 8000))
def test_an_outage_loses_the_poses_in_it_and_no_other(span, ms):
    begin, length = span
    lost = seen(PoseOutage(start=begin / 1000, duration=length / 1000), ms) is None
    assert lost == (begin <= ms < begin + length)


@given(spans, st.integers(0, 8000))
def test_in_a_nan_fault_nothing_of_a_pose_is_a_number_but_its_stamp(span, ms):
    begin, length = span
    arrival = seen(PoseNan(start=begin / 1000, duration=length / 1000), ms)
    assert arrival.pose.stamp == ms * MS
    bad = begin <= ms < begin + length
    np.testing.assert_array_equal(np.isnan([*arrival.pose.position, *arrival.pose.quat_wxyz]), bad)


def test_the_default_outage_lasts_as_long_as_in_the_field():
    assert sum(seen(PoseOutage(), ms) is None for ms in range(10_000)) == 300


def test_a_frozen_pose_is_the_last_one_with_new_stamps():
    faults = Faults([PoseFrozen(start=0.1, duration=0.1).hooks(rng())])
    out = [faults.pose(pose(ms, x=ms)).pose for ms in range(0, 300, 10)]
    assert [p.stamp // MS for p in out] == [*range(0, 300, 10)]
    assert [p.position[0] for p in out] == [*range(0, 100, 10), *[90] * 10, *range(200, 300, 10)]


def test_a_flipped_pose_looks_the_other_way():
    flipped = seen(PoseFlip(), 5050).pose
    assert abs(heading(flipped.quat_wxyz)) == pytest.approx(np.pi, abs=1e-12)
    np.testing.assert_array_equal(flipped.position, pose(0).pose.position)


@given(st.floats(0, 2), st.floats(-3, 3), st.integers(0, 100))
def test_a_swapped_pose_jumps_by_its_size_and_turns(size, turn, seed):
    swapped = seen(PoseSwap(size=size, turn=turn), 5050, seed).pose
    jump = swapped.position - pose(0).pose.position
    assert np.linalg.norm(jump) == pytest.approx(size, abs=1e-12)
    assert jump[2] == 0
    assert heading(swapped.quat_wxyz) == pytest.approx(turn, abs=1e-12)


def test_swaps_and_drifts_go_in_any_level_direction():
    for fault in (PoseSwap(size=1.0), PoseDrift(speed=1.0)):
        moved = np.array([seen(fault, 5100, seed).pose.position - pose(0).pose.position for seed in range(40)])
        quadrants = {(x > 0.0, y > 0.0) for x, y, _ in moved}
        assert len(quadrants) == 4
        assert len(np.unique(moved[:, 0].round(9))) == 40


def test_without_a_computing_time_a_command_is_ready_at_once():
    assert NoComputeTime().latency_ns(rng()) == 0


def test_a_control_step_takes_its_latency_give_or_take_its_spread():
    source = rng()
    took = np.array([Modelled(latency=0.006, spread=0.001).latency_ns(source) for _ in range(2000)])
    assert 5 * MS <= took.min() < 5.01 * MS
    assert 6.99 * MS < took.max() <= 7 * MS
    # Uniform: four deviations of the mean of 2000.
    assert took.mean() == pytest.approx(6 * MS, abs=4 * MS / np.sqrt(3 * 2000))
    assert min(Modelled(latency=0.0005, spread=0.001).latency_ns(source) for _ in range(50)) == 0


def test_a_calibration_drifts_at_its_speed():
    drifted = seen(PoseDrift(speed=0.01, turn=0.02), 7000).pose
    assert np.linalg.norm(drifted.position - pose(0).pose.position) == pytest.approx(0.02, abs=1e-12)
    assert heading(drifted.quat_wxyz) == pytest.approx(0.04, abs=1e-12)


@pytest.mark.parametrize("every", [2, 5])
def test_at_half_rate_every_second_frame_comes(every):
    faults = Faults([PoseHalfRate(start=0.0, duration=10.0, every=every).hooks(rng())])
    came = [faults.pose(pose(ms)) is not None for ms in range(0, 1000, 10)]
    assert sum(came) == 100 // every
    assert came[every - 1 :: every] == [True] * (100 // every)


def test_a_burst_comes_when_the_network_is_back_with_its_true_stamps():
    arrivals = [seen(PoseBurst(start=1.0, duration=0.2), ms) for ms in range(900, 1300, 10)]
    for ms, arrival in zip(range(900, 1300, 10), arrivals, strict=True):
        assert arrival.pose.stamp == ms * MS
        assert arrival.at == max(ms + 10, 1200 if 1000 <= ms < 1200 else 0) * MS


def test_a_clock_error_is_a_step_and_a_drift():
    arrival = seen(ClockError(start=1.0, step=-0.02, drift=0.01), 3000)
    assert arrival.pose.stamp == round((3.0 - 0.02 + 0.01 * 2.0) * 1e9)
    assert arrival.at == 3010 * MS
    assert seen(ClockError(start=0.0, step=-1.0), 10).pose.stamp == 0


# --- commands -------------------------------------------------------------------------------------------------------


def sent(spec, steps, seed=0):
    """(when, stamp) in ms of what the radio is given of commands every 20 ms that take 6 ms."""
    faults = Faults([spec.hooks(rng(seed))])
    return [
        (at // MS, command.stamp // MS)
        for ms in range(0, 20 * steps, 20)
        for at, command in faults.commands(ms * MS, 6 * MS, Command(ms * MS, U))
    ]


def test_in_a_radio_outage_no_command_is_sent():
    stamps = [stamp for _, stamp in sent(RadioOutage(start=0.1, duration=0.1), 15)]
    # Ready 6 ms after their steps: at 106, ... 186 ms.
    assert stamps == [0, 20, 40, 60, 80, 200, 220, 240, 260, 280]


def test_reordered_commands_are_all_sent_the_older_one_last():
    stamps = [stamp for _, stamp in sent(CommandReorder(start=0.05, duration=0.09), 10)]
    # Ready at 66 and 106 ms, those of 60 and 100 are kept back until the next one.
    assert stamps == [0, 20, 40, 80, 60, 120, 100, 140, 160, 180]


def test_duplicated_commands_come_again_after_the_delay():
    stamps = [stamp for _, stamp in sent(CommandDuplicate(start=0.0, duration=0.05, delay=0.03), 6)]
    # Each of the first three once more, with the first command that is ready 30 ms later.
    assert stamps == [0, 20, 40, 0, 60, 20, 80, 40, 100]


def test_a_stall_keeps_commands_until_its_end():
    for at, stamp in sent(ComputeStall(start=0.1, duration=0.1), 15):
        assert at == (206 if 100 <= stamp < 200 else stamp + 6)


# --- servos, motors, gyro -------------------------------------------------------------------------------------------


def acted(spec, ms, u=U):
    return Faults([spec.hooks(rng())]).input(ms * MS, u, plant())


@pytest.mark.parametrize(("axis", "index"), [("pitch", 0), ("roll", 1)])
def test_a_stuck_servo_stays_where_it_was(axis, index):
    faults, helicopter = Faults([ServoStuck(start=0.1, duration=0.1, axis=axis).hooks(rng())]), plant()
    for ms in range(0, 300, 20):
        u = U + 0.0005 * ms
        helicopter.advance(ms * MS, u, STILL_AIR)
        if ms == 100:
            stuck = helicopter.truth().actuators[index]
        expected = u.copy()
        if 100 <= ms < 200:
            expected[index] = stuck
        np.testing.assert_array_equal(faults.input(ms * MS, u, helicopter), expected)


def test_a_servo_that_gets_stuck_again_stays_where_it_is_then():
    fault, helicopter = ServoStuck(start=0.0, duration=0.1, rate=2.0), plant()
    act, spells = Faults([fault.hooks(rng(3))]), Spells(fault, rng(3))
    positions: dict[int, float] = {}
    for ms in range(0, 4000, 20):
        helicopter.advance(ms * MS, U + 1e-4 * ms, STILL_AIR)
        began = spells.began(ms * MS)
        expected = 9.0 if began is None else positions.setdefault(began, helicopter.truth().actuators[0])
        assert act.input(ms * MS, np.full(4, 9.0), helicopter).tolist() == [expected, 9.0, 9.0, 9.0]
    assert len(set(positions.values())) > 4


def test_a_weak_servo_reaches_a_share():
    np.testing.assert_allclose(acted(ServoWeak(axis="roll", strength=0.3), 6000), U * [1, 0.3, 1, 1], atol=1e-15)


def test_a_weak_motor_costs_half_its_share_of_thrust_and_turns():
    u = acted(MotorLoss(loss=0.4, torque=1.3), 5500)
    np.testing.assert_allclose(u, [0.1, -0.2, 0.8 * 0.545, 0.03 + 0.4 * 1.3 * 0.545], atol=1e-15)
    faults = Faults([MotorLoss(start=0.0, loss=0.4).hooks(rng())])
    for throttle, left in ((1.4, 0.8), (-0.2, 0.0)):
        assert faults.input(0, np.array([0.0, 0.0, throttle, 0.0]), plant())[2] == pytest.approx(left)


@pytest.mark.parametrize("spec", [Ideal(), MuJoCo()])
def test_without_the_gyro_nothing_damps_the_yaw(spec):
    helicopter = spec.start(np.array([0, 0, 50.0, 0, 0, 0, 0, 2.0]))
    trim, faults = helicopter.truth().actuators, Faults([GyroFailure(start=0.5, duration=0.5).hooks(rng())])
    rates = []
    for ms in range(0, 1500, 10):
        u = faults.input(ms * MS, trim, helicopter)
        helicopter.advance((ms + 10) * MS, u, STILL_AIR)
        rates.append(helicopter.truth().yaw_rate)
    # 5 1/s: the engine's implicit damping is exp(-5 t) within 5 * 0.001 / 2 a second.
    assert rates[49] == pytest.approx(2.0 * np.exp(-2.5), rel=0.02)
    assert rates[99] == pytest.approx(rates[49], rel=1e-9)
    assert rates[149] == pytest.approx(rates[99] * np.exp(-2.5), rel=0.02)


def test_a_gyro_works_only_if_no_fault_breaks_it():
    helicopter = plant()
    faults = Faults([Hooks(gyro=lambda t: True), Hooks(gyro=lambda t: False), Hooks(gyro=lambda t: True)])
    faults.input(0, U, helicopter)
    assert not helicopter.gyro_works


def test_a_rate_that_is_next_to_nothing_is_never():
    # The smallest rate of an experiment, and one in thirty years.
    for rate in (SMALLEST, 1e-9):
        assert Spells(PoseOutage(start=0.0, rate=rate), rng()).began(3600 * 1000 * MS) is None


def test_the_nearest_other_is_seen_if_it_is_near():
    hooks = IdentitySwap(start=1.0, duration=1.0, near=0.5).hooks(rng())
    truth = plant().truth()
    near, far = (truth._replace(position=truth.position + np.array([x, 0.0, 0.0])) for x in (0.4, 0.6))
    assert hooks.seen is not None
    assert hooks.seen(1_500 * MS, truth, [far, near]) is near
    assert hooks.seen(1_500 * MS, truth, [far]) is truth
    assert hooks.seen(1_500 * MS, truth, []) is truth
    assert hooks.seen(500 * MS, truth, [near]) is truth
