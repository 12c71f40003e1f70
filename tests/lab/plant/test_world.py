"""Several helicopters in one MuJoCo world."""

from dataclasses import replace

import numpy as np
import pytest

from controllers.signals import Array
from heli_twin.experiment.text import load
from heli_twin.lab.plant import STILL_AIR, Air, Plant, Truth
from heli_twin.lab.plant.effects.spool_up import SpoolUp
from heli_twin.lab.plant.mujoco import MuJoCo
from heli_twin.lab.plant.world import PARKED_M, World

LAB = load("lab").plant
ALL = load(
    "lab", [f"plant.effects.{name}=on" for name in ("payload", "stabiliser_bar", "cog_offset", "rotor_speed")]
).plant
BARE = MuJoCo(drag_x=0.0, drag_y=0.0, servo_lag=0.0)
STEP_NS = 5_000_000


def at(x: float, y: float = 0.0, z: float = 1.0, speed: float = 0.0, yaw: float = 0.0) -> Array:
    return np.array([x, y, z, yaw, speed, 0.0, 0.0, 0.0])


def farthest(a: Truth, b: Truth) -> float:
    return max(float(np.abs(of_a - of_b).max()) for of_a, of_b in zip(a[1:5], b[1:5], strict=True))


def differences(
    plants: dict[str, MuJoCo], starts: dict[str, Array], less_thrust: float, steps: int
) -> dict[str, float]:
    """Return the largest difference of the states (8,) of each in one world and alone, SI units."""
    world, rng = World(plants, starts), np.random.default_rng(1)
    alone: dict[str, Plant] = {name: plant.start(starts[name]) for name, plant in plants.items()}
    held = {name: (np.array(plant.trim), STILL_AIR) for name, plant in plants.items()}
    apart = dict.fromkeys(plants, 0.0)
    for k in range(1, steps + 1):
        # Inputs change at other times than those of the others.
        name = [*plants][k % len(plants)]
        u = np.array(plants[name].trim) + 0.1 * rng.normal(size=4) - [0.0, 0.0, less_thrust, 0.0]
        held[name] = u, Air(*0.2 * rng.normal(size=(2, 3)), moment=1e-5 * rng.normal(size=3))
        for each, (u, air) in held.items():
            world.twins[each].advance(k * STEP_NS, u, air)
            alone[each].advance(k * STEP_NS, u, air)
        world.advance(k * STEP_NS)
        for each in plants:
            assert world.twins[each].truth().touching == alone[each].truth().touching
            apart[each] = max(apart[each], farthest(world.twins[each].truth(), alone[each].truth()))
    assert not world.touched
    return apart


def test_who_touch_nobody_fly_as_in_worlds_of_their_own():
    starts = {"a": at(0.0), "b": at(1.0, 0.2), "c": at(0.0, 1.0)}
    found = differences({"a": LAB, "b": ALL, "c": BARE}, starts, 0.0, 60)
    assert found["a"] == found["c"] == 0.0
    # The string of its payload is a constraint, which a solver of all solves: 1e-15 was measured.
    assert found["b"] < 1e-12


def test_who_touch_the_floor_roll_on_it_as_in_worlds_of_their_own():
    found = differences(
        {"a": LAB, "b": LAB, "c": BARE}, {"a": at(0, 0, 0.05), "b": at(1, 0, 0.05), "c": at(0, 1, 2)}, 0.1, 60
    )
    # One solver for all contacts adds in another order: 1e-14 was measured. Who is in the air flies bit for bit.
    assert max(found.values()) < 1e-12
    assert found["c"] == 0.0


def test_two_that_meet_push_each_other_as_hard():
    starts = {"a": at(-0.2, 0.05, 1.0, 0.5), "b": at(0.2, 0.0, 1.01, 0.3, np.pi)}
    world, alone = World(dict.fromkeys("ab", BARE), starts), [BARE.start(x) for x in starts.values()]
    for plant in (*world.twins.values(), *alone):
        plant.advance(300_000_000, np.array(BARE.trim), STILL_AIR)
    world.advance(300_000_000)
    # They are 0.4 m apart, close at 0.8 m/s, and touch at two radii of the rotors, 0.05 m beside the line of flight.
    touch = (0.4 - (0.19**2 - 0.05**2) ** 0.5) / 0.8
    assert world.touched == {("a", "b"): pytest.approx(1e9 * touch, abs=2e6)}
    of_a, of_b = (
        twin.truth().velocity - other.truth().velocity for twin, other in zip(world.twins.values(), alone, strict=True)
    )
    # Against the way of each, and to its own side.
    assert of_a[0] < -0.1
    assert of_a[1] > 0.02
    # Both weigh the same. Those that the push tilts fly off by their thrust, in 30 ms by a few mm/s.
    assert of_b == pytest.approx(-of_a, abs=0.01)


