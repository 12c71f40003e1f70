"""Who asks, who steps aside and where to, and on which side helicopters pass: known values in small scenes."""

from typing import Any

import numpy as np
import pytest

from controllers.committed_plan import CommittedPlan
from controllers.right_of_way import UNHEARD, Manners, RightOfWay, Told
from controllers.scene import Scene
from controllers.separation import FINE
from controllers.signals import Array
from controllers.wish_plan import JOINS

KNOTS = 6
MANNERS = Manners(period=0.1, patience=0.4, distance=0.45, aside=0.25, half_width=2.0, ahead=0.5)
GOAL = np.array([2.0, 0.0])


def at_rest(place: Any) -> Array:
    knots = np.zeros((KNOTS, 3, 4))
    knots[:, 0, :2] = place
    return knots


def scene(here: Any = (0.0, 0.0), speed: float = 0.0, reach: float = 0.0, **others: Any) -> Scene:
    """The own plan stands, or has this speed at its first knots, and ends this far to the north; others stand."""
    old = at_rest(here)
    old[1:4, 1, 0], old[-1, 0, 0] = speed, old[-1, 0, 0] + reach
    knots = np.array([at_rest(place)[:, 0, :2] for place in others.values()]).reshape(-1, KNOTS, 2)
    wide = np.full((len(others), FINE * (KNOTS - 1)), MANNERS.distance)
    none = np.zeros(len(others), bool)
    return Scene(1, 0.1, 0.0, old, list(others), knots, knots, wide, none, none, 0.0, [])


def told(since: int, asker: str, goal: Any = GOAL) -> Told:
    return Told(7, CommittedPlan(0, 100_000_000, at_rest((0.0, 0.0))), tuple(goal), since, asker, False)


def asking(turn: int = 10, name: str = "me") -> RightOfWay:
    """One that has stood until this turn."""
    way = RightOfWay(name, MANNERS)
    for k in range(5):
        way.stands(turn - 4 + k, scene(), GOAL, GOAL, "planned")
    return way


def test_who_stands_for_its_patience_asks_for_a_second():
    way = RightOfWay("me", MANNERS)
    stood = [way.stands(turn, scene(), GOAL, GOAL, "planned") for turn in range(6)]
    assert stood == [False, False, False, False, True, True]
    assert way.since == 4
    # A second after turn 5; nobody asks who is there, to 10 cm.
    assert way.asks(15, scene(), GOAL)
    assert not way.asks(16, scene(), GOAL)
    assert way.asks(15, scene((1.9, 0.0)), GOAL)
    assert not way.asks(15, scene((1.91, 0.0)), GOAL)


@pytest.mark.parametrize("moves", [{"speed": 0.03}, {"here": (0.03, 0.0)}], ids=["is about to move", "has moved"])
def test_who_moves_does_not_stand(moves: dict[str, Any]):
    way = RightOfWay("me", MANNERS)
    for turn in range(4):
        assert not way.stands(turn, scene(), GOAL, GOAL, "planned")
    assert not way.stands(4, scene(**moves), GOAL, GOAL, "planned")


def test_who_climbs_on_the_spot_stands():
    climbs = scene()
    climbs.old[1:4, 1, 2] = 0.5
    way = RightOfWay("me", MANNERS)
    assert [way.stands(turn, climbs, GOAL, GOAL, "planned") for turn in range(5)] == [*[False] * 4, True]


@pytest.mark.parametrize("reason", ["", JOINS, f"{UNHEARD} b"])
def test_who_flies_its_wish_or_waits_for_news_does_not_stand(reason: str):
    way = RightOfWay("me", MANNERS)
    assert not any(way.stands(turn, scene(), GOAL, GOAL, reason) for turn in range(30))


@pytest.mark.parametrize(("steps", "asks"), [(0.0095, True), (0.0105, False)])
def test_who_comes_less_than_20_cm_nearer_in_2_s_asks_too(steps: float, asks: bool):
    way = RightOfWay("me", MANNERS)
    stood = [way.stands(turn, scene((steps * turn, 0.0), 0.5), GOAL, GOAL, "planned") for turn in range(21)]
    assert stood == [*[False] * 20, asks]


