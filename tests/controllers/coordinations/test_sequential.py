"""Planners that plan in turn: no two plans are ever nearer than promised, with messages lost too, and all arrive."""

import numpy as np
import pytest
from meeting import MODEL, estimated, meet, random_flights, swap, to

from controllers.coordinations import Message, Ship
from controllers.coordinations.sequential import Sequential
from controllers.emergency import STOPS
from controllers.trajectories.circle import Circle
from controllers.trajectories.hover import Hover
from controllers.trajectories.waypoints import Waypoints
from heli_twin.lab.network import Network

LOSSY = Network(loss=0.3)
DISTANCE = Sequential().distance


@pytest.mark.parametrize(
    ("wishes", "network", "seconds"),
    [
        (swap(2), None, 4.2),
        (swap(4), LOSSY, 5.0),
        (random_flights(4, seed=104), LOSSY, 3.2),
    ],
    ids=["swap of 2", "swap of 4, lossy", "4, lossy"],
)
def test_no_two_are_nearer_than_promised_and_all_arrive(wishes, network, seconds):
    meeting = meet(wishes, seconds, network=network)
    assert meeting.promised >= DISTANCE
    assert meeting.least >= DISTANCE
    assert np.isfinite(meeting.arrival).all()


def test_what_is_clear_is_flown_as_it_is_wished():
    wishes = {"a": Circle(radius=0.5, rate=1.0), "b": Hover(x=1.5, y=0.5)}
    meeting = meet(wishes, 4.0)
    t = 0.01 * np.arange(400)
    for i, wish in enumerate(wishes.values()):
        # Knots of the wish, 0.1 s apart: see test_committed_plan.
        np.testing.assert_allclose(meeting.flown[:, i], wish.flat(t).z[:, :3], atol=1e-6)


def test_who_had_to_go_round_is_back_on_its_wish():
    wishes = {"a": Circle(radius=0.8, rate=0.6), "b": to((0.0, -1.4), (0.2, 1.5))}
    meeting = meet(wishes, 7.0)
    assert meeting.least >= DISTANCE
    t = 0.01 * np.arange(700)
    wished = np.stack([wish.flat(t).z[:, :3] for wish in wishes.values()], axis=1)
    away = np.linalg.norm(meeting.flown - wished, axis=2)
    assert away.max() > 0.05, "nothing was in the way"
    assert away[-100:].max() < 1e-6


def test_without_messages_nobody_risks_a_meeting():
    """They fly what they know to be clear, and stay; far apart they need no messages."""
    meeting = meet(swap(2, radius=1.0), 4.5, network=Network(loss=1.0))
    assert meeting.promised >= DISTANCE
    assert not np.isfinite(meeting.arrival).any()
    assert np.abs(np.diff(meeting.flown[-100:], axis=0)).max() == 0.0
    far = meet({"a": to((-9.0, 0.0), (-8.0, 0.0)), "b": to((9.0, 0.0), (8.0, 0.0))}, 1.5, network=Network(loss=1.0))
    assert np.hypot(*(far.flown[-1, 0, :2] - [-9.0, 0.0])) > 0.1


def test_an_outage_costs_time_and_no_distance():
    outage = meet(swap(2), 5.5, network=Network(outage_start=1.0, outage=2.0))
    assert outage.promised >= DISTANCE
    assert np.isfinite(outage.arrival).all()
    assert outage.arrival.max() > meet(swap(2), 4.2).arrival.max()


def test_after_two_seconds_without_messages_four_that_meet_in_the_middle_are_soon_apart():
    """Each moves on through the middle in its turn, and none is sent back by one that has as far to go."""
    meeting = meet(swap(4), 7.0, network=Network(outage_start=1.0, outage=2.0))
    assert meeting.promised >= DISTANCE
    # 3 s of which are the outage and what follows it at once; 4.3 s without it.
    assert meeting.arrival.max() < 7.0


def test_who_is_parked_in_the_way_steps_aside_and_comes_back():
    """Between those that hover there is no room to pass, nor beside them: those ahead make it."""
    wishes = {
        "a": to((-1.2, 0.0), (1.2, 0.0)),
        "b": Hover(),
        "c": Hover(y=0.6),
        "d": Hover(y=-0.6),
    }
    meeting = meet(wishes, 6.0, Sequential(half_width=0.9))
    assert meeting.promised >= DISTANCE
    assert np.isfinite(meeting.arrival).all()
    assert any(note.reason == "steps aside" for _, _, note in meeting.notes)


STOPPED_NS = 1_500_000_000


def test_one_that_lands_stops_on_its_plan_and_others_keep_clear_of_it():
    """In the middle of a swap one stops and stays; it is given a wider berth than one that flies its plan."""
    spec = Sequential()
    meeting = meet(swap(4), 6.0, spec, flies=lambda name, t: name != "s0" or t < STOPPED_NS)
    rest = meeting.flown[-1, 0, :2]
    wide = spec.distance + spec.berth
    assert meeting.promised >= DISTANCE, "nobody has to get out of its way"
    assert np.abs(meeting.flown[400:, 0, :2] - rest).max() < 1e-6, "2.5 s later it stands"
    for i in (1, 2, 3):
        # To within the solver's tolerance.
        assert np.hypot(*(meeting.flown[450:, i, :2] - rest).T).min() >= wide - 1e-3


