"""Consensus by ADMM: pairs agree to pass each other, a formation on one shift; nothing is promised."""

import numpy as np
import pytest
from meeting import MODEL, meet, swap, to

from controllers.coordinations import Ship
from controllers.coordinations.admm import Admm, _moved_on, apart
from controllers.trajectories.hover import Hover
from controllers.trajectories.waypoints import Waypoints
from heli_twin.lab.network import Network

T = np.linspace(-1.0, 1.0, 21)


@pytest.mark.parametrize("network", [None, Network(loss=0.3)], ids=["", "lossy"])
def test_two_that_meet_head_on_pass_each_other_on_the_right(network):
    meeting = meet(swap(2), 4.5, Admm(), network)
    assert np.isfinite(meeting.arrival).all()
    # Of 0.45 m; rotors touch at 0.19 m.
    assert meeting.least > 0.35
    eastwards = meeting.flown[np.abs(meeting.flown[:, 0, 0]).argmin(), 0]
    assert eastwards[1] > 0.1, "who flies to -x has +y on its right"


def test_a_swap_of_four_needs_its_messages():
    # The middle of the room is behind them after 2.6 s.
    agreed, alone = (meet(swap(4), 2.6, Admm(rounds=2), Network(loss=loss)).least for loss in (0.0, 1.0))
    assert alone < 0.2
    assert agreed > 0.3


@pytest.mark.parametrize("sideways", [-0.4, -0.1, 0.0, 0.1, 0.4])
def test_paths_that_pass_are_pushed_apart_by_the_distance_and_no_further(sideways):
    one = np.stack([T, np.zeros(21)], axis=1)
    other = np.stack([-T, np.full(21, sideways)], axis=1)
    agreed = apart(one, other, 0.5, False)
    there = agreed[0] - agreed[1]
    # Knots are 0.2 m apart in relative position, and the nearest one is at the meeting.
    assert np.hypot(*there.T).min() == pytest.approx(0.5, abs=1e-9)
    np.testing.assert_allclose(agreed.mean(axis=0), 0.5 * (one + other), atol=1e-12)
    held = np.abs(agreed[0] - one).max(axis=1) > 0.0
    assert (np.hypot(*(one - other).T)[~held] >= 0.5 - 1e-9).all()
    mirrored = apart(other, one, 0.5, False)
    np.testing.assert_allclose(mirrored, agreed[::-1], atol=1e-12)


def test_from_one_that_lands_the_other_moves_all_the_way():
    one, fixed = np.stack([T, np.full(21, 0.1)], axis=1), np.zeros((21, 2))
    agreed = apart(one, fixed, 0.5, True)
    np.testing.assert_array_equal(agreed[1], fixed)
    assert np.hypot(*(agreed[0] - fixed).T).min() == pytest.approx(0.5, abs=1e-9)


def test_a_formation_leaves_its_wishes_by_one_shift():
    """One wants to fly faster than plans may and falls behind; the other, which could hover, goes with it."""
    fast = Waypoints(points=((-1.0, 0.0, 1.0, 0.0), (1.0, 0.0, 1.0, 0.0)), times=(0.0, 2.2)).fitted(MODEL)
    wishes = {"a": fast, "b": Hover(y=1.5)}
    t = 0.01 * np.arange(300)
    wished = np.stack([wish.flat(t).z[:, :2] for wish in wishes.values()], axis=1)
    split = {}
    for together in (0.0, 20.0):
        shift = meet(wishes, 3.0, Admm(together=together)).flown[:, :, :2] - wished
        assert np.abs(shift[:, 0]).max() > 0.1, "it falls behind"
        split[together] = np.linalg.norm(shift[:, 0] - shift[:, 1], axis=1).max()
    assert split[20.0] < 0.5 * split[0.0]


def test_who_is_alone_flies_its_wish():
    wish = to((-1.0, 0.0), (0.5, 0.0))
    meeting = meet({"a": wish, "b": Hover(x=9.0)}, 3.0, Admm(rounds=2))
    np.testing.assert_allclose(meeting.flown[:, 0], wish.flat(0.01 * np.arange(300)).z[:, :3], atol=1e-4)