def test_a_right_lasts_until_one_has_arrived():
    for changes, lasts in (
        ({}, True),
        ({"home": np.array([0.151, 0.0])}, True),
        ({"home": np.array([0.149, 0.0])}, False),
        ({"here": (-0.5, 0.3), "home": np.array([-0.5, 0.4])}, False),
        ({"reason": JOINS}, False),
        ({"reason": f"{UNHEARD} b"}, True),
    ):
        way = asking(10)
        words = {"goal": GOAL, "home": GOAL, "reason": "planned"} | changes
        here = words.get("here", (0.0, 0.0))
        way.stands(11, scene(here, speed=0.5), words["goal"], words["home"], words["reason"])
        assert way.since == (10 if lasts else -1), changes
    way = asking(10)
    for turn in range(11, 40):
        way.stands(turn, scene(), GOAL, GOAL, "planned")
    assert way.since == 10, "it has asked since then"


@pytest.mark.parametrize(
    ("here", "place"),
    [
        ((0.5, 0.1), (0.5, 0.55)),
        ((0.5, -0.1), (0.5, -0.55)),
        ((0.5, 0.005), (0.5, -0.55)),
        ((0.05, 0.6), (0.05, 0.6)),
        ((0.69, 0.0), (0.69, -0.55)),
        ((0.71, 0.0), None),
        ((-0.01, 0.1), None),
        ((0.1, 0.7), None),
    ],
)
def test_who_is_near_ahead_steps_aside_to_its_side_of_the_way(here: Any, place: Any):
    chosen = RightOfWay("me", MANNERS).aside(10, scene(here, b=(0.0, 0.0)), {"b": told(3, "b")})
    if place is None:
        assert chosen is None
    else:
        assert chosen is not None
        np.testing.assert_allclose(chosen.place, place, atol=1e-12)
        assert chosen.rank == (3, "b")
        assert chosen.until == 15


def test_a_way_across_the_room_has_its_sides_too():
    here = np.array([1.0, 1.0]) + 0.5 * np.array([0.6, 0.8]) + 0.1 * np.array([-0.8, 0.6])
    chosen = RightOfWay("me", MANNERS).aside(0, scene(here, b=(1.0, 1.0)), {"b": told(3, "b", (1.6, 1.8))})
    assert chosen is not None
    np.testing.assert_allclose(chosen.place, [1.0 + 0.3 - 0.44, 1.0 + 0.4 + 0.33], atol=1e-12)


def test_where_the_room_ends_it_steps_to_the_other_side_and_never_out_of_it():
    for half_width, place in ((0.56, (0.5, 0.55)), (0.5, (0.5, -0.5))):
        way = RightOfWay("me", MANNERS._replace(half_width=half_width))
        chosen = way.aside(0, scene((0.5, 0.1), b=(0.0, 0.0)), {"b": told(3, "b")})
        assert chosen is not None
        np.testing.assert_allclose(chosen.place, place, atol=1e-12)


def test_a_sidestep_keeps_its_side_and_ends_half_a_second_after_the_last_request():
    way, asks = RightOfWay("me", MANNERS), {"b": told(3, "b")}
    first = way.aside(10, scene((0.5, 0.1), b=(0.0, 0.0)), asks)
    second = way.aside(11, scene((0.5, -0.1), b=(0.0, 0.0)), asks)
    assert first is not None
    assert second is not None
    np.testing.assert_allclose(second.place, (0.5, 0.55), atol=1e-12)
    silent = {"b": told(-1, "b")}
    assert way.aside(16, scene((0.5, -0.1), b=(0.0, 0.0)), silent) is second
    assert way.aside(17, scene((0.5, -0.1), b=(0.0, 0.0)), silent) is None


@pytest.mark.parametrize(
    ("since", "asker", "yields"),
    [(9, "b", True), (11, "b", False), (10, "b", True), (10, "z", False), (3, "me", False), (-1, "b", False)],
)
def test_who_has_asked_first_goes_first_and_of_several_the_first_by_name(since: int, asker: str, yields: bool):
    chosen = asking(10).aside(11, scene((0.5, 0.1), b=(0.0, 0.0)), {"b": told(since, asker)})
    assert (chosen is not None) == yields


def test_who_has_arrived_or_asks_no_more_gives_way_to_all():
    arrived, silent = asking(10), asking(10)
    arrived.stands(11, scene(), GOAL, np.zeros(2), "planned")
    for way, turn in ((arrived, 12), (silent, 21)):
        assert way.aside(turn, scene((0.5, 0.1), b=(0.0, 0.0)), {"b": told(50, "b")}) is not None