def test_the_berth_of_one_that_its_cameras_have_lost_grows_with_the_age_of_its_newest_picture():
    """It stops on its plan and flies on; others keep the drift of the strongest gust away, and it is seen again."""
    spec = Sequential()
    lost, seen = STOPPED_NS, STOPPED_NS + 2_500_000_000
    meeting = meet(swap(4), 7.0, spec, sees=lambda name, t: name != "s0" or not lost <= t < seen)
    assert meeting.promised >= DISTANCE
    t = 0.01 * np.arange(len(meeting.flown))
    blind = (t > 1e-9 * lost) & (t < 1e-9 * seen)
    drift = np.minimum(spec.berth, 0.5 * spec.drift * (t - 1e-9 * lost) ** 2)[blind]
    for i in (1, 2, 3):
        apart = np.hypot(*(meeting.flown[blind, i, :2] - meeting.flown[blind, 0, :2]).T)
        # Those that were near when it said so move away at 0.5 m/s^2.
        assert (apart >= DISTANCE + drift - 0.01).all()
    assert {note.reason for _, name, note in meeting.notes if name == "s0"} >= {STOPS}
    assert np.isfinite(meeting.arrival).all()


def test_old_news_replace_no_newer():
    ships = [Ship(name, wish, MODEL) for name, wish in swap(2).items()]
    one, other = (Sequential().planner_of(ship.name, ships) for ship in ships)
    first, second = one.act(0, None, True)[0], one.act(100_000_000, None, True)[0]
    for message in (second, first):
        other.receive(200_000_000, message)
    assert other._heard["s0"].turn == 1
    assert isinstance(first, Message)


def test_news_are_passed_on():
    """s2 never hears s0, and hears of it from s1."""
    ships = [Ship(name, wish, MODEL) for name, wish in swap(4).items()]
    heard = {}
    for gossip in ("on", "off"):
        s0, s1, s2 = (Sequential(gossip=gossip).planner_of(name, ships) for name in ("s0", "s1", "s2"))
        s1.receive(0, s0.act(0, None, True)[0])
        s2.receive(0, s1.act(s1.due, None, True)[0])
        heard[gossip] = s2._heard["s0"].turn
    assert heard == {"on": 0, "off": -1}


def test_slow_messages_slow_the_turns():
    """With 0.1 s for each, 2 ships have a turn every 0.2 s, and messages that need 80 ms are in time."""
    spec, network = Sequential(hearing=0.1), Network(delay=0.08, jitter=0.0)
    meeting = meet(swap(2), 7.0, spec, network)
    assert sum(name == "s0" for _, name, _ in meeting.notes) == 35
    assert meeting.promised >= DISTANCE
    assert np.isfinite(meeting.arrival).all()


def test_a_start_that_is_too_near_is_refused():
    ships = [Ship(name, Hover(x=x), MODEL) for name, x in (("a", 0.0), ("b", 0.3))]
    with pytest.raises(ValueError, match=r"a and b start 0.30 m apart.*distance = 0.4 m"):
        Sequential().planner_of("a", ships)


def test_what_is_wished_faster_than_plans_may_fly_by_half_is_planned():
    """Alone in the room: a circle at 1.1 m/s that needs 1.9 m/s^2, where plans have 1 and a wish 1.5."""
    ships = [Ship("a", Circle(radius=0.66, rate=1.7, ramp=2.0), MODEL)]
    planner = Sequential().planner_of("a", ships)
    reasons: set[str] = set()
    while planner.due < 4_000_000_000:
        planner.act(planner.due, estimated(planner.committed, planner.due, planner.due), True)
        reasons.add(planner.note.reason)
        assert np.abs(planner.committed.knots[:, 2, :2]).max() <= 1.5 * Sequential().acceleration + 1e-9
    assert "planned" in reasons


def test_a_climb_is_flown_as_it_is_wished():
    """At almost 2 m/s: the limits of plans are in the plane."""
    rows = ((0.0, 0.0, 0.5, 0.0), (0.0, 0.0, 2.5, 0.0))
    planner = Sequential().planner_of("a", [Ship("a", Waypoints(points=rows, times=(0.0, 1.9)).fitted(MODEL), MODEL)])
    while planner.due < 2_500_000_000:
        planner.act(planner.due, estimated(planner.committed, planner.due, planner.due), True)
        assert planner.note.reason == ""


def test_the_goal_that_is_told_is_where_the_wish_is_at_the_end_of_the_plan():
    wish = to((-3.0, 0.5), (3.0, 0.5))
    planner = Sequential().planner_of("a", [Ship("a", wish, MODEL)])
    for _ in range(15):
        told = planner.act(planner.due, estimated(planner.committed, planner.due, planner.due), True)[0].body["a"]
    # A plan of turn 14 begins at the knot 15, and is 20 steps long.
    np.testing.assert_allclose(told.goal, wish.flat(np.array([3.5])).z[0, :2], atol=1e-12)
