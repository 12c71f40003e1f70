"""Half-spaces between a plan and those of others, and the room that a plan leaves: known values."""

from typing import Any

import numpy as np
import pytest

from controllers.scene import BETWEEN_M, Scene
from controllers.separation import FINE, fine_path

L, H, STEPS, KEEP = 6, 0.1, 4, 0.45


def plan(x: float, y: float, speed: float = 0.0) -> Any:
    """(L + 2, 3, 4) knots of a plan at a constant speed northwards."""
    knots = np.zeros((L + 2, 3, 4))
    knots[:, 0, 0], knots[:, 0, 1] = x + speed * H * np.arange(L + 2), y
    knots[:, 1, 0] = speed
    return knots


def scene(own: Any, *others: Any, **changes: Any) -> Scene:
    knots = np.array(others)
    none = np.zeros(len(others), bool)
    wide = np.full((len(others), FINE * (L + 1)), KEEP)
    names = [f"s{j}" for j in range(len(others))]
    made = Scene(1, H, 0.01, own, names, knots[:, :, 0, :2], fine_path(knots, H), wide, none, none, 0.0, [])
    return made._replace(**changes)


def test_the_room_is_the_least_distance_beyond_the_one_to_keep():
    # One flies past at 0.6 m to the side, nearest between two knots; the other stands 1 m to the other side.
    here = scene(plan(0.0, 0.0), plan(-0.35, 0.6, 1.0), plan(0.0, -1.0))
    np.testing.assert_allclose(here.room(plan(0.0, 0.0)), [0.6 - 0.01 - KEEP, 1.0 - 0.01 - KEEP], atol=1e-12)
    np.testing.assert_allclose(here.room(plan(0.0, 0.2)), [0.4 - 0.01 - KEEP, 1.2 - 0.01 - KEEP], atol=1e-12)
    wide = here.wide.copy()
    wide[1, 3] += 0.5
    assert here._replace(wide=wide).room(plan(0.0, 0.0))[1] == pytest.approx(1.0 - 0.01 - KEEP - 0.5)
    assert here.here.tolist() == [0.0, 0.0]
    assert not here._replace(names=[]).room(plan(0.0, 0.0)).size


def test_nobody_near_gives_no_half_spaces():
    here = scene(plan(0.0, 0.0), plan(1.0, 0.0))
    assert here.half_spaces(np.zeros(1, bool), 0.35, STEPS, 1.0) is None


@pytest.mark.parametrize(
    ("away", "turn", "angle"),
    [
        (1.0, 0.0, 0.0),
        (1.0, 0.2, 0.2),
        (1.0, 2.0, 0.9 * np.arccos(KEEP + BETWEEN_M)),
        (0.5, 2.0, 0.9 * np.arccos((KEEP + BETWEEN_M) / 0.5)),
    ],
)
def test_lines_are_turned_so_that_all_pass_on_the_right_and_keep_the_old_plan_feasible(away, turn, angle):
    """The other is `away` to the north: the normal points south, turned to the west (+y), where the left is."""
    here = scene(plan(0.0, 0.0), plan(away, 0.0))
    sides = here.half_spaces(np.ones(1, bool), turn, STEPS, 1.0)
    assert sides is not None
    assert sides.knots.tolist() == [1, 2, 3, 4]
    normal = -np.array([np.cos(angle), np.sin(angle)])
    np.testing.assert_allclose(sides.normals, np.tile(normal, (STEPS, 1)), atol=1e-12)
    np.testing.assert_allclose(sides.offsets, normal[0] * away + KEEP + BETWEEN_M, atol=1e-12)
    assert (sides.offsets <= 1e-12).all(), "the old plan, at the origin, is behind the lines"


def test_from_one_that_is_nearer_than_the_distance_the_old_plan_is_the_limit():
    sides = scene(plan(0.0, 0.0), plan(0.3, 0.0)).half_spaces(np.ones(1, bool), 0.35, STEPS, 1.0)
    assert sides is not None
    np.testing.assert_allclose(sides.offsets, 0.0, atol=1e-12)


def test_from_one_that_cannot_go_on_plans_move_away_at_the_push():
    pressed = scene(plan(0.0, 0.0), plan(0.46, 0.0), pressed=np.ones(1, bool), push=0.4)
    wide = pressed._replace(wide=pressed.wide + 0.2)
    sides = wide.half_spaces(np.ones(1, bool), 0.0, STEPS, 1.0)
    assert sides is not None
    np.testing.assert_allclose(sides.offsets, 0.2 * (H * np.arange(1, 5)) ** 2, atol=1e-12)


def test_the_distance_to_keep_is_that_of_the_chord_before_each_knot():
    here = scene(plan(0.0, 0.0), plan(2.0, 0.0))
    wide = here.wide + 0.001 * np.arange(here.wide.shape[1])
    sides = here._replace(wide=wide).half_spaces(np.ones(1, bool), 0.0, STEPS, 1.0)
    assert sides is not None
    # Knot k is the end of the chord FINE (k + 1) - 1: plans begin a knot before the first that can be new.
    np.testing.assert_allclose(sides.offsets + 2.0, KEEP + BETWEEN_M + 0.001 * (FINE * np.arange(2, 6) - 1), atol=1e-12)


def test_from_one_in_the_way_it_brakes_as_hard_as_it_can():
    """At 0.8 m/s towards one that stands 0.2 m ahead: what braking allows, from there on."""
    here = scene(plan(-0.08, 0.0, 0.8), plan(0.2, 0.0), in_danger=np.ones(1, bool))
    sides = here.half_spaces(np.ones(1, bool), 0.0, STEPS, 1.5)
    assert sides is not None
    t = H * np.arange(1, 5)
    np.testing.assert_allclose(sides.normals, [[-1.0, 0.0]] * STEPS, atol=1e-12)
    np.testing.assert_allclose(sides.offsets, -0.8 * t + 0.75 * t**2, atol=1e-12)