def test_of_two_that_ask_it_makes_way_for_the_first():
    both = {"b": told(5, "b"), "c": told(4, "c", (-2.0, 0.0))}
    for names in (("b", "c"), ("c", "b")):
        places = {"b": (0.0, 0.0), "c": (1.0, 0.0)}
        here = scene((0.5, 0.1), **{name: places[name] for name in names})
        chosen = RightOfWay("me", MANNERS).aside(0, here, both)
        assert chosen is not None
        assert chosen.rank == (4, "c")
        np.testing.assert_allclose(chosen.place, (0.5, 0.55), atol=1e-12)


def test_it_heads_for_its_goal_where_its_plan_gets_on_and_turns_right_where_it_does_not():
    way = RightOfWay("me", MANNERS)
    for goal, reach, turns in ((2.0, 0.49, True), (2.0, 0.51, False), (0.4, 0.19, True), (0.4, 0.21, False)):
        heading = way.heading_for(0, scene(reach=reach), np.array([goal, 0.0]))
        right = min(goal, 1.0) * np.array([np.cos(0.7), -np.sin(0.7)])
        np.testing.assert_allclose(heading, right if turns else [goal, 0.0], atol=1e-12)
    north = way.heading_for(0, scene((1.0, 1.0)), np.array([1.0, 3.0]))
    np.testing.assert_allclose(north, [1.0 + np.sin(0.7), 1.0 + np.cos(0.7)], atol=1e-12)
    np.testing.assert_array_equal(asking(10).heading_for(11, scene(), GOAL), GOAL)


def tangent(centre: Any, side: float, length: float) -> Array:
    """A place beyond a circle of 0.5 m about one that stands, on the left (1) or the right (-1) of it."""
    angle = np.arctan2(centre[1], centre[0]) + side * np.arcsin(0.5 / np.hypot(*centre))
    return length * np.array([np.cos(angle), np.sin(angle)])


@pytest.mark.parametrize(
    ("centre", "side"),
    [
        ((1.0, 0.1), -1.0),
        ((1.0, -0.1), 1.0),
        ((1.0, -0.01), -1.0),
        ((1.0, 0.49), 0.0),
        ((1.0, 0.47), -1.0),
        ((-0.6, 0.0), 0.0),
        ((2.1, 0.46), 0.0),
        ((1.6, 0.0), 0.0),
        ((1.54, 0.0), -1.0),
    ],
)
def test_it_goes_round_one_that_stands_in_the_way_to_its_goal(centre: Any, side: float):
    heading = RightOfWay("me", MANNERS).heading_for(0, scene(reach=1.0, b=centre), GOAL)
    expected = tangent(centre, side, min(2.0, np.hypot(*centre) + 0.3)) if side else GOAL
    np.testing.assert_allclose(heading, expected, atol=1e-12)


def test_it_goes_round_the_first_and_on_the_side_that_it_chose():
    way = RightOfWay("me", MANNERS)
    first = scene(reach=1.0, far=(1.2, -0.2), near=(0.8, 0.1))
    np.testing.assert_allclose(way.heading_for(0, first, GOAL), tangent((0.8, 0.1), -1.0, np.hypot(0.8, 0.1) + 0.3))
    for sideways, side in ((-0.2, -1.0), (-0.3, 1.0)):
        later = way.heading_for(1, scene(reach=1.0, near=(0.8, sideways)), GOAL)
        np.testing.assert_allclose(later, tangent((0.8, sideways), side, np.hypot(0.8, sideways) + 0.3), atol=1e-12)
    inside = RightOfWay("me", MANNERS).heading_for(0, scene(reach=1.0, b=(0.3, 0.0)), GOAL)
    np.testing.assert_allclose(inside, [0.0, -0.6], atol=1e-12)


def test_who_asks_heads_straight_on_but_goes_round_one_that_has_landed():
    way, here = asking(10), scene(b=(1.0, 0.1))
    np.testing.assert_array_equal(way.heading_for(11, here, GOAL), GOAL)
    landed = here._replace(wide=here.wide + 0.2)
    assert way.heading_for(11, landed, GOAL)[1] < -0.5


def test_who_moves_is_no_obstacle_to_go_round():
    here = scene(reach=1.0, b=(1.0, 0.1))
    for move, goes_round in ((0.09, True), (0.11, False)):
        knots = here.knots.copy()
        knots[0, -1, 1] += move
        heading = RightOfWay("me", MANNERS).heading_for(0, here._replace(knots=knots), GOAL)
        assert np.array_equal(heading, GOAL) != goes_round


def test_its_length_on_the_network_is_that_of_its_knots_in_single_precision_and_thirteen_numbers():
    assert told(3, "b").size == 4 * (KNOTS * 12 + 13)