def test_a_plan_that_comes_too_near_after_the_last_round_is_refused():
    """With one round the two have not agreed yet; each keeps its old plan, and says how near the new one came."""
    nearest = {}
    for least in (0.0, 0.4):
        meeting = meet(swap(2), 3.0, Admm(rounds=1, least=least))
        refused = [note.reason for _, _, note in meeting.notes if note.outcome == "refused"]
        assert all(0.0 < float(reason.removesuffix(" m from another")) <= least for reason in refused)
        assert bool(refused) == bool(least)
        nearest[least] = meeting.promised
    assert nearest[0.0] < 0.35
    assert nearest[0.4] > 0.4


def test_a_plan_that_moves_on_stands_at_its_end():
    plan = np.stack([np.arange(5.0), -np.arange(5.0)], axis=1)
    for steps, rows in ((0, [0, 1, 2, 3, 4]), (1, [1, 2, 3, 4, 4]), (3, [3, 4, 4, 4, 4]), (9, [4] * 5)):
        np.testing.assert_array_equal(_moved_on(plan, steps), plan[rows])


def test_a_message_is_as_long_as_its_numbers_in_single_precision():
    ships = [Ship(name, wish, MODEL) for name, wish in swap(2).items()]
    (message,) = Admm(steps=20).planner_of("s0", ships).act(0, None, True)
    # Twenty planned positions, as many shifts, and what tells them apart.
    assert message.size == 4 * (40 + 40) + 16


def test_before_the_first_message_others_are_taken_to_begin_their_wishes():
    wishes = swap(2)
    planner = Admm().planner_of("s0", [Ship(name, wish, MODEL) for name, wish in wishes.items()])
    expected = wishes["s1"].flat(0.1 * np.arange(1, 4)).z[:, :2]
    np.testing.assert_allclose(planner._others["s1"].x[:3], expected, atol=1e-9)
    np.testing.assert_allclose(planner._x[:3], wishes["s0"].flat(0.1 * np.arange(1, 4)).z[:, :2], atol=1e-9)


@pytest.mark.parametrize(("seconds", "is_slow"), [(16.0, True), (14.5, False)])
def test_a_wish_faster_than_plans_may_fly_by_half_is_planned(seconds, is_slow):
    """12 m in 14.5 s need 1.55 m/s in the middle, in 16 s 1.41 m/s; a stop needs less than 3 m/s^2."""
    wish = Waypoints(points=((0.0, 0.0, 1.0, 0.0), (12.0, 0.0, 1.0, 0.0)), times=(0.0, seconds))
    planner = Admm(acceleration=2.0).planner_of("a", [Ship("a", wish, MODEL)])
    first = round(5.0 * seconds)
    planner._shift(first, planner._own.wished(first - 1, 26))
    assert planner._may_wish == is_slow


def test_a_formation_that_is_where_it_wants_to_be_stays():
    wishes = {"a": Hover(x=1.5, y=-1.0), "b": Hover(x=1.5, y=1.0)}
    flown = meet(wishes, 1.5, Admm(together=20.0)).flown[:, :, :2]
    np.testing.assert_allclose(flown, np.tile([[1.5, -1.0], [1.5, 1.0]], (150, 1, 1)), atol=1e-3)


def test_two_that_hardly_move_are_pushed_apart_straight():
    one, other = np.tile([0.3, 0.0], (21, 1)), np.tile([0.0, 0.1], (21, 1))
    agreed = apart(one, other, 0.5, False)
    there = np.array([0.3, -0.1])
    straight = 0.5 * (0.5 - np.hypot(*there)) * there / np.hypot(*there)
    np.testing.assert_allclose(agreed, [one + straight, other - straight], atol=1e-12)
    np.testing.assert_array_equal(apart(one + 1.0, other, 0.5, False), [one + 1.0, other], "far apart they stay")
