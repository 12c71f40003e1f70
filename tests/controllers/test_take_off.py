"""Before take-off all know plans that are clear of each other: wishes, and of those that meet, to stay. Turns."""

import numpy as np
from meeting import to

from controllers.separation import bend_of
from controllers.take_off import before_take_off
from controllers.trajectories.hover import Hover
from controllers.turns import Turns
from controllers.wish_plan import WishPlan

H, STEP = 0.1, 100_000_000


def test_those_whose_wishes_meet_stay_and_others_fly():
    fast = {
        "a": to((-0.6, 0.0), (0.6, 0.0), 1.0),
        "b": to((0.6, 0.0), (-0.6, 0.0), 1.0),
        "c": to((0.0, 2.0), (1.0, 2.0)),
    }
    wishes = {name: WishPlan(wish, H, 20) for name, wish in (fast | {"d": Hover(y=-2.0)}).items()}
    plans = before_take_off(wishes, STEP, 0.45, bend_of(1.0, H))
    for name, own in wishes.items():
        wished = own.wished(0, own.longest + 2)
        expected = np.repeat(wished[:1], len(wished), axis=0) if name in "ab" else wished
        np.testing.assert_array_equal(plans[name].knots, expected)
        assert (plans[name].start, plans[name].step) == (0, STEP)


def test_one_that_meets_another_that_stays_stays_too():
    """B stays for a, and c, whose way is clear of the wish of b, for b."""
    wishes = {
        "a": to((-0.6, 0.0), (0.6, 0.0), 1.0),
        "b": to((0.6, 0.0), (-0.6, 0.0), 1.0),
        "c": to((0.6, 0.9), (0.6, -0.9), 1.0),
    }
    plans = before_take_off({name: WishPlan(wish, H, 20) for name, wish in wishes.items()}, STEP, 0.45, 0.001)
    assert all(not plan.knots[:, 1].any() for plan in plans.values())


def test_turns_are_spread_over_a_round_and_plans_can_be_new_from_the_next_knot_on():
    turns = Turns(100, 50, 4)
    assert [turns.time(index, 3) for index in range(4)] == [300, 325, 350, 375]
    assert [turns.departs(index, 3) for index in range(4)] == [7, 7, 8, 8]
