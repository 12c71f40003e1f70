"""One flight of several helicopters: each has its own lab and ground station, and all meet at common times.

Between two common times each flies on as in `heli_twin.flight`, in a world of its own or all in one. At a common time,
all know where the others are (for the air that they disturb), and planners whose turn it is act in the order of their
names. Messages between ground stations go over the network of the room.
"""

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from time import perf_counter_ns
from typing import NamedTuple

import numpy as np

from controllers.coordinations import CommittedPlan, Planner, Ship
from controllers.errors import LawFailed
from controllers.laws import closed_after
from controllers.reference import BLOCK_SAMPLES
from controllers.signals import Estimate
from controllers.supervisors import LandsOnPlan
from controllers.trajectories import fitted
from heli_twin.experiment import Experiment
from heli_twin.experiment.several import Several
from heli_twin.experiment.values import ExperimentError
from heli_twin.flight import INVALID, Flight, Outcome, reproducible
from heli_twin.lab import disturbances
from heli_twin.lab.chance import Chance, generator, mixed
from heli_twin.lab.plant import Plant
from heli_twin.lab.plant.world import World
from heli_twin.lab.radio import Dsm2, Turn
from heli_twin.metrics.contact import touching
from heli_twin.recording.ships import ShipWires

FOLLOWING = ("ready", "flying", "coasting")
"""Phases of the supervisor in which a helicopter follows its plan."""


class Station(NamedTuple):
    """One of several helicopters, its lab and its ground station."""

    flight: Flight
    planner: Planner
    wires: ShipWires


class Helicopters(NamedTuple):
    """The helicopters of a room."""

    plants: Mapping[str, Plant]
    """By name."""
    world: World | None
    """The world that moves all of them; None if each has one of its own."""


