"""Scenarios: what several helicopters in one room want to fly. A class here is one kind.

A helicopter that a scenario names flies what the scenario says; others, which have an experiment of their own, their
own trajectory.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import cos, pi, sin
from typing import Annotated, Literal, Protocol

import numpy as np
from annotated_types import Ge, Gt, Le, Unit, doc

from controllers.signals import Array
from controllers.trajectories import Trajectory
from controllers.trajectories.circle import Circle
from controllers.trajectories.waypoints import Waypoints
from heli_twin.lab.chance import generator

LETTERS = "abcdefghijklmnopqrstuvwxyz"
MOST_SHIPS = 64

Ships = Annotated[int, Ge(1), Le(MOST_SHIPS), doc("number of helicopters")]
Height = Annotated[float, Gt(0), Unit("m"), doc("of all, above the floor")]
Speed = Annotated[float, Gt(0), Unit("m/s"), doc("greatest that is wished")]
Acceleration = Annotated[float, Gt(0), Unit("m/s^2"), doc("greatest that is wished")]

PEAK_SPEED, PEAK_ACCELERATION, PEAK_JERK = 1.875, 10.0 / 3.0**0.5, 60.0
"""Of a polynomial of degree five from rest to rest over the length 1 in the time 1."""
MOST_JERK = 4.0
"""m/s^3; 10 shakes the helicopter of the lab so that it swings for seconds."""


class Scenario(Protocol):
    """What several helicopters want to fly, as a value: a frozen dataclass with a literal `kind`."""

    @property
    def kind(self) -> str:
        """Its name."""
        ...

    def wishes(self) -> Mapping[str, Trajectory]:
        """Return the trajectory of each helicopter by its name.

        Raises:
            ValueError: There is no room for so many.
        """
        ...


@dataclass(frozen=True, slots=True)
class Own:
    """Each helicopter flies the trajectory of its own experiment."""

    kind: Literal["own"] = "own"

    def wishes(self) -> Mapping[str, Trajectory]:
        """Return none: every helicopter has its own."""
        return {}


@dataclass(frozen=True, slots=True)
class Swap:
    """The helicopters stand on a circle, and each flies straight through the middle to the place opposite."""

    kind: Literal["swap"] = "swap"
    ships: Ships = 2
    radius: Annotated[float, Gt(0), Unit("m"), doc("of the circle about the middle of the room")] = 1.2
    height: Height = 1.0
    speed: Speed = 1.0
    acceleration: Acceleration = 1.0

    def wishes(self) -> Mapping[str, Trajectory]:
        """Return the flights."""
        starts = _ring(self.ships, self.radius, self.height)
        goals = starts * [-1.0, -1.0, 1.0, 1.0]
        return _named([_direct(a, b, self.speed, self.acceleration) for a, b in zip(starts, goals, strict=True)])


@dataclass(frozen=True, slots=True)
class Random:
    """Starts and goals are drawn in a square at one height, with room between the starts and between the goals."""

    kind: Literal["random"] = "random"
    ships: Ships = 8
    draw: Annotated[
        int, Ge(0), Le(2**53), doc("which starts and goals; the seed of the flight does not change them")
    ] = 0
    half_width: Annotated[
        float, Ge(0), Unit("m"), doc("of the square; 0: as dense as eight helicopters in 3 x 3 m, but 2 x 2 m at least")
    ] = 0.0
    spacing: Annotated[float, Gt(0), Unit("m"), doc("least between two starts, and between two goals")] = 0.6
    height: Height = 1.0
    speed: Speed = 1.0
    acceleration: Acceleration = 1.0

    def wishes(self) -> Mapping[str, Trajectory]:
        """Return the flights.

        Raises:
            ValueError: There is no room for so many.
        """
        rng = generator(self.draw, "scenario")
        half = self.half_width or max(1.0, 1.5 * (self.ships / 8.0) ** 0.5)
        starts, goals = (self._places(rng, half) for _ in range(2))
        return _named([_direct(a, b, self.speed, self.acceleration) for a, b in zip(starts, goals, strict=True)])

    def _places(self, rng: np.random.Generator, half: float) -> Array:
        """Draw places (n, 4): each anew until it is apart from those before; after many tries all anew."""
        for _ in range(20):
            places = np.zeros((self.ships, 2))
            count = 0
            for at in rng.uniform(-half, half, (50 * self.ships, 2)):
                if not count or np.hypot(*(places[:count] - at).T).min() >= self.spacing:
                    places[count] = at
                    count += 1
                if count == self.ships:
                    return np.column_stack([places, np.tile([self.height, 0.0], (self.ships, 1))])
        raise ValueError(
            f"there is no room for {self.ships} helicopters with spacing = {self.spacing:g} m in a square of"
            f" half_width = {half:g} m: give less spacing or more width"
        )


@dataclass(frozen=True, slots=True)
class CrossingCircles:
    """Circles that cross: neighbours turn in opposite directions and would meet where their circles cross."""

    kind: Literal["crossing_circles"] = "crossing_circles"
    ships: Ships = 2
    radius: Annotated[float, Gt(0), Unit("m"), doc("of each circle")] = 0.7
    offset: Annotated[float, Gt(0), Unit("m"), doc("from the middle of the room to the centre of each circle")] = 0.4
    rate: Annotated[float, Gt(0), Unit("rad/s"), doc("angular rate of each")] = 0.8
    height: Height = 1.0

    def wishes(self) -> Mapping[str, Trajectory]:
        """Return the flights: each starts at the point of its circle that is farthest from the middle."""
        angles = 2.0 * pi * np.arange(self.ships) / self.ships
        return _named(
            [
                Circle(
                    radius=self.radius,
                    rate=self.rate if i % 2 == 0 else -self.rate,
                    height=self.height,
                    heading="fixed",
                    x=self.offset * cos(angle),
                    y=self.offset * sin(angle),
                    phase=angle,
                )
                for i, angle in enumerate(angles.tolist())
            ]
        )


@dataclass(frozen=True, slots=True)
class Formation:
    """A line becomes a ring, and the ring a line again, in which all stand in the reverse order."""

    kind: Literal["formation"] = "formation"
    ships: Ships = 4
    spacing: Annotated[float, Gt(0), Unit("m"), doc("between neighbours")] = 0.7
    pause: Annotated[float, Gt(0), Unit("s"), doc("in the ring")] = 2.0
    height: Height = 1.0
    speed: Speed = 1.0
    acceleration: Acceleration = 1.0

    def wishes(self) -> Mapping[str, Trajectory]:
        """Return the flights; all legs of all helicopters take the same time."""
        along = self.spacing * (np.arange(self.ships) - 0.5 * (self.ships - 1))
        line = np.column_stack([0.0 * along, along, np.full_like(along, self.height), 0.0 * along])
        ring = _ring(self.ships, self.spacing / (2.0 * sin(pi / max(self.ships, 2))), self.height)
        stages = np.stack([line, ring, line[::-1]])
        lengths = np.linalg.norm(np.diff(stages, axis=0), axis=2).max(axis=1)
        first, second = (_time(length, self.speed, self.acceleration) for length in lengths.tolist())
        times = (0.0, first, first + self.pause, first + self.pause + second)
        points = stages[[0, 1, 1, 2]].swapaxes(0, 1)
        return _named([Waypoints(points=_rows(row), times=times) for row in points])


def names_of(count: int) -> list[str]:
    """Return the names of so many helicopters: letters, or numbers where letters do not suffice."""
    return list(LETTERS[:count]) if count <= len(LETTERS) else [f"s{i:02d}" for i in range(1, count + 1)]


def _named(wishes: list[Trajectory]) -> dict[str, Trajectory]:
    return dict(zip(names_of(len(wishes)), wishes, strict=True))


def _ring(count: int, radius: float, height: float) -> Array:
    """Places (n, 4) on a circle, all headed north."""
    angles = 2.0 * pi * np.arange(count) / count
    return np.column_stack([radius * np.cos(angles), radius * np.sin(angles), np.full(count, height), np.zeros(count)])


def _direct(start: Array, goal: Array, speed: float, acceleration: float) -> Waypoints:
    """Return the straight flight from rest to rest between two places (4,)."""
    time = _time(float(np.linalg.norm(goal - start)), speed, acceleration)
    return Waypoints(points=_rows(np.stack([start, goal])), times=(0.0, time))


def _time(length: float, speed: float, acceleration: float) -> float:
    """Return how long a straight flight from rest to rest takes, s; whole milliseconds, 0.1 s at least."""
    smooth = (PEAK_JERK * length / MOST_JERK) ** (1.0 / 3.0)
    shortest = max(PEAK_SPEED * length / speed, (PEAK_ACCELERATION * length / acceleration) ** 0.5, smooth, 0.1)
    return np.ceil(1e3 * shortest).item() / 1e3


def _rows(places: Array) -> tuple[tuple[float, float, float, float], ...]:
    """Return places (n, 4), to a tenth of a millimetre, as the points of a trajectory."""
    return tuple((x, y, z, yaw) for x, y, z, yaw in (np.round(places, 4) + 0.0).tolist())
