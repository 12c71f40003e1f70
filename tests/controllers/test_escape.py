"""Who cannot go on, and who is in its way: plans to rest round others, and away from one that has left its plan."""

import numpy as np
import pytest
from meeting import MODEL, estimated, meet, swap, to

from controllers.coordinations import Note, Planner, Ship
from controllers.coordinations.sequential import Sequential
from controllers.emergency import STOPS
from controllers.signals import Array
from controllers.trajectories.hover import Hover

SPEC = Sequential()
BLOWN_AWAY = np.array([0.35, 0.2, 1.0, 0.0, 0.4, 0.2, 0.0, 0.0])
"""State of one that is no longer on its plan: position, yaw, velocity."""


def test_who_can_stop_straight_ahead_does_so_at_its_share_of_the_acceleration_of_plans():
    """In the mean; a quintic needs 1.5 times as much where it is hardest."""
    ships = [Ship(name, wish, MODEL) for name, wish in {"a": to((-3.0, 0.0), (3.0, 0.0)), "b": Hover(y=9.0)}.items()]
    planner = SPEC.planner_of("a", ships)
    other = SPEC.planner_of("b", ships)
    while planner.due < 2_000_000_000:
        now = planner.due
        for message in planner.act(now, estimated(planner.committed, now, now), True):
            other.receive(now, message)
        for message in other.act(other.due, estimated(other.committed, other.due, other.due), True):
            planner.receive(now, message)
    state = planner.committed.flat(np.array([2.0]))
    told = planner.act(2_000_000_000, estimated(planner.committed, 2_000_000_000, 1_800_000_000), True)
    assert planner.note == Note("committed", STOPS, False, 0)
    assert told[0].body["a"].since == -1, "who stops asks nobody to step aside"
    # A turn commits from the next knot on.
    v = planner.committed.flat(np.array([2.1])).dz[0, 0]
    rest = planner.committed.flat(np.array([9.0])).z[0, 0]
    x = planner.committed.flat(np.array([2.1])).z[0, 0]
    assert x - state.z[0, 0] == pytest.approx(0.1 * v, abs=0.01)
    assert rest - x == pytest.approx(0.5 * v * v / (SPEC.stop * SPEC.acceleration), abs=1e-9)


def test_who_cannot_stop_straight_ahead_stops_round_the_other():
    """The cameras lose one while it bends round the other: straight ahead they would come too near."""
    lost = 1_300_000_000
    meeting = meet(swap(2), 4.0, SPEC, sees=lambda name, t: name != "s0" or t < lost)
    (stop,) = (note for _, name, note in meeting.notes if name == "s0" and note.reason == STOPS and note.iterations)
    assert stop.outcome == "committed"
    assert meeting.promised >= SPEC.distance
    way = meeting.flown[140:, 0, :2]
    assert np.hypot(*(way - way[-1])[210:].T).max() < 1e-6, "it stands after the 2 s of a plan"
    assert np.hypot(*(way[-1] - way[0])) < 0.8, "its goal is 1.9 m away"


class Three:
    """`a` flies past `b`, which hovers, and `c`, which hovers some way behind it."""

    def __init__(self, behind: float = 0.5) -> None:
        wishes = {"a": to((-1.2, 0.0), (1.2, 0.0)), "b": Hover(x=0.5, y=0.62), "c": Hover(x=0.5, y=0.62 + behind)}
        ships = [Ship(name, wish, MODEL) for name, wish in wishes.items()]
        self.planners: dict[str, Planner] = {name: SPEC.planner_of(name, ships) for name in wishes}

    def turn(self, state: Array | None = None) -> Note:
        """Let the next one plan; one with a state (8,) lands there, however far from its plan."""
        name, planner = min(self.planners.items(), key=lambda item: item[1].due)
        now = planner.due
        estimate = estimated(planner.committed, now, now)
        if state is not None:
            estimate = estimate._replace(x=state)
        for message in planner.act(now, estimate, state is None):
            for other in self.planners:
                if other != name:
                    self.planners[other].receive(now, message)
        return planner.note

    def apart(self, one: str, other: str, start: float) -> float:
        """Return the least distance of two committed plans from a time on, m."""
        t = start + 0.01 * np.arange(300)
        a, b = (self.planners[name].committed.flat(t).z[:, :2] for name in (one, other))
        return float(np.hypot(*(a - b).T).min())


@pytest.mark.parametrize("behind", [0.5, 0.9])
def test_who_is_in_danger_moves_away_and_keeps_its_distance_from_all_others(behind):
    """`a` is blown off its plan and lands in front of `b`, which cannot fly straight back as far: there is `c`."""
    three = Three(behind)
    for _ in range(45):
        three.turn()
    assert three.turn(BLOWN_AWAY).outcome == "committed"
    before = three.apart("a", "b", 1.6)
    assert before < SPEC.distance
    note = three.turn()
    assert (note.outcome, note.reason) == ("committed", "in danger")
    assert note.iterations > 0
    after = three.apart("a", "b", 1.6)
    assert after > before + 0.01
    assert three.apart("b", "c", 1.6) >= SPEC.distance
    for _ in range(30):
        three.turn()
    assert three.apart("a", "b", 2.6) >= SPEC.distance


def test_who_is_in_danger_and_has_room_flies_half_a_metre_away():
    three = Three(behind=3.0)
    for _ in range(45):
        three.turn()
    three.turn(BLOWN_AWAY)
    away = np.array([0.5, 0.62]) - three.planners["a"].committed.flat(np.array([1.6])).z[0, :2]
    assert three.turn().reason == "in danger"
    rest = three.planners["b"].committed.flat(np.array([9.0])).z[0, :2]
    np.testing.assert_allclose(rest, [0.5, 0.62] + 0.5 * away / np.hypot(*away), atol=0.01)
