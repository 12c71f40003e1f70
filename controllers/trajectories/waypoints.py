"""Fly through way-points, each with a heading."""

from dataclasses import dataclass, replace
from itertools import pairwise
from math import isfinite
from typing import Annotated, Literal

import numpy as np
from annotated_types import Gt, Le, MaxLen, MinLen, Unit, doc

from controllers.flatness import FlatOutput, feed_forward, state
from controllers.markers import Rows
from controllers.model import Model
from controllers.signals import Array
from controllers.splines import knot_motion, quintic, quintic_derivatives

Point = tuple[float, float, float, float]
"""x, y, height (m) and heading (rad)."""

_SHORTEST_LEG_S = 0.1
"""Duration of a leg between two equal points, s."""
_LONGEST_LEG_S = 1000.0
"""Longest duration that the search tries, s; if a leg needs more, `check_feasible` refuses the flight and says why."""


@dataclass(frozen=True, slots=True)
class Waypoints:
    """A smooth flight from point to point, from rest to rest, along polynomials of degree five in the flat outputs.

    Headings are not wrapped: from 0 to 6.28 is a whole turn to port. Without times, each leg takes the shortest time
    in which the flight needs no more than the share `effort` of the believed limits beyond hovering.
    """

    kind: Literal["waypoints"] = "waypoints"
    points: Annotated[
        tuple[Point, ...],
        MinLen(2),
        MaxLen(1000),
        Rows(("x", "y", "z", "yaw")),
        doc("x, y, height (m) and heading (rad) of each, or the path of a CSV file with columns x, y, z, yaw"),
    ] = (
        (0.0, 0.0, 0.8, 0.0),
        (0.8, 0.0, 1.2, 0.0),
        (0.8, 0.8, 1.2, 1.5708),
        (0.0, 0.8, 0.8, 3.1416),
        (0.0, 0.0, 0.8, 0.0),
    )
    times: Annotated[
        tuple[float, ...], Unit("s"), doc("when to be at each point, the first at 0; none: as the limits allow")
    ] = ()
    corners: Annotated[Literal["stop", "pass"], doc("stop at each point, or fly through without a stop")] = "stop"
    effort: Annotated[float, Gt(0), Le(1), doc("share of the believed limits to use where no times are given")] = 0.25

    def __post_init__(self) -> None:
        """Refuse times that do not belong to the points.

        Raises:
            ValueError: There is not one time per point, or the times do not increase from 0.
        """
        times = self.times
        if len(times) and len(times) != len(self.points):
            raise ValueError(f"times has {len(times)} entries for {len(self.points)} points: give one each, or none")
        if len(times) and (times[0] != 0.0 or not all(b > a and isfinite(b) for a, b in pairwise(times))):
            raise ValueError(f"times = {list(times)} has to start at 0 and increase")

    def flat(self, t: Array) -> FlatOutput:
        """Return the flat outputs; after the last time the flight stays at the last point."""
        return _curve(t, np.array(self.fitted(Model()).times), np.array(self.points), self.corners)

    @property
    def smoothness(self) -> int:
        """Up to the acceleration, at the points."""
        return 2

    def derivatives(self, t: Array, highest: int) -> Array:
        """Return the flat outputs and their time derivatives."""
        times, points = np.array(self.fitted(Model()).times), np.array(self.points)
        return quintic_derivatives(t, highest, times, points, _motion(times, points, self.corners))

    def fitted(self, model: Model) -> "Waypoints":
        """Return the same flight with the shortest times that `model` allows, unless times are given."""
        if len(self.times):
            return self
        points = np.array(self.points)
        legs = np.array([_shortest(points[i : i + 2], np.ones(1), self, model) for i in range(len(points) - 1)])
        if self.corners == "pass" and len(points) > 2:
            legs *= _shortest(points, legs, self, model)
        # Rounded up to milliseconds, to be readable.
        return replace(self, times=(0.0, *(np.cumsum(np.ceil(1e3 * legs)) / 1e3).tolist()))


def _curve(t: Array, times: Array, points: Array, corners: str) -> FlatOutput:
    return quintic(t, times, points, *_motion(times, points, corners))


def _motion(times: Array, points: Array, corners: str) -> tuple[Array, Array]:
    """Velocities and accelerations at the points, each (n, 4)."""
    rest = np.zeros_like(points)
    return knot_motion(times, points, rest=True) if corners == "pass" else (rest, rest)


def _shortest(points: Array, legs: Array, spec: Waypoints, model: Model) -> float:
    """The smallest factor on the durations of the legs (s) that keeps the demand below the allowed effort."""

    def fits(factor: float) -> bool:
        times = np.concatenate([[0.0], np.cumsum(factor * legs)])
        t = times[-1] * np.arange(64 * len(legs) + 1) / (64 * len(legs))
        return _demand(_curve(t, times, points, spec.corners), model) <= spec.effort

    low, high = 0.0, _SHORTEST_LEG_S
    while not fits(high) and high < _LONGEST_LEG_S:
        low, high = high, 2.0 * high
    while low > 0.0 and high - low > 1e-3 * high:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if fits(middle) else (middle, high)
    return high


def _demand(flat: FlatOutput, model: Model) -> float:
    """The largest share of the ranges between hover and the limits (28), (29) that a flight needs."""
    hover = np.array(model.u_hover)
    beyond = feed_forward(model, flat) - hover
    room = np.where(beyond > 0.0, np.array(model.u_max) - hover, hover - np.array(model.u_min))
    speed = np.abs(state(flat)[:, 4:]) / np.array(model.v_max)
    return float(max(np.max(np.abs(beyond) / np.maximum(room, 1e-9)), np.max(speed)))
