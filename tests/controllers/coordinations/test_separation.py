"""Distances between plans are those of their paths, never more; and how far plans can part is a bound."""

import numpy as np
import pytest

from controllers.coordinations import CommittedPlan
from controllers.separation import FINE, bend_of, distances, fine_path, knots_from, reach

H, STEP = 0.1, 100_000_000


def random_plan(rng: np.random.Generator, knots: int = 21) -> CommittedPlan:
    """Accelerations up to 1 m/s^2 on each axis, linear between knots."""
    a = rng.uniform(-1.0, 1.0, (knots, 4))
    v = np.concatenate([np.zeros((1, 4)), np.cumsum(0.5 * H * (a[1:] + a[:-1]), axis=0)])
    p = np.cumsum(np.concatenate([np.zeros((1, 4)), H * v[:-1] + H * H / 6.0 * (2.0 * a[:-1] + a[1:])]), axis=0)
    return CommittedPlan(0, STEP, np.stack([p, v, a], axis=1))


def test_the_fine_path_is_that_of_the_plan():
    plan = random_plan(np.random.default_rng(1))
    t = H / FINE * np.arange(FINE * 20 + 1)
    np.testing.assert_allclose(fine_path(plan.knots, H), plan.flat(t).z[:, :2], atol=1e-12)


def test_distances_are_lower_bounds_and_near_the_truth():
    rng = np.random.default_rng(2)
    for _ in range(20):
        one, two = random_plan(rng), random_plan(rng)
        shifted = two.knots + np.concatenate([rng.uniform(-0.5, 0.5, 4), np.zeros(8)]).reshape(3, 4)
        paths = fine_path(np.stack([one.knots, shifted]), H)
        bound = distances(paths[0], paths[1:], bend_of(1.0, H))[0].min()
        t = np.arange(0.0, 2.0, 0.001)
        there = two._replace(knots=shifted).flat(t).z - one.flat(t).z
        truth = np.hypot(*there.T[:2]).min()
        # The bend of the paths on both sides, and 1 mm of the samples.
        assert bound - 1e-9 <= truth <= bound + 2.0 * bend_of(1.0, H) + 1e-3


def test_a_path_leaves_a_chord_by_as_much_as_the_acceleration_bends_it():
    """By a t^2 / 8, of two that accelerate by 0.7 m/s^2 north and west, in opposite directions, within 25 ms."""
    assert bend_of(0.7, 0.1) == pytest.approx(np.hypot(1.4, 1.4) * 0.025**2 / 8.0)


def test_the_nearest_point_is_between_two_samples_or_at_one():
    own = np.zeros((3, 2))
    passes, stands, leaves = (
        [[-1.0, 0.3], [1.0, 0.3], [3.0, 0.3]],
        [[0.0, 0.4]] * 3,
        [[0.3, 0.4], [0.6, 0.8], [0.9, 1.2]],
    )
    bounds = distances(own, np.array([passes, stands, leaves]), 0.01)
    np.testing.assert_allclose(bounds, [[0.29, np.hypot(1.0, 0.3) - 0.01], [0.39, 0.39], [0.49, 0.99]], atol=1e-12)


def test_no_two_plans_that_part_are_further_apart_than_their_reach():
    """Opposite accelerations at the limit, then back to rest, get there."""
    t = 0.01 * np.arange(201)
    a = np.where(t < 1.0, 1.0, -1.0)
    one_axis = np.cumsum(np.cumsum(2.0 * a) * 0.01) * 0.01
    bound = reach(t, 2.0, 1.0)
    # Sums for integrals: 1 % of 2 m/s in 2 s.
    np.testing.assert_allclose(2.0**0.5 * one_axis, bound, atol=0.06)
    assert (reach(t - 5.0, 2.0, 1.0) == 0.0).all()
    assert reach(np.array([99.0]), 2.0, 1.0) == bound[-1]


def test_a_plan_is_at_rest_outside_its_knots():
    plan = random_plan(np.random.default_rng(3))
    plan.knots[-1, 1:] = 0.0
    late = knots_from(plan._replace(start=5 * STEP), 20, 10)
    np.testing.assert_array_equal(late, plan.knots[[15, 16, 17, 18, 19, 20, 20, 20, 20, 20]])