class Room:
    """Several helicopters in one room, wired together; it flies once.

    Args:
        several: What to fly.
        helicopters: Each at the start of its trajectory.
        wires: Take what crosses the wires of each.
        progress: Told the simulated time, s, at every common time.

    Raises:
        ExperimentError: The coordination cannot fly them together.
    """

    def __init__(
        self,
        several: Several,
        helicopters: Helicopters,
        wires: Mapping[str, ShipWires],
        progress: Callable[[float], None] = lambda t: None,
    ) -> None:
        fleet, plants, self.world = several.fleet(), helicopters.plants, helicopters.world
        first = next(iter(fleet.values()))
        base = mixed(first.noise) if first.noise else generator
        planners = planners_of(several, fleet)
        self.stations = {
            name: Station(
                Flight(e, plants[name], wires[name], chance=chance_of(base, name, several.shared)),
                planners[name],
                wires[name],
            )
            for name, e in fleet.items()
        }
        if several.transmitters == "one":
            self.share_transmitter(base, several.shared)
        self.network = several.network.start(list(fleet), base(first.seed, "network"))
        self.received = dict.fromkeys(fleet, 0)
        self.flying = {name: station.flight for name, station in self.stations.items()}
        self.outcomes: dict[str, Outcome] = {}
        """Of the flights that are over."""
        self.touched: dict[str, str] = {}
        """Whom each has touched first in one world, and when, for those that have."""
        self.progress = progress
        self.now = 0

    def share_transmitter(self, base: Chance, shared: tuple[str, ...]) -> None:
        """Let one transmitter send its frames to each in turn, in the order of their names."""
        for number, (name, station) in enumerate(self.stations.items()):
            e, turn = station.flight.experiment, Turn(number, len(self.stations))
            assert isinstance(e.radio, Dsm2)
            own, of_all = chance_of(base, name, shared)(e.seed, "radio"), base(e.seed, "radio")
            station.flight.radio = e.radio.start_in_turn(own, of_all, turn)

    def run(self) -> dict[str, Outcome]:
        """Fly until the flight of every helicopter is over; return how each ended."""
        with reproducible(), ExitStack() as stack:
            for name, station in self.stations.items():
                stack.enter_context(closed_after(station.flight.controller))
                self.follow(name)
            while self.flying:
                self.meet(self.now)
                until = self.next_time()
                self.advance(until)
                self.now = until
                self.progress(1e-9 * self.now)
        return {name: self.outcomes[name] for name in self.stations}

    def meet(self, t: int) -> None:
        """Do at a common time t, ns, what concerns more than one of them."""
        truths = [station.flight.plant.truth() for station in self.stations.values()]
        positions = np.array([truth.position for truth in truths])
        for i, station in enumerate(self.stations.values()):
            station.flight.neighbours = truths[:i] + truths[i + 1 :]
            station.flight.others = np.concatenate([positions[:i], positions[i + 1 :]])
        if self.world is None:
            names = list(self.stations)
            for i, j in touching(positions):
                self.collided(t, names[i], names[j])
        for delivery in self.network.arrived(t):
            self.received[delivery.receiver] += 1
            self.stations[delivery.receiver].planner.receive(delivery.at, delivery.message)
        for name, station in self.stations.items():
            if station.planner.due <= t < station.flight.end:
                self.plan(t, name, station)

    def plan(self, t: int, name: str, station: Station) -> None:
        """Let a planner take its turn; that of a flight which is over still tells the others where it lies."""
        flight, planner, before = station.flight, station.planner, station.planner.committed
        estimate: Estimate | None = flight.estimate
        began = perf_counter_ns()
        is_over = name in self.outcomes
        messages = planner.act(t, estimate, flight.supervisor.phase in FOLLOWING and not is_over)
        took = perf_counter_ns() - began
        for message in messages:
            self.network.send(t, message)
        if is_over:
            return
        station.wires.planning(t, planner.note, (len(messages), self.received[name]), took)
        self.received[name] = 0
        if planner.committed is not before:
            self.follow(name)

    def follow(self, name: str) -> None:
        """Let a helicopter fly what its planner has committed to."""
        flight, planner, wires = self.stations[name]
        if isinstance(flight.supervisor, LandsOnPlan):
            flight.supervisor.lands_on_plan = isinstance(planner.committed, CommittedPlan)
        flight.follow(planner.committed, PLAN_SAMPLES if self.now else BLOCK_SAMPLES)
        wires.path(self.now, planner.committed)

    def next_time(self) -> int:
        """Return the next common time, ns: of the air or of a planner."""
        some = next(iter(self.stations.values())).flight
        air = (self.now // disturbances.PERIOD_NS + 1) * disturbances.PERIOD_NS
        turns = [
            some.on_grid(station.planner.due) for station in self.stations.values() if station.planner.due > self.now
        ]
        return some.on_grid(min([air, *turns]))

    def advance(self, until: int) -> None:
        """Fly all on to a common time, ns, from one event of any of them to the next."""
        while (now := min((flight.now for flight in self.flying.values()), default=until)) < until:
            self.move_world(now)
            for name, flight in [each for each in self.flying.items() if each[1].now == now]:
                self.tick(name, flight, until)
        self.move_world(until)

    def tick(self, name: str, flight: Flight, until: int) -> None:
        """Do all that is due for one helicopter now, and let it fly on to its next event, or to `until`, ns."""
        try:
            outcome = flight.tick(flight.now)
        except LawFailed as error:
            outcome = Outcome(INVALID, error.time, str(error))
        if outcome is None:
            flight.coast(until)
            return
        if name in self.touched and outcome.kind != INVALID:
            # Who touched another has collided, whatever came of it.
            outcome = Outcome("collided", outcome.time, f"{self.touched[name]}, then {outcome.text}")
        self.over(name, outcome)

    def over(self, name: str, outcome: Outcome) -> None:
        """Take note that a flight is over."""
        if self.world:
            self.world.switch_off(name)
        self.outcomes[name] = outcome
        del self.flying[name]

    def move_world(self, until: int) -> None:
        """Fly on with all that are in one world, to `until`, ns."""
        if self.world is None:
            return
        before = len(self.world.touched)
        self.world.advance(until)
        for (a, b), t in [*self.world.touched.items()][before:]:
            self.told(t, a, b)

    def collided(self, t: int, a: str, b: str) -> None:
        """End the flights of two helicopters that touch, each in a world of its own."""
        flying = [name for name in (a, b) if name in self.flying]
        for name in flying:
            flight = self.flying[name]
            flight.show(t, flight.plant.truth())
        self.told(t, a, b)
        for name in flying:
            self.over(name, Outcome("collided", t, self.touched[name]))

    def told(self, t: int, a: str, b: str) -> None:
        """Record that two helicopters touch, on the wires of those that fly."""
        for name, other in ((a, b), (b, a)):
            if name in self.flying:
                text = f"touched {other} at {1e-9 * t:.2f} s"
                self.stations[name].wires.event(t, "error", "collided", text)
                self.touched.setdefault(name, text)


PLAN_SAMPLES = 8
"""Samples of a plan that are made at once: it is soon replaced by another."""


def chance_of(base: Chance, ship: str, shared: tuple[str, ...]) -> Chance:
    """Return the source of the random numbers of one helicopter.

    Args:
        base: Of the room.
        ship: Its name, which begins the names of its components.
        shared: Components whose numbers are the same for all.
    """

    def chance(seed: int, component: str) -> np.random.Generator:
        return base(seed, component if component in shared else f"{ship}/{component}")

    return chance


def planners_of(several: Several, fleet: Mapping[str, Experiment]) -> dict[str, Planner]:
    """Return the planner of each helicopter by its name.

    Raises:
        ExperimentError: They cannot fly together.
    """
    ships = [Ship(name, fitted(e.trajectory, e.controller.model), e.controller.model) for name, e in fleet.items()]
    try:
        return {name: several.coordination.planner_of(name, ships) for name in fleet}
    except ValueError as error:
        raise ExperimentError(f"coordination: {error}") from None


def outcome_of_all(outcomes: Mapping[str, Outcome]) -> Outcome:
    """Return how the flight of all ended: as the worst of them."""
    worst = min(outcomes.values(), key=lambda outcome: (WORST_FIRST.index(outcome.kind), outcome.time))
    end = max(outcome.time for outcome in outcomes.values())
    alike = [name for name, outcome in outcomes.items() if outcome.kind == worst.kind]
    if worst.kind == "completed":
        return Outcome("completed", end, f"all {len(outcomes)} flew the whole {1e-9 * end:g} s")
    name = next(name for name, outcome in outcomes.items() if outcome is worst)
    return Outcome(worst.kind, end, f"{len(alike)} of {len(outcomes)}, first {name}: {worst.text}")


WORST_FIRST = ("invalid", "collided", "diverged", "crashed", "left_volume", "landed", "completed")
"""Outcomes, from what decides first to what all must have."""
