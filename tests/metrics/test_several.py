"""Distances and arrivals of several helicopters with known values."""

import numpy as np
import pytest

from controllers.trajectories.circle import Circle
from controllers.trajectories.hover import Hover
from heli_twin import fly, load
from heli_twin.metrics.contact import touching
from heli_twin.metrics.several import ARRIVED_M, arrival, flown_paths, least_over_time, nearest


def straight(start, velocity, times):
    times = np.array(times, float)
    return times, np.array(start) + times[:, None] * np.array(velocity)


def test_two_that_pass_are_nearest_between_their_samples():
    north = straight((-1.0, 0.0, 1.0), (1.0, 0.0, 0.0), [0.0, 0.7, 1.5, 3.0])
    west = straight((0.0, -1.3, 1.2), (0.0, 1.0, 0.0), [0.0, 3.0])
    # In the plane (t - 1)^2 + (t - 1.3)^2, and 0.2 m of height beside it.
    plane, space = nearest({"a": north, "b": west}, axes=2), nearest({"a": north, "b": west})
    assert (plane.ships, space.ships) == (("a", "b"), ("a", "b"))
    assert plane[:2] == pytest.approx((0.3 / np.sqrt(2.0), 1.15))
    assert space[:2] == pytest.approx((np.hypot(0.2, 0.3 / np.sqrt(2.0)), 1.15))
    far = straight((9.0, 9.0, 1.0), (0.0, 0.0, 0.0), [0.0, 3.0])
    assert nearest({"far": far, "a": north, "b": west}, axes=2) == plane
    assert nearest({"a": north}) is None
    time, distance = least_over_time({"far": far, "a": north, "b": west})
    assert distance == pytest.approx(np.hypot(time - 1.0, time - 1.3))


def test_only_times_at_which_both_were_recorded_count():
    early = straight((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), [0.0, 1.0])
    late = straight((-4.0, 0.0, 1.0), (1.0, 0.0, 0.0), [0.0, 8.0])
    assert nearest({"a": early, "b": late})[:2] == pytest.approx((3.0, 1.0))
    assert nearest({"a": early, "b": straight((0, 0, 0), (1, 0, 0), [2.0, 3.0])}) is None


@pytest.mark.parametrize(("across", "above", "touch"), [(0.189, 0.122, True), (0.191, 0.0, False), (0.0, 0.124, False)])
def test_two_touch_as_upright_cylinders(across, above, touch):
    low = np.array([0.3, -0.2, 1.0])
    high = low + np.array([0.6 * across, -0.8 * across, above])
    assert touching(low, high) == touching(high, low) == touch


@pytest.fixture(scope="module")
def hovering():
    return fly(load("ideal", ["duration=2", "trajectory=hover"]), log_dir=None).log


def test_who_is_at_its_goal_has_arrived_from_the_beginning(hovering):
    assert arrival(hovering, Hover()) == (True, 0.0, 0.0)
    assert arrival(hovering, Hover(x=0.99 * ARRIVED_M)).arrived
    assert arrival(hovering, Hover(x=1.01 * ARRIVED_M)) == (False, None, 0.0)


def test_who_leaves_arrives_when_it_is_there_for_good_and_is_stuck_where_its_plan_stands_elsewhere():
    words = [
        "duration=4",
        "trajectory=waypoints",
        "trajectory.points=[[0,0,1,0],[0.8,0,1,0]]",
        "trajectory.times=[0,2]",
    ]
    experiment = load("ideal", words)
    there = fly(experiment, log_dir=None).log
    t, x = there.truth.time * 1e-9, there.truth.position[:, 0]
    came = arrival(there, experiment.trajectory)
    assert came.arrived
    assert came.time == pytest.approx(t[np.flatnonzero(x < 0.8 - ARRIVED_M)[-1] + 1])
    assert came.stuck == 0.0
    # Of another goal, the plan stands away from it in the second half.
    assert arrival(there, Hover(x=3.0)).stuck == pytest.approx(2.0, abs=0.2)


def test_a_wish_that_goes_on_is_flown_or_not():
    circle = load("ideal", ["duration=3", "trajectory=circle"])
    log = fly(circle, log_dir=None).log
    assert arrival(log, circle.trajectory) == (True, None, 0.0)
    assert arrival(log, Circle(radius=0.8)) == (False, None, 0.0)


def test_one_whose_flight_is_over_stays_where_it_was(hovering):
    short = fly(load("ideal", ["duration=1", "trajectory=hover"]), log_dir=None).log
    time, position = flown_paths({"a": hovering, "b": short})["b"]
    assert time[-1] == pytest.approx(2.0)
    assert position[-1].tolist() == position[-2].tolist()
