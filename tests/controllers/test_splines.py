import numpy as np
import pytest

from controllers.splines import knot_motion, quintic, quintic_derivatives
from controllers.trajectories.csv import Csv

TIMES = np.array([0.0, 1.0, 1.5, 3.0, 4.0])
POINTS = np.random.default_rng(0).uniform(-1, 1, (5, 4))


@pytest.mark.parametrize(("knot", "first"), [(0, 0), (1, 0), (2, 1), (3, 2), (4, 2)])
def test_motion_at_a_knot_is_that_of_the_parabola_through_three_knots(knot, first):
    velocity, acceleration = knot_motion(TIMES, POINTS, rest=False)
    three = slice(first, first + 3)
    for axis in range(4):
        parabola = np.polyfit(TIMES[three], POINTS[three, axis], 2)
        assert acceleration[knot, axis] == pytest.approx(2 * parabola[0], abs=1e-12)
        assert velocity[knot, axis] == pytest.approx(np.polyval(np.polyder(parabola), TIMES[knot]), abs=1e-12)


def test_at_rest_the_first_and_the_last_knot_do_not_move():
    moving, still = knot_motion(TIMES, POINTS, rest=False), knot_motion(TIMES, POINTS, rest=True)
    for free, resting in zip(moving, still, strict=True):
        np.testing.assert_array_equal(resting[1:-1], free[1:-1])
        assert not resting[[0, -1]].any()


def test_two_knots_are_joined_by_a_straight_line():
    velocity, acceleration = knot_motion(np.array([1.0, 3.0]), np.array([[0.0, 1, 2, 3], [4, 1, 0, 4]]), rest=False)
    np.testing.assert_array_equal(velocity, [[2.0, 0.0, -1.0, 0.5]] * 2)
    np.testing.assert_array_equal(acceleration, np.zeros((2, 4)))


def test_the_curve_meets_every_knot_with_its_motion_and_rests_outside():
    velocity, acceleration = knot_motion(TIMES, POINTS, rest=False)
    curve = quintic(TIMES, TIMES, POINTS, velocity, acceleration)
    # The last digits of a polynomial with coefficients of up to 200.
    for values, expected in zip(curve, (POINTS, velocity, acceleration), strict=True):
        np.testing.assert_allclose(values, expected, atol=1e-12)
    outside = quintic(np.array([-1.0, 5.0]), TIMES, POINTS, velocity, acceleration)
    np.testing.assert_allclose(outside.z, POINTS[[0, -1]], atol=1e-12)
    assert not outside.dz.any()
    assert not outside.ddz.any()
    derivatives = quintic_derivatives(np.array([-1.0, 5.0]), 3, TIMES, POINTS, (velocity, acceleration))
    np.testing.assert_allclose(derivatives[0], POINTS[[0, -1]], atol=1e-12)
    assert not derivatives[1:].any()


def test_the_default_rows_go_round_a_square():
    t, x, y, z, yaw = np.array(Csv().rows).T
    np.testing.assert_array_equal(t, [0, 3, 6, 9, 12])
    np.testing.assert_array_equal(np.stack([x, y]), 0.6 * np.array([[0, 1, 1, 0, 0], [0, 0, 1, 1, 0]]))
    np.testing.assert_array_equal(z, [0.8, 1.0, 1.2, 1.0, 0.8])
    np.testing.assert_array_equal(yaw, [0, 0, 1.5, 3, 3])
