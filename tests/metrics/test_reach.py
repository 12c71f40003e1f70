"""What a flight reaches, planned and flown."""

from types import SimpleNamespace

import numpy as np
import pytest

from heli_twin import fly, load
from heli_twin.experiment.envelope import Envelope
from heli_twin.metrics.reach import flown_reach, planned_reach

SQUARE = "trajectory.points=[[0,0,1,0],[0,1,1.5,0],[0,0,1,0]]"


def test_a_plan_reaches_its_own_speeds_and_heights():
    plan = load("ideal", ["trajectory=waypoints", SQUARE, "duration=8"])
    flat = plan.trajectory.flat(np.arange(0.0, 8.0, 0.02))
    reach = planned_reach(plan)
    assert reach.speed == pytest.approx(np.abs(flat.dz[:, 1]).max())
    assert reach.climb == pytest.approx(np.abs(flat.dz[:, 2]).max())
    assert reach.climb < 0.9 * reach.speed
    assert reach.height == pytest.approx((1.0, 1.5), abs=1e-3)
    assert reach.duration == 8.0


def test_the_flight_of_the_believed_model_reaches_what_was_planned():
    plan = load("ideal", ["trajectory=waypoints", SQUARE, "duration=8"])
    planned, flown = planned_reach(plan), flown_reach(fly(plan, log_dir=None).log)
    assert flown.speed == pytest.approx(planned.speed, rel=0.05)
    assert flown.climb == pytest.approx(planned.climb, rel=0.05)
    assert flown.height == pytest.approx(planned.height, abs=0.02)
    assert flown.tilt == 0.0
    assert flown.duration == pytest.approx(8.0, abs=0.03)


class Rising:
    """A plan that rises from 0.1 m at 1 m/s, and moves sideways only at 0.02 s."""

    def flat(self, t: np.ndarray) -> SimpleNamespace:
        rows = np.column_stack([0 * t, 0 * t, 0.1 + t, 0 * t])
        return SimpleNamespace(
            z=rows, dz=np.where(np.abs(t - 0.02)[:, None] < 1e-9, [3.0, -4.0, -1.5, -2.0], [0, 0, 1, 0])
        )


def test_a_plan_counts_every_fiftieth_of_a_second_and_from_twenty_centimetres_on():
    reach = planned_reach(SimpleNamespace(trajectory=Rising(), duration=0.5))
    assert (reach.speed, reach.climb, reach.yaw_rate) == (5.0, 1.5, 2.0)
    assert reach.height == pytest.approx((0.2, 0.1 + 0.48))


def test_a_flight_reaches_its_greatest_speeds_in_the_air_and_all_but_a_thousandth_of_its_sticks():
    still, moving = np.zeros(1001), np.zeros(1001)
    moving[[0, 500, 501]] = 9.0, 1.0, 0.5
    height = np.linspace(0.201, 2.0, 1001)
    height[0] = 0.2
    sticks = np.column_stack([np.linspace(low, high, 1001) for low, high in ((-1, 1), (0, 0.5), (0.2, 0.8), (-0.1, 0))])
    truth = SimpleNamespace(
        time=20_000_000 * np.arange(1001),
        position=np.column_stack([still, still, height]),
        velocity=np.column_stack([3.0 * moving, -4.0 * moving, -2.0 * moving]),
        quat_wxyz=np.tile([1.0, 0.0, 0.0, 0.0], (1001, 1)),
        yaw_rate=-6.0 * moving,
    )
    reach = flown_reach(SimpleNamespace(truth=truth, sent=SimpleNamespace(time=truth.time, u=sticks)))
    # Its first row stands on the floor.
    assert (reach.speed, reach.climb, reach.yaw_rate, reach.tilt) == (5.0, 2.0, 6.0, 0.0)
    assert reach.height == pytest.approx((height[1], 2.0))
    assert reach.stick_low == pytest.approx((-0.998, 0.0005, 0.2006, -0.0999))
    assert reach.stick_high == pytest.approx((0.998, 0.4995, 0.7994, -0.0001))
    assert reach.duration == pytest.approx(20.0)
    unsent = SimpleNamespace(truth=truth, sent=SimpleNamespace(time=truth.time[:0], u=sticks[:0]))
    assert flown_reach(unsent) == Envelope()
    truth.position[:, 2] = 0.2
    assert flown_reach(SimpleNamespace(truth=truth, sent=SimpleNamespace(time=truth.time, u=sticks))) == Envelope()


@pytest.mark.parametrize("axis", [1, 2])
def test_the_greatest_tilt_in_the_air_counts_in_any_direction(axis):
    quat = np.tile([1.0, 0.0, 0.0, 0.0], (3, 1))
    for row, angle in ((0, 2.5), (1, 0.3)):
        quat[row, [0, axis]] = np.cos(angle / 2), np.sin(angle / 2)
    truth = SimpleNamespace(
        time=np.array([0, 1, 2]) * 10**9,
        position=np.array([[0.0, 0.0, 0.1], [0.0, 0.0, 1.0], [0.0, 0.0, 1.0]]),
        velocity=np.zeros((3, 3)),
        quat_wxyz=quat,
        yaw_rate=np.zeros(3),
    )
    log = SimpleNamespace(truth=truth, sent=SimpleNamespace(time=truth.time, u=np.zeros((3, 4))))
    # The first row, far tilted, lies on the floor.
    assert flown_reach(log).tilt == pytest.approx(0.3)
