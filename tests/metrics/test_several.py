"""How near several helicopters came, and who arrived."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from controllers.flatness import FlatOutput
from controllers.signals import Array
from controllers.trajectories.circle import Circle
from controllers.trajectories.hover import Hover
from controllers.trajectories.pirouette import Pirouette
from controllers.trajectories.waypoints import Waypoints
from heli_twin.experiment.several_text import load_several
from heli_twin.metrics.flat import flat
from heli_twin.metrics.several import (
    _stuck,
    apart_over_time,
    arrival,
    committed_path,
    flown_paths,
    least_over_time,
    nearest,
    pooled_metrics,
    promised_distance,
    several_metrics,
)
from heli_twin.metrics.tracking import metrics
from heli_twin.recording import Log
from heli_twin.recording.records import Messages, Turn
from heli_twin.several.fly import SeveralResult, fly_several, wishes_of


def line(start: tuple[float, float, float], end: tuple[float, float, float], *times: float) -> tuple[Array, Array]:
    """A straight flight from time 0 to 1 s, sampled at some times."""
    t = np.array(times)
    return t, np.array(start) + t[:, None] * (np.array(end) - np.array(start))


def test_the_least_distance_is_found_between_samples():
    a = line((-1, 0.1, 1), (1, 0.1, 1), 0.0, 0.3, 1.0)
    b = line((1, -0.1, 1.2), (-1, -0.1, 1.2), 0.0, 0.8, 1.0)
    found = nearest({"a": a, "b": b})
    assert found is not None
    # They pass at the half, 0.2 m beside and 0.2 m above each other.
    assert found.distance == pytest.approx(np.hypot(0.2, 0.2))
    assert found.time == pytest.approx(0.5)
    assert found.ships == ("a", "b")
    plane = nearest({"a": a, "b": b, "c": line((5, 5, 5), (6, 6, 6), 0.0, 1.0)}, axes=2)
    assert plane is not None
    assert plane.distance == pytest.approx(0.2)
    assert nearest({"a": a}) is None


def test_slow_ones_and_those_that_stop_are_nearest_where_they_are():
    # In a second 0.4 m nearer, then past each other; at the end 1 m apart and still approaching; side by side.
    slow = nearest({"a": line((-0.1, 0, 1), (0.3, 0, 1), 0.0, 1.0), "b": line((0, 0.2, 1), (0, 0.2, 1), 0.0, 1.0)})
    assert slow is not None
    assert (slow.distance, slow.time) == pytest.approx((0.2, 0.25))
    coming = nearest({"a": line((0, 0, 1), (1, 0, 1), 0.0, 1.0), "b": line((2, 0, 1), (2, 0, 1), 0.0, 1.0)})
    assert coming is not None
    assert (coming.distance, coming.time) == pytest.approx((1.0, 1.0))
    beside = nearest({"a": line((0, 0, 1), (1, 0, 1), 0.0, 1.0), "b": line((0, 2, 1), (1, 2, 1), 0.0, 1.0)})
    assert beside is not None
    assert (beside.distance, beside.time) == (2.0, 0.0)


def test_two_are_compared_whenever_both_were_recorded():
    a, b = line((0, 0, 1), (1, 0, 1), 0.0, 1.0, 2.0), line((0, 0, 1), (0, 1, 2), 0.5, 1.5, 3.0)
    time, apart = apart_over_time(a, b)
    assert time.tolist() == [0.5, 1.0, 1.5, 2.0]
    assert apart == pytest.approx(time[:, None] * [-1.0, 1.0, 1.0])
    back, other = apart_over_time(b, a)
    assert back.tolist() == time.tolist()
    assert other == pytest.approx(-apart)
    nothing = apart_over_time((np.zeros(0), np.zeros((0, 3))), b)
    assert [part.shape for part in nothing] == [(0,), (0, 3)]


def test_only_times_that_both_have_count():
    early, late = line((0, 0, 1), (1, 0, 1), 0.0, 0.4), line((0, 0, 1), (1, 0, 1), 0.6, 1.0)
    assert nearest({"a": early, "b": late}) is None
    # They meet in a single moment.
    found = nearest({"a": line((0, 0, 1), (1, 0, 1), 0.0, 0.4), "b": line((0, 0, 1), (0, 1, 1), 0.4, 1.0)})
    assert found is not None
    assert found.distance == pytest.approx(0.4 * np.sqrt(2.0))
    assert found.time == 0.4
    never = np.zeros(0), np.zeros((0, 3))
    assert nearest({"a": never, "b": late}) is nearest({"a": late, "b": never}) is None
    time, least = least_over_time(
        {"a": line((0, 0, 1), (0, 0, 1), 0.0, 1.0), "b": line((0, 3, 1), (0, 1, 1), 0.0, 0.5, 1.0)}
    )
    assert time.tolist() == [0.0, 0.5, 1.0]
    assert least == pytest.approx([3.0, 2.0, 1.0])


@pytest.fixture(scope="module")
def flown() -> SeveralResult:
    """One that goes 0.6 m in two seconds, and one that hovers, both without noise."""
    words = ["base=ideal", "coordination=none", "scenario=own", "duration=3", "ships.a.trajectory=waypoints"]
    points = "ships.a.trajectory.points=[[0,0,1,0],[0.6,0,1,0]]"
    words += [points, "ships.a.trajectory.times=[0,2]", "ships.b.trajectory=hover", "ships.b.trajectory.y=2"]
    words += ["ships.b.trajectory.height=2.5"]
    return fly_several(load_several("pair", words), log_dir=None)


def test_who_stays_at_its_goal_has_arrived(flown: SeveralResult):
    found = several_metrics(flown.log, wishes_of(flown.several))
    assert (found["arrived"], found["missing"], found["stuck"]) == (2, 0, 0.0)
    assert (found["outcome"], found["duration"], found["ships"]) == ("completed", pytest.approx(3.0), 2)
    wish = flown.several.fleet()["a"].trajectory
    moved = wish.flat(np.linspace(0.0, 2.0, 2001)).z[:, 0]
    # Within 15 cm of the end; the ideal helicopter follows its plan to some millimetres.
    assert found["time_to_goal"] == pytest.approx(2.0 * np.argmax(moved > 0.45) / 2000, abs=0.03)
    # They are nearest at the start, 2 m beside and 1.5 m above each other.
    assert found["least_distance"] == pytest.approx(2.5, abs=0.01)
    assert found["least_distance_in_plane"] == pytest.approx(2.0, abs=0.01)
    assert found["least_planned"] == pytest.approx(2.0, abs=1e-6)
    assert found["nearest"]["ships"] == found["nearest_planned"]["ships"] == ["a", "b"]
    assert found["nearest"]["time"] == found["nearest_planned"]["time"] == pytest.approx(0.0, abs=0.02)


class Told:
    """A log that tells some things otherwise."""

    def __init__(self, log: Any, **told: Any) -> None:
        self._log, self._told = log, told

    def __getattr__(self, name: str) -> Any:
        return self._told[name] if name in self._told else getattr(self._log, name)


def test_turns_of_planners_are_counted(flown: SeveralResult):
    outcomes = {"a": ("committed", "kept", "refused", "refused"), "b": ("refused", "committed")}
    turns = {name: [Turn(0, told, "", False, 3, 2, 1) for told in each] for name, each in outcomes.items()}
    took = {"a": np.array([1_000_000, 2_000_000]), "b": np.array([6_000_000])}
    ships = {name: Told(flown.log.ship(name), planning=turns[name], planning_ns=took[name]) for name in "ab"}
    found = several_metrics(cast(Log, Told(flown.log, ship=ships.__getitem__)), wishes_of(flown.several))
    assert (found["ships"], found["turns"], found["refused_plans"], found["messages"]) == (2, 6, 3, 12)
    assert (found["planning_ms"]["p50"], found["planning_ms"]["max"]) == pytest.approx((2.0, 6.0))


@pytest.mark.parametrize(
    ("told", "distance"),
    [("0.4", 0.4), ("9.99", 9.99), ("10", 0.3), ("0", 0.3), ("-1", 0.3), ('"a"', 0.3), ("null", 0.3)],
)
def test_the_distance_between_plans_is_that_of_the_coordination_or_the_usual_one(told: str, distance: float):
    text = f'{{"coordination": {{"distance": {told}}}}}'
    assert promised_distance(cast(Log, SimpleNamespace(experiment=text))) == distance
    assert promised_distance(cast(Log, SimpleNamespace(experiment="{}"))) == 0.3


def test_who_is_elsewhere_has_not_arrived_and_its_plan_was_stuck(flown: SeveralResult):
    log = flown.log.ship("a")
    further = Waypoints(points=((0.0, 0.0, 1.0, 0.0), (2.0, 0.0, 1.0, 0.0)), times=(0.0, 2.0))
    found = arrival(log, further)
    assert not found.arrived
    assert found.time is None
    # Its plan stands from 2 s to the end at 3 s, and nearly stands a little before.
    assert found.stuck == pytest.approx(1.1, abs=0.1)


def test_a_plan_is_stuck_while_it_stands_away_from_its_goal():
    """It stands below 2 cm/s, and is away beyond 15 cm; a wish stands at its beginning."""
    speed = np.array([0.0, 0.0, 0.5, 0.019, 0.021, 0.019, 0.0, 0.0])
    away = np.array([9.0, 9.0, 1.0, 1.0, 1.0, 0.149, 0.151, 0.151])
    nothing = np.zeros_like(speed)
    planned = SimpleNamespace(
        time=1_000_000_000 * np.array([0, 1, 3, 6, 10, 15, 21, 28]),
        velocity=np.column_stack([nothing, speed, nothing]),
        position=np.column_stack([2.0 + away, nothing, nothing]),
    )
    # From 6 to 10 s and from 21 to 28 s.
    assert _stuck(cast(Log, SimpleNamespace(reference=planned)), np.array([2.0, 0.0, 0.0])) == pytest.approx(11.0)


def test_plans_are_compared_fifty_times_a_second(flown: SeveralResult):
    time, position = committed_path(flown.log.ship("a"), flown.several.fleet()["a"].trajectory)
    np.testing.assert_allclose(time, 0.02 * np.arange(151))
    assert position[[0, -1], 0] == pytest.approx([0.0, 0.6])


def test_each_plan_counts_from_its_commitment_on(flown: SeveralResult):
    plans = [SimpleNamespace(time=500_000_000, plan=None), SimpleNamespace(time=2_000_000_000, plan=Hover(x=5.0))]
    log = cast(Log, Told(flown.log.ship("b"), committed=plans))
    time, position = committed_path(log, Hover(x=-1.0))
    np.testing.assert_allclose(time, 0.5 + 0.02 * np.arange(126))
    np.testing.assert_array_equal(position[:, 0], np.where(time < 1.999, -1.0, 5.0))


def test_who_was_never_seen_has_not_arrived(flown: SeveralResult):
    a = flown.log.ship("a")
    unseen = {topic: messages for topic, messages in a.messages.items() if topic not in ("/truth", "/mocap/pose")}
    assert arrival(replace(a, messages=unseen), Hover()) == (False, None, 0.0)


def test_who_begins_at_its_goal_has_arrived_when_it_begins(flown: SeveralResult):
    found = arrival(flown.log.ship("b"), Hover(y=2.0, height=2.5))
    assert (found.arrived, found.time) == (True, 0.0)


def test_who_turns_at_its_goal_has_a_goal(flown: SeveralResult):
    found = arrival(flown.log.ship("b"), Pirouette(y=2.0, height=2.5))
    assert (found.arrived, found.time) == (True, 0.0)


def test_the_row_of_a_room_has_the_largest_of_each_metric(flown: SeveralResult):
    fleet = flown.several.fleet()
    row, own = pooled_metrics(flown.log, fleet), {name: flat(metrics(flown.log.ship(name))) for name in fleet}
    # One moves and one does not: their errors differ.
    assert own["a"]["rmse.x"] > own["b"]["rmse.x"]
    for key in ("rmse.x", "rmse.y", "max_abs_error.z"):
        assert row[key] == max(own["a"][key], own["b"][key])
    assert row["arrived"] == 2


def test_who_has_ended_stays_where_it_was(flown: SeveralResult):
    a, b = (flown.log.ship(name) for name in "ab")
    early = replace(a, messages={**a.messages, "/truth": Messages(*(column[:50] for column in a.messages["/truth"]))})
    whole, _ = flown_paths({"a": a, "b": b})["a"]
    assert len(whole) == len(a.truth.time)
    assert whole[-1] == pytest.approx(3.0)
    ended = cast(Log, Told(early, ending=SimpleNamespace(time=1_000_000_000)))
    time, position = flown_paths({"a": ended, "b": b})["a"]
    assert (time.shape, position.shape) == ((51,), (51, 3))
    assert time[-1] == pytest.approx(3.0)
    np.testing.assert_array_equal(position[-1], position[-2])


def test_without_a_plan_nothing_is_stuck(flown: SeveralResult):
    a = flown.log.ship("a")
    planned = a.messages["/reference"]
    for count in (0, 1):
        short = replace(a, messages={**a.messages, "/reference": Messages(*(column[:count] for column in planned))})
        assert arrival(short, Hover(x=2.0)).stuck == 0.0


class Late:
    """A wish that is elsewhere until the very end of the flight, and goes on."""

    def flat(self, t: Array) -> FlatOutput:
        z = np.zeros((len(t), 4))
        z[:, :3] = np.where(t[:, None] > 2.999, [0.6, 0.0, 1.0], [5.0, 0.0, 1.0])
        return FlatOutput(z, np.ones_like(z), 0 * z)


def test_where_a_wish_that_goes_on_should_be_is_asked_at_the_end(flown: SeveralResult):
    assert arrival(flown.log.ship("a"), Late()).arrived


def test_a_wish_that_goes_on_is_flown_and_has_no_time_of_arrival(flown: SeveralResult):
    circle = Circle(radius=0.6, phase=-3.0, ramp=0.0)
    assert np.linalg.norm(circle.flat(np.array([3.0])).z[0, :3] - [0.6, 0.0, 1.0]) < 1e-6
    found = arrival(flown.log.ship("a"), circle)
    assert found.arrived
    assert (found.time, found.stuck) == (None, 0.0)
