"""The limits at which a flight is over."""

import numpy as np
import pytest

from heli_twin.experiment import Volume
from heli_twin.flight import FLOOR_MARGIN_M, verdict
from heli_twin.lab.plant import Truth

VOLUME = Volume(half_width=2.5, height=2.0)
T = 1_500_000_000


def truth(position=(0.0, 0.0, 1.0), quat_wxyz=(1.0, 0.0, 0.0, 0.0), velocity=(0.0, 0.0, 0.0), touching=False) -> Truth:
    q, p, v = np.array(quat_wxyz), np.array(position), np.array(velocity)
    return Truth(T, p, q, v, np.zeros(3), 0.0, 0.0, np.zeros(4), touching)


def ending(planned_height=1.0, **state: object) -> str | None:
    outcome = verdict(T, truth(**state), planned_height, VOLUME)
    assert outcome is None or outcome.time == T
    return outcome and outcome.kind


def leaning(degrees: float, axis: float) -> tuple[float, ...]:
    """An attitude whose mast leans by this from the vertical, about a horizontal axis, after a turn of 70 deg."""
    half, c, s = np.radians(degrees) / 2, np.cos(np.radians(35.0)), np.sin(np.radians(35.0))
    w, x, y = np.cos(half), np.sin(half) * np.cos(axis), np.sin(half) * np.sin(axis)
    return (c * w, c * x - s * y, c * y + s * x, s * w)


@pytest.mark.parametrize("axis", [0.0, 0.7, np.pi / 2, 4.0])
@pytest.mark.parametrize(("degrees", "kind"), [(0, None), (44.9, None), (45.1, "diverged"), (180, "diverged")])
def test_a_helicopter_has_tipped_over_from_45_degrees_on(degrees: float, axis: float, kind: str | None) -> None:
    assert ending(quat_wxyz=leaning(degrees, axis)) == kind
    on_the_floor = ending(quat_wxyz=leaning(degrees, axis), touching=True, planned_height=0.0)
    assert on_the_floor == (kind and "crashed")


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("side", [-1, 1])
def test_the_volume_ends_at_its_half_width(axis: int, side: int) -> None:
    position = [0.0, 0.0, 1.0]
    position[axis] = side * 2.5
    assert ending(position=position) is None
    position[axis] = side * 2.501
    assert ending(position=position) == "left_volume"


def test_the_volume_ends_at_its_height() -> None:
    assert ending(position=(0.0, 0.0, 2.0)) is None
    assert ending(position=(0.0, 0.0, 2.001)) == "left_volume"


def test_touching_the_floor_is_a_crash_unless_the_plan_is_there() -> None:
    assert ending(touching=True, planned_height=1.0) == "crashed"
    assert ending(touching=True, planned_height=0.151) == "crashed"
    assert ending(touching=True, planned_height=0.15) is None
    assert ending(touching=False, planned_height=1.0) is None
    assert FLOOR_MARGIN_M == 0.15


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize(("field", "size"), [("position", 3), ("quat_wxyz", 4), ("velocity", 3)])
def test_a_state_that_is_not_finite_has_diverged(field: str, size: int, wrong: float) -> None:
    for i in range(size):
        values = [1.0, 0.0, 0.0, 0.0][:size]
        values[i] = wrong
        assert ending(**{field: values}) == "diverged"