def test_one_alone_in_a_world_flies_as_without_it():
    assert differences({"a": BARE}, {"a": at(0.0)}, 0.0, 5) == {"a": 0.0}


def test_the_floor_of_all_is_that_of_who_stands_on_it_from_farthest():
    standing = replace(BARE, effects=(SpoolUp(),))
    for plants in ({"a": standing, "b": BARE}, {"a": BARE, "b": standing}):
        world = World(plants, {"a": at(0.0, 0.0, 0.0455), "b": at(1.0, 0.0, 0.0455)})
        assert world.twins["a"].truth().touching
        assert world.twins["b"].truth().touching


def test_a_rotor_touches_the_tail_of_another_from_behind():
    world = World({"a": BARE, "b": BARE}, {"a": at(0.0, 0.0, 1.0, 0.5), "b": at(0.3)})
    for twin in world.twins.values():
        twin.advance(200_000_000, np.array(BARE.trim), STILL_AIR)
    world.advance(200_000_000)
    # The fin ends 13 cm behind the centre: 0.227 m from it to the far rim of the rotor.
    assert world.touched == {("a", "b"): pytest.approx(1e9 * (0.3 - 0.227) / 0.5, abs=4e6)}


def test_motors_of_a_flight_that_is_over_are_off_and_one_that_diverged_disturbs_nobody():
    world = World(dict.fromkeys("abc", LAB), {"a": at(0.0), "b": at(1.0), "c": at(2.0)})
    alone = LAB.start(at(1.0))
    world.twins["c"].place(np.full(8, np.nan))
    for name in "ac":
        world.switch_off(name)
    u = np.array(LAB.trim)
    for plant in (world.twins["b"], alone):
        plant.advance(500_000_000, u, STILL_AIR)
    world.advance(500_000_000)
    # A free fall, as soon as the rotors have stopped.
    assert world.twins["a"].truth().position[2] < 0.4
    assert farthest(world.twins["b"].truth(), alone.truth()) == 0.0
    assert all(np.isfinite(part).all() for part in world.twins["c"].truth()[1:5])


@pytest.mark.parametrize("lost", range(8))
def test_who_has_lost_any_number_of_its_state_is_taken_out_of_the_room(lost):
    world = World({"a": LAB, "b": LAB}, {"a": at(0.0), "b": at(1.0)})
    x = at(0.0)
    x[lost] = np.nan
    world.twins["a"].place(x)
    world.switch_off("a")
    parked = world.twins["a"].truth()
    assert parked.position[2] == PARKED_M
    # Rotors that run down lift it; then it stays where it is.
    for until in (2_000_000_000, 2_050_000_000):
        world.advance(until)
        before, parked = parked, world.twins["a"].truth()
    np.testing.assert_allclose(parked.velocity[:2], [0.0, 0.0], atol=1e-9)
    assert parked.velocity[2] == pytest.approx(before.velocity[2], abs=0.01)


def test_what_is_only_looked_at_is_no_part_of_the_world():
    world = World(dict.fromkeys("ab", LAB), {"a": at(0.0), "b": at(1.0)})
    # The floor; of each the skids, canopy, fin, upper disc, and the disc of both rotors.
    assert world._model.ngeom == 1 + 2 * 6
    # The disc of both, from 27 to 76 mm above the centre of gravity.
    rotors = world._model.geom("a/rotors")
    np.testing.assert_allclose(rotors.size[:2], [0.095, 0.0245])
    np.testing.assert_allclose(rotors.pos, [0.0, 0.0, 0.0515])
    # What touches a floor has the bit 1; the disc of both rotors is for others alone.
    touches = {name: int(world._model.geom(f"a/{name}").contype[0]) for name in ("canopy", "fin", "rotors")}
    assert touches == {"canopy": 3, "fin": 3, "rotors": 2}


def test_who_would_stand_in_the_floor_is_told():
    with pytest.raises(ValueError, match=r"at a height of 0.02 m the helicopter would stand"):
        World(dict.fromkeys("ab", LAB), {"a": at(0.0), "b": at(1.0, 0.0, 0.02)})
