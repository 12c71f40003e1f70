"""Rules of plants and of disturbances: physics that does not depend on who looks when, and air that repeats."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from controllers.signals import Array, nanoseconds
from heli_twin.conformance.rules import close, require, same
from heli_twin.lab.disturbances import ALONE, PERIOD_NS, air_of
from heli_twin.lab.plant import STILL_AIR
from heli_twin.lab.plant.ideal import Ideal

_START = np.array([0.3, -0.2, 1.0, 0.7, 0.0, 0.0, 0.0, 0.0])
_INPUT = np.array([0.05, -0.03, 0.55, 0.02])


def _flown(spec: Any, stops: Sequence[int]) -> list[Array]:
    plant, step = spec.start(_START), nanoseconds(spec.step)
    for stop in stops:
        plant.advance(stop * step, _INPUT, STILL_AIR)
    truth = plant.truth()
    return [truth.position, truth.quat_wxyz, truth.velocity, truth.angular_velocity, np.array([truth.yaw])]


def starts_where_it_is_put(spec: Any) -> None:
    """It starts at the position, heading and speed that it is given."""
    truth = spec.start(_START).truth()
    close(truth.position, _START[:3], 1e-9, "position")
    close(np.array([truth.yaw]), _START[3:4], 1e-9, "yaw")
    close(truth.velocity, np.zeros(3), 1e-9, "velocity")


def flies_the_same_in_pieces(spec: Any) -> None:
    """A flight in pieces is the flight at once, and both are finite."""
    whole, pieces = _flown(spec, [500]), _flown(spec, [1, 3, 50, 51, 400, 500])
    require(all(np.isfinite(part).all() for part in whole), "its state is not finite")
    require(same(whole, pieces), "a flight in pieces is another flight")


def gives_its_truth_away(spec: Any) -> None:
    """The truth belongs to the caller: it does not change when the flight goes on."""
    plant = spec.start(_START)
    truth = plant.truth()
    before = [np.array(truth.position), np.array(truth.velocity)]
    plant.advance(100 * nanoseconds(spec.step), _INPUT, STILL_AIR)
    require(same(before, [truth.position, truth.velocity]), "its arrays are overwritten: return copies")


def _airs(spec: Any, seed: int = 0, count: int = 50, others: Array = ALONE) -> list[Array]:
    plant, disturbance = Ideal().start(_START), air_of(spec.start(np.random.default_rng(seed)))
    rows: list[Array] = []
    for k in range(1, count + 1):
        air = disturbance(plant.truth(), others)
        moment = np.zeros(3) if air.moment is None else air.moment
        rows.append(np.array([*air.wind, *air.acceleration, air.thrust_factor, *moment], float))
        plant.advance(k * PERIOD_NS, _INPUT, air)
    return rows


def blows_finite_air(spec: Any) -> None:
    """Wind, push and moment are three finite numbers each, and thrust is never below zero, alone or with others."""
    others = _START[:3] + np.array([[0.1, 0.0, 0.5], [1.0, 0.0, 0.0]])
    for row in _airs(spec) + _airs(spec, others=others):
        require(row.shape == (10,), f"wind, acceleration and moment have {len(row) - 1} numbers together, not 9")
        require(np.isfinite(row).all(), f"the air is {row.tolist()}")
        require(row[6] >= 0.0, f"thrust_factor = {row[6]}")


def blows_the_same_for_the_same_seed(spec: Any) -> None:
    """The same seed gives the same air, and two flights of one value do not share a state."""
    require(same(_airs(spec), _airs(spec)), "the same seed gave other air: draw from the generator that start() gets")
