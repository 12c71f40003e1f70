"""Planners that meet without helicopters: each flies its plan exactly, and messages go over the network."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from controllers.coordinations import Coordination, Planner, Ship
from controllers.coordinations.sequential import Sequential
from controllers.model import Model
from controllers.signals import Array, Estimate
from controllers.trajectories import Trajectory
from controllers.trajectories.waypoints import Waypoints
from heli_twin.lab.chance import generator
from heli_twin.lab.network import Network

MODEL = Model()
FINE_NS = 10_000_000
"""Sampling of what was flown."""


@dataclass(slots=True)
class Meeting:
    """What happened."""

    names: list[str]
    flown: Array
    """(t, ships, 3) positions that were flown, every 10 ms, x y z, m."""
    goals: Array
    """(ships, 2) where the wishes end, m."""
    promised: float
    """Least distance of any two committed plans at any turn, over all their future, between samples too, m."""
    notes: list[tuple[int, str, object]] = field(default_factory=list)
    bytes_sent: int = 0

    @property
    def least(self) -> float:
        """Least distance of any two while they flew, in the plane, m."""
        return min(
            float(np.hypot(*(self.flown[:, i, :2] - self.flown[:, j, :2]).T).min())
            for i, j in combinations(range(len(self.names)), 2)
        )

    @property
    def arrival(self) -> Array:
        """(ships,) when each came within 5 cm of its goal to stay, s; infinite if it never did."""
        away = np.hypot(*np.moveaxis(self.flown[:, :, :2] - self.goals, 2, 0)) > 0.05
        last = np.array([np.flatnonzero(each)[-1] + 1 if each.any() else 0 for each in away.T])
        return np.where(last < len(away), last * 1e-9 * FINE_NS, np.inf)


def meet(
    wishes: Mapping[str, Trajectory],
    seconds: float,
    spec: Coordination | None = None,
    network: Network | None = None,
    flies: Callable[[str, int], bool] = lambda name, t: True,
    sees: Callable[[str, int], bool] = lambda name, t: True,
) -> Meeting:
    """Let planners meet.

    Args:
        wishes: Of each ship, fitted.
        seconds: How long.
        spec: The coordination.
        network: What carries the messages.
        flies: Whether a ship flies its plan at a time, ns.
        sees: Whether the cameras see a ship at a time, ns.
    """
    spec = spec or Sequential()
    ships = [Ship(name, wish, MODEL) for name, wish in wishes.items()]
    planners = {ship.name: spec.planner_of(ship.name, ships) for ship in ships}
    link = (network or Network()).start([*wishes], generator(1, "network"))
    goals = np.stack([ship.wish.flat(np.array([1e3])).z[0, :2] for ship in ships])
    meeting = Meeting([*wishes], np.zeros((round(seconds * 1e9) // FINE_NS, len(ships), 3)), goals, np.inf)
    done, pictures = 0, dict.fromkeys(wishes, 0)
    while True:
        name = min(planners, key=lambda each: planners[each].due)
        planner, now = planners[name], planners[name].due
        upto = min(-(-now // FINE_NS), len(meeting.flown))
        t = 1e-9 * FINE_NS * np.arange(done, upto)
        for i, each in enumerate(planners.values()):
            meeting.flown[done:upto, i] = each.committed.flat(t).z[:, :3]
        done = upto
        if done == len(meeting.flown):
            return meeting
        for delivery in link.arrived(now):
            planners[delivery.receiver].receive(delivery.at, delivery.message)
        before = planner.committed
        pictures[name] = now if sees(name, now) else pictures[name]
        for message in planner.act(now, estimated(planner.committed, now, pictures[name]), flies(name, now)):
            meeting.bytes_sent += message.size
            link.send(now, message)
        meeting.notes.append((now, name, planner.note))
        if planner.committed is not before:
            meeting.promised = min(
                meeting.promised, _nearest(planner, [p for p in planners.values() if p is not planner], now)
            )


def estimated(plan: Trajectory, now: int, picture: int) -> Estimate:
    """The estimate of a helicopter that is where its plan is, from a picture of another time; both in ns."""
    flat = plan.flat(np.array([1e-9 * now]))
    return Estimate(now, np.concatenate([flat.z[0], flat.dz[0]]), np.zeros(4), np.zeros((4, 3)), picture, 0)


def _nearest(planner: Planner, others: Sequence[Planner], now: int) -> float:
    """Least distance of a committed plan from those of others, from `now` on, every 5 ms."""
    t = 1e-9 * now + 0.005 * np.arange(460)
    mine = planner.committed.flat(t).z[:, :2]
    return min((float(np.hypot(*(each.committed.flat(t).z[:, :2] - mine).T).min()) for each in others), default=np.inf)


def to(start: Sequence[float], goal: Sequence[float], effort: float = 0.5, height: float = 1.0) -> Waypoints:
    """A straight flight from rest to rest, fitted."""
    points = ((start[0], start[1], height, 0.0), (goal[0], goal[1], height, 0.0))
    return Waypoints(points=points, effort=effort).fitted(MODEL)


def random_flights(count: int, seed: int, half_width: float = 1.6, apart: float = 0.6) -> dict[str, Waypoints]:
    """Flights between random places, of which any two starts and any two goals are apart."""
    rng = np.random.default_rng(seed)
    starts, goals = _places(count, rng, half_width, apart), _places(count, rng, half_width, apart)
    return {f"s{i}": to(starts[i], goals[i]) for i in range(count)}


def _places(count: int, rng: np.random.Generator, half_width: float, apart: float) -> list[Array]:
    places: list[Array] = []
    while len(places) < count:
        place = rng.uniform(-half_width, half_width, 2)
        if all(np.hypot(*(place - other)) >= apart for other in places):
            places.append(place)
    return places


def swap(count: int, radius: float = 1.2) -> dict[str, Waypoints]:
    """All on a circle, each to the opposite place."""
    angles = 2.0 * np.pi * np.arange(count) / count
    places = radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return {f"s{i}": to(place, -place) for i, place in enumerate(places)}
