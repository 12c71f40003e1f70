"""Plans of a wish: it is flown exactly, its clock then slows down to a stop, and there are ways to it and to rest."""

from typing import NamedTuple

import numpy as np
import pytest

from controllers.flatness import FlatOutput
from controllers.signals import Array
from controllers.wish_plan import FREE, JOINS, WishPlan

H, N = 0.1, 20
SPEED = np.array([0.8, -0.3, 0.1, 0.0])


class Straight(NamedTuple):
    """A wish at constant speed."""

    def flat(self, t: Array) -> FlatOutput:
        z = t[:, None] * SPEED
        return FlatOutput(z, np.tile(SPEED, (len(t), 1)), np.zeros_like(z))


PLAN = WishPlan(Straight(), H, N)


def wish_at(k: float) -> Array:
    return np.stack([k * H * SPEED, SPEED, np.zeros(4)])


def test_the_wish_is_flown_for_some_steps_and_its_clock_then_slows_down_smoothly_to_a_stop():
    knots = PLAN.wished(7, 21)
    for k in range(5):
        np.testing.assert_allclose(knots[k], wish_at(7 + k), atol=1e-12)
    # The clock runs on for half of the 16 steps of the stop; half-way it has half its speed.
    np.testing.assert_allclose(knots[20, 0], wish_at(7 + 4 + 8)[0], atol=1e-12)
    assert np.abs(knots[20, 1:]).max() < 1e-12
    half = wish_at(7 + 4 + (0.5 - 0.09375) * 16)
    np.testing.assert_allclose(knots[12], [half[0], 0.5 * SPEED, -1.5 / 1.6 * SPEED], atol=1e-12)
    np.testing.assert_allclose(PLAN.wished(7, 21, 10)[10], wish_at(17), atol=1e-12)


def test_a_plan_that_is_on_its_wish_goes_on_with_it():
    old = np.stack([wish_at(5 + k) for k in range(N + 1)])
    what, knots = PLAN.towards_the_wish(old, 5)
    assert what == FREE
    np.testing.assert_array_equal(knots, PLAN.wished(5, N + 1))


def test_who_is_off_its_wish_is_on_it_again_after_ten_steps_and_then_stops():
    old = np.zeros((N + 1, 3, 4))
    old[:, 0, 1] = 0.5
    what, knots = PLAN.towards_the_wish(old, 5)
    assert what == JOINS
    assert len(knots) == PLAN.longest + 1 == N + 5
    np.testing.assert_array_equal(knots[0], old[0])
    np.testing.assert_allclose(knots[10], wish_at(15), atol=1e-12)
    # Half of ten steps of a polynomial of degree five: half-way, and the end's speed by a share of -7/16.
    np.testing.assert_allclose(knots[5, 0], 0.5 * (old[0, 0] + wish_at(15)[0]) - 5 / 32 * SPEED, atol=1e-12)
    np.testing.assert_allclose(knots[-1, 0], wish_at(5 + 10 + 7)[0], atol=1e-12)


@pytest.mark.parametrize(("meets", "steps"), [(3, 4), (6, 6), (9, 9)])
def test_the_rest_of_a_way_to_the_wish_is_kept(meets: int, steps: int):
    old = np.stack([wish_at(5 + k) for k in range(N + 1)])
    old[:meets, 0, 1] += 0.2
    what, knots = PLAN.towards_the_wish(old, 5)
    assert what == JOINS
    np.testing.assert_array_equal(knots[:meets], old[:meets])
    count = min(steps + 16, N + 4) + 1
    np.testing.assert_allclose(knots[meets:], PLAN.wished(5, count, steps)[meets:], atol=1e-12)


@pytest.mark.parametrize(("speed", "length"), [(0.7, 1.0), (-0.7, 1.0), (0.1, 0.3)])
def test_a_stop_takes_as_long_as_its_acceleration_allows_and_no_less_than_03_s(speed: float, length: float):
    state = np.zeros((3, 4))
    # A turn of the heading makes it no longer.
    state[0], state[1, 1], state[1, 3] = [0.1, 0.2, 1.0, 0.3], speed, 2.0
    knots = PLAN.stop(state, 0.7)
    assert len(knots) == PLAN.longest + 2
    np.testing.assert_array_equal(knots[0], state)
    k = round(length / H)
    rest = state[0] + 0.5 * length * state[1]
    assert np.abs(knots[k - 1, 1:]).max() > 1e-3
    np.testing.assert_allclose(knots[k:, 0], np.tile(rest, (len(knots) - k, 1)), atol=1e-12)
    assert np.abs(knots[k:, 1:]).max() < 1e-9
    assert np.abs(knots[:, 2, :3]).max() <= 1.5 * 0.7 + 1e-9


def test_a_whole_plan_has_a_knot_before_it_and_rests_behind():
    knots = np.arange(21 * 12.0).reshape(21, 3, 4)
    whole = PLAN.whole(np.full((3, 4), -1.0), knots)
    assert whole.shape == (PLAN.longest + 2, 3, 4)
    assert (whole[0] == -1.0).all()
    np.testing.assert_array_equal(whole[1:22], knots)
    assert (whole[22:, 0] == knots[-1, 0]).all()
    assert not whole[22:, 1:].any()
