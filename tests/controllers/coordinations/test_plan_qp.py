"""A plan of ProxQP starts where it is told, keeps limits and half-spaces, ends at rest, and gets near its target."""

import numpy as np
import pytest
from meeting import MODEL

from controllers.coordinations import Ship
from controllers.coordinations.admm import Admm
from controllers.coordinations.sequential import Sequential
from controllers.plan_qp import Effort, HalfSpaces, PlanQp
from controllers.signals import Array
from controllers.trajectories.hover import Hover

N, H = 20, 0.1
EDGE = 1e-4
"""Ten tolerances of the solver."""


def plan(target: Array, behind: HalfSpaces | None = None, speed: float = 0.0) -> Array | None:
    old = np.zeros((N + 1, 3, 2))
    old[0, 1, 0] = speed
    return PlanQp(N, H, 2, Effort(0.8, 1.0))(old, np.tile(target, (N, 1)), behind)


def test_it_goes_to_its_target_within_the_limits_and_stops():
    knots = plan(np.array([0.5, -0.1]))
    assert knots is not None
    assert np.abs(knots[:, 1]).max() < 0.8 + EDGE
    assert np.abs(knots[:, 2]).max() < 1.0 + EDGE
    assert not knots[-1, 1:].any()
    np.testing.assert_allclose(knots[-1, 0], [0.5, -0.1], atol=0.04)


def test_a_far_target_is_approached_at_the_speed_limit():
    knots = plan(np.array([9.0, 0.0]))
    assert knots is not None
    assert 0.75 < knots[:, 1, 0].max() < 0.8 + EDGE


def test_the_knots_are_one_motion():
    """Velocity and position are the integrals of an acceleration that is linear between knots."""
    knots = plan(np.array([0.4, 0.3]), speed=0.5)
    assert knots is not None
    p, v, a = np.moveaxis(knots, 1, 0)
    np.testing.assert_allclose(v[1:], v[:-1] + 0.5 * H * (a[1:] + a[:-1]), atol=EDGE)
    np.testing.assert_allclose(p[1:], p[:-1] + H * v[:-1] + H * H / 6 * (2 * a[:-1] + a[1:]), atol=1e-12)
    assert v[0].tolist() == [0.5, 0.0]


def test_it_stays_behind_half_spaces():
    """A wall 0.3 m ahead that ends after half the plan, and one at an angle from then on."""
    k = np.arange(1, N + 1)
    normals = np.where((k <= 10)[:, None], [-1.0, 0.0], [-0.6, 0.8])
    offsets = np.where(k <= 10, -0.3, -0.35)
    knots = plan(np.array([1.0, 0.0]), HalfSpaces(k, normals, offsets))
    assert knots is not None
    side = (normals * knots[1:, 0]).sum(axis=1) - offsets
    assert side.min() > -EDGE
    assert side.min() < 0.01, "it is as near to its target as the walls allow"


def test_walls_that_cannot_be_kept_have_no_plan():
    k = np.arange(1, N + 1)
    assert plan(np.array([1.0, 0.0]), HalfSpaces(k, np.tile([-1.0, 0.0], (N, 1)), np.full(N, 0.2)), speed=0.8) is None


@pytest.mark.parametrize("spec", [Sequential(), Admm()], ids=lambda spec: spec.kind)
def test_plans_climb_at_half_a_metre_a_second_and_turn_at_two_radians_a_second(spec):
    """And change that by 1 m/s^2 and 6 rad/s^2: the target is far, so that all limits are reached."""
    planner = spec.planner_of("a", [Ship("a", Hover(), MODEL)])
    for qp, speed, acceleration in ((planner._height, 0.5, 1.0), (planner._heading, 2.0, 6.0)):
        knots = qp(np.zeros((spec.steps + 1, 3, 1)), np.full((spec.steps, 1), 9.0))
        assert np.abs(knots[:, 1]).max() == pytest.approx(speed, rel=1e-3)
        assert np.abs(knots[:, 2]).max() == pytest.approx(acceleration, rel=1e-3)
        assert not knots[-1, 1:].any(), "it ends at rest"


def test_the_distance_is_weighted_at_every_knot_from_the_next_one_on():
    """Of two steps of 1 s: an acceleration of 1 m/s^2 at the middle knot moves this by 1/6 m, and the last by 1 m."""
    np.testing.assert_allclose(PlanQp(2, 1.0, 1, Effort(1.0, 1.0, 0.0, 0.0))._H, [[2.0 * (1.0 / 36.0 + 1.0)]])


def test_the_weight_of_the_jerk_is_that_of_its_textbook_square():
    """The acceleration runs straight from knot to knot: of one that rises by 1 m/s^2 and falls in 0.1 s each, 200."""
    weights = {w_j: PlanQp(4, H, 1, Effort(1.0, 1.0, 0.0, w_j)) for w_j in (0.0, 1.0)}
    one = np.array([0.0, 1.0, 0.0])
    jerks = one @ (weights[1.0]._H - weights[0.0]._H) @ one / 2.0
    assert jerks == pytest.approx(200.0)
