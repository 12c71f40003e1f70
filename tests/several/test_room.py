"""Several helicopters in one loop and one log."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import Literal

import numpy as np
import pytest

from controllers.coordinations import CommittedPlan, Message, Note, Ship
from controllers.flatness import state
from controllers.signals import Estimate
from controllers.trajectories import Trajectory
from controllers.trajectories.hover import Hover
from heli_twin.experiment import Experiment
from heli_twin.experiment.several import Several, components
from heli_twin.experiment.several_text import changed_several, load_several
from heli_twin.experiment.tree import ExperimentError, from_json
from heli_twin.flight import Flight
from heli_twin.lab.chance import generator
from heli_twin.lab.network import Network
from heli_twin.logbook import begin_log, flown_experiment
from heli_twin.metrics.tracking import metrics
from heli_twin.reanalysis.refly import refly
from heli_twin.reanalysis.resolve import resolve
from heli_twin.recording import LogError, read_log, recover
from heli_twin.recording.schema import FORMAT, MEASURED
from heli_twin.several.fly import SeveralResult, checked_fleet, fly_several
from heli_twin.several.room import chance_of

STEP_NS, TURN_NS, MS = 200_000_000, 100_000_000, 1_000_000


@dataclass(frozen=True)
class Relay:
    """Every 100 ms each commits to two more seconds of its wish, and tells the others; the tests need no more."""

    kind: Literal["relay"] = "relay"

    def planner_of(self, ship: str, ships: Sequence[Ship]) -> "RelayPlanner":
        return RelayPlanner(next(each for each in ships if each.name == ship))


class RelayPlanner:
    def __init__(self, ship: Ship) -> None:
        self.ship, self.due, self.note = ship, 0, Note("kept")
        self.committed: Trajectory = ship.wish
        self.heard: list[tuple[int, Message]] = []

    def receive(self, now: int, message: Message) -> None:
        self.heard.append((now, message))

    def act(self, now: int, estimate: Estimate | None, is_flying: bool) -> Sequence[Message]:
        self.due += TURN_NS
        t = 1e-9 * (now + STEP_NS * np.arange(11))
        knots = np.stack(self.ship.wish.flat(t), axis=1)
        knots[-1, 1:] = 0.0
        self.committed, self.note = CommittedPlan(now, STEP_NS, knots), Note("committed", "onwards", solve_ns=now % 7)
        return [Message(self.ship.name, now, self.committed, knots.nbytes)]


def flown(*overrides: str) -> SeveralResult:
    return fly_several(load_several("pair", ["base=lab", "coordination=none", *overrides]), log_dir=None)


@pytest.fixture(scope="module")
def apart() -> SeveralResult:
    """Two helicopters that hover far from each other."""
    return flown("duration=1", "scenario=own", "trajectory=hover", "ships.a.trajectory.y=1", "ships.b.trajectory.y=-1")


@pytest.fixture(scope="module")
def relayed(apart: SeveralResult) -> SeveralResult:
    """Two helicopters that plan anew in flight."""
    several = load_several(
        "pair", ["base=lab", "duration=1", "scenario=own", "trajectory=circle", "ships.a.trajectory.x=0.8"]
    )
    several = changed_several(several, ["ships.b.trajectory.x=-0.8"])
    return fly_several(replace(several, coordination=Relay()), log_dir=None)


@pytest.fixture(scope="module")
def met() -> SeveralResult:
    """Two helicopters that fly at each other and do not know of it."""
    return flown("duration=3", "scenario.radius=0.6")


def test_each_flies_bit_for_bit_as_it_would_alone(apart: SeveralResult):
    for name, e in apart.several.fleet().items():
        plant = e.plant.start(state(e.trajectory.flat(np.zeros(1)))[0])
        with begin_log(None, e) as recorder:
            outcome = Flight(e, plant, recorder, chance=chance_of(generator, name, ())).run()
            recorder.close(outcome.kind, outcome.time)
        alone, together = recorder.log(), apart.log.ship(name)
        for topic, messages in alone.messages.items():
            if topic not in (*MEASURED, "/view/reference_path", "/robot_description", "/tf"):
                assert messages == together.messages[topic], topic
        assert together.outcome == alone.outcome


def test_same_value_same_flight(met: SeveralResult):
    assert flown("duration=3", "scenario.radius=0.6").flight_digest == met.flight_digest
    assert flown("duration=3", "scenario.radius=0.6", "seed=1").flight_digest != met.flight_digest


def test_two_that_meet_collide(met: SeveralResult):
    assert met.outcome.kind == "collided"
    assert {outcome.kind for outcome in met.outcomes.values()} == {"collided"}
    summary = met.summary()
    # They touch at two radii of the rotor, 0.19 m; in 20 ms before they came nearer by 4 cm at most.
    assert 0.15 < summary["least_distance_in_plane"] < 0.19
    assert summary["nearest"]["time"] == pytest.approx(summary["duration"])
    assert summary["arrived"] == 0
    assert {event.name for event in met.log.ship("b").events} >= {"collided"}


def test_in_one_world_they_fly_bit_for_bit_as_apart_until_they_touch(apart: SeveralResult, met: SeveralResult):
    together = fly_several(replace(apart.several, world="shared"), log_dir=None)
    for name in "ab":
        alone = apart.log.ship(name).messages
        for topic, messages in together.log.ship(name).messages.items():
            assert topic in MEASURED or messages == alone[topic], topic
    words = ("duration=1.6", "scenario.radius=0.6", "world=shared")
    shared = flown(*words)
    assert flown(*words).flight_digest == shared.flight_digest
    last = met.outcome.time
    for name, other in (("a", "b"), ("b", "a")):
        log, of_world = shared.log.ship(name), met.log.ship(name)
        before = np.searchsorted(of_world.truth.time, last - 100_000_000)
        assert np.array_equal(log.truth.position[:before], of_world.truth.position[:before])
        (event,) = (event for event in log.events if event.name == "collided")
        # Apart, they are looked at every 20 ms; here the tail of one counts too.
        assert last - 100_000_000 < event.time <= last
        assert event.text == f"touched {other} at {1e-9 * event.time:.2f} s"
        assert log.outcome == "collided"
        assert log.ending.text == f"{event.text}, then flew the whole 1.6 s"
        # They met at 1 m/s, and push each other back.
        speed = log.truth.velocity[:, 0] * np.sign(log.truth.velocity[before, 0])
        assert speed[-1] < speed[before] - 0.3


def test_one_transmitter_sends_to_each_in_turn(apart: SeveralResult):
    """Commands begin to act 22 ms apart: those of one at even frames, those of the other at odd ones."""
    turns = fly_several(replace(apart.several, transmitters="one"), log_dir=None)
    acting = [turns.log.ship(name).acting for name in "ab"]
    starts = [row.time[row.stamp >= 0] for row in acting]
    for own in starts:
        assert set(np.diff(own) // MS % 44) == {0}
        assert 19 <= len(own) <= 23
    assert (starts[1][0] - starts[0][0]) // MS % 44 == 22
    alone = [apart.log.ship(name).acting.time for name in "ab"]
    assert (alone[1][1] - alone[0][1]) // MS % 22 != 0


def test_names_make_their_chance_and_shared_components_have_one(apart: SeveralResult):
    winds = [apart.log.ship(name).disturbance.wind for name in "ab"]
    assert np.abs(winds[0] - winds[1]).max() > 0.01
    together = fly_several(replace(apart.several, shared=("gust", "bias")), log_dir=None)
    winds = [together.log.ship(name).disturbance.wind for name in "ab"]
    assert np.array_equal(*winds)
    noise = [together.log.ship(name).pose.position[:, 2] for name in "ab"]
    assert not np.array_equal(*noise)


def test_the_log_of_one_is_a_log_like_any_other(met: SeveralResult):
    log = met.log.ship("a")
    assert flown_experiment(log) == met.several.fleet()["a"]
    assert from_json(log.experiment) == met.several.fleet()["a"]
    assert metrics(log)["outcome"] == "collided"
    assert met.log.metadata["physics"] == log.metadata["physics"]
    assert log.attachments["plant.xml"].data.startswith(b"<mujoco")
    assert [plan for _, plan in log.committed] == [None]
    assert [*log.others] == ["b"]


def test_the_whole_log_asks_for_one_of_them(met: SeveralResult):
    with pytest.raises(LogError, match=r"several helicopters, a, b: ask for one"):
        _ = met.log.truth
    with pytest.raises(ExperimentError, match=r"RUN.mcap#a"):
        flown_experiment(met.log)
    with pytest.raises(LogError, match=r"no helicopter 'q': .*a, b"):
        met.log.ship("q")
    with pytest.raises(LogError, match="of one helicopter alone"):
        met.log.ship("a").ship("a")


def test_one_helicopter_is_read_by_its_name_after_the_path(met: SeveralResult, tmp_path: Path):
    path = tmp_path / "run.mcap"
    path.write_bytes(met.data or b"")
    assert np.array_equal(read_log(f"{path}#b").truth.position, met.log.ship("b").truth.position)
    few = read_log(path, ("/truth",))
    assert {topic for topic, count in few.topics.items() if count} == {"/a/truth", "/b/truth"}


def test_only_logs_of_several_have_the_newest_format(met: SeveralResult, apart: SeveralResult):
    one = begin_log(None, apart.several.every)
    one.close("completed", 0)
    assert b"format\x01\x00\x00\x001" in (one.stream or BytesIO()).getvalue()
    assert f"format\x01\x00\x00\x00{FORMAT}".encode() in (met.data or b"")


def test_a_broken_log_of_several_is_recovered(met: SeveralResult, tmp_path: Path):
    part = tmp_path / "run.mcap.part"
    part.write_bytes((met.data or b"")[:-3000])
    log = read_log(recover(part))
    assert [*log.ships] == ["a", "b"]
    whole = met.log.ship("a").truth.time
    assert np.array_equal(log.ship("a").truth.time, whole[: len(log.ship("a").truth.time)])
    assert len(log.ship("a").truth.time) > 0.5 * len(whole)


def test_a_log_of_several_is_flown_again_bit_for_bit(met: SeveralResult):
    again = refly(met.log)
    assert again.verdict == "identical"
    other = refly(met.log, ["ships.b.plant.mass=0.029"])
    assert other.difference is not None
    assert other.difference.topic.startswith("/b/")
    assert other.position_deviation > 1e-5


def test_the_problems_of_each_are_solved_again_bit_for_bit(met: SeveralResult):
    for name in met.log.ships:
        assert not resolve(met.log.ship(name)).difference.any()


def test_plans_are_recorded_flown_and_solved_again(relayed: SeveralResult):
    for name in "ab":
        log = relayed.log.ship(name)
        first, *others = log.committed
        assert first == (0, None)
        assert [1e-9 * time for time, _ in others] == pytest.approx(np.arange(0.0, 1.0, 0.1).tolist())
        wish = relayed.several.fleet()[name].trajectory
        for time, plan in others:
            assert plan is not None
            t = 1e-9 * (time + STEP_NS * np.arange(10))
            assert np.array_equal(plan.knots[:10], np.stack(wish.flat(t), axis=1))
        assert not resolve(log).difference.any()
        # Without the plans the references are those of the wish.
        wished = replace(log, messages={topic: m for topic, m in log.messages.items() if topic != "/path"})
        assert resolve(wished).difference.any()


def test_turns_and_messages_are_recorded(relayed: SeveralResult):
    turns = relayed.log.ship("a").planning
    assert {turn.outcome for turn in turns} == {"committed"}
    assert {turn.reason for turn in turns} == {"onwards"}
    # Both act at the same times: what one tells is heard a turn later.
    assert [turn.received for turn in turns] == [0, *[1] * (len(turns) - 1)]
    summary = relayed.summary()
    assert summary["turns"] == 2 * len(turns)
    assert summary["messages"] == 2 * len(turns)
    took = summary["planning_ms"]
    assert 0.0 < took["p50"] <= took["p99"] <= took["max"]
    # A plan follows its wish, whose centre is 1.6 m from that of the other.
    assert summary["least_planned"] == pytest.approx(1.6, abs=0.01)


def test_lost_messages_change_no_flight_whose_planners_do_not_listen(relayed: SeveralResult):
    lossy = fly_several(replace(relayed.several, network=Network(loss=1.0)), log_dir=None)
    assert lossy.log.ship("a").messages["/truth"] == relayed.log.ship("a").messages["/truth"]
    assert not any(turn.received for turn in lossy.log.ship("a").planning)


def test_measured_times_are_no_part_of_the_digest(relayed: SeveralResult):
    again = fly_several(relayed.several, log_dir=None)
    assert again.flight_digest == relayed.flight_digest
    topic = "/a/planning_timing"
    assert again.log.messages[topic] != relayed.log.messages[topic]


def test_who_would_land_at_the_edge_of_the_room_is_told_before():
    several = load_several("swap8", ["scenario.radius=2.3"])
    with pytest.raises(ExperimentError, match=r"ships.a: supervisor.half_width = 2.2 m, .* 2.30 m .*half_width=2.8"):
        fly_several(several, log_dir=None)
    checked_fleet(changed_several(several, ["supervisor.half_width=2.8"]))


def test_one_of_them_is_not_flown_again_alone(met: SeveralResult):
    with pytest.raises(Exception, match="flew with others"):
        refly(met.log.ship("a"))


def test_helicopters_made_in_python_fly(apart: SeveralResult):
    ships = {name: Experiment(duration=0.2, trajectory=Hover(y=y)) for name, y in (("left", 1.0), ("right", -1.0))}
    told: list[float] = []
    result = fly_several(Several(ships=ships), log_dir=None, progress=told.append)
    # They meet every 20 ms.
    assert told == pytest.approx(np.arange(0.02, 0.23, 0.02).tolist())
    assert result.outcome.kind == "completed"
    assert result.log.ship("left").truth.position[0, 1] == pytest.approx(1.0, abs=0.01)


def test_all_components_draw_under_the_name_of_their_helicopter(apart: SeveralResult):
    """So that `shared` can name each of them."""
    e = load_several("pair", ["faults.pose_outage=on"]).fleet()["a"]
    asked: list[str] = []

    def chance(_: int, component: str) -> np.random.Generator:
        asked.append(component)
        return generator(0, component)

    plant = e.plant.start(state(e.trajectory.flat(np.zeros(1)))[0])
    with begin_log(None, e) as recorder:
        Flight(e, plant, recorder, chance=chance)
    assert sorted(asked) == sorted(components(e))


def test_cameras_that_confuse_two_report_each_under_the_name_of_the_other():
    words = [
        "scenario=own",
        "trajectory=hover",
        "ships.a.trajectory.y=0.3",
        "ships.b.trajectory.y=-0.3",
        "duration=0.8",
    ]
    swap = ["faults.identity_swap.start=0.4", "faults.identity_swap.duration=0.1"]
    confused = flown(*words, *swap)
    for name, side in (("a", 0.3), ("b", -0.3)):
        pose = confused.log.ship(name).pose
        seconds = 1e-9 * pose.stamp
        swapped = (seconds >= 0.4) & (seconds < 0.5)
        assert pose.position[~swapped, 1] == pytest.approx(side, abs=0.05)
        assert pose.position[swapped, 1] == pytest.approx(-side, abs=0.05)
        assert swapped.sum() > 5
    # The supervisors and estimators of the lab refuse such poses.
    assert confused.outcome.kind == "completed"
