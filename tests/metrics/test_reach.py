"""What a flight reaches, planned and flown."""

from types import SimpleNamespace

import numpy as np
import pytest

from heli_twin import fly, load
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
