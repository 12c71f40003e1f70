import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from controllers.rotations import rotate_to_body, rotate_to_world, wrap_angle, yaw_of


def attitude(yaw, pitch, roll):
    """The quaternion of z-y-x angles: a product of three half-angle rotations."""
    cy, sy, cp, sp, cr, sr = (f(0.5 * angle) for angle in (yaw, pitch, roll) for f in (np.cos, np.sin))
    return np.array(
        [
            cy * cp * cr + sy * sp * sr,
            cy * cp * sr - sy * sp * cr,
            cy * sp * cr + sy * cp * sr,
            sy * cp * cr - cy * sp * sr,
        ]
    )


@given(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1))
def test_the_yaw_does_not_depend_on_pitch_and_roll(yaw, pitch, roll):
    # At a pitch of 1.5 rad the nose points up to 0.07: rounding is magnified by 14.
    assert wrap_angle(yaw_of(attitude(yaw, pitch, roll)) - yaw) == pytest.approx(0.0, abs=1e-13)


def test_at_a_quarter_turn_to_port_west_is_ahead_and_north_is_to_starboard():
    quarter = np.array(np.pi / 2)
    np.testing.assert_allclose(rotate_to_body(np.array([3.0, 2.0]), quarter), [2.0, -3.0], atol=1e-15)
    np.testing.assert_allclose(rotate_to_world(np.array([2.0, -3.0]), quarter), [3.0, 2.0], atol=1e-15)


def test_a_half_turn_is_wrapped_to_minus_pi():
    np.testing.assert_allclose(
        wrap_angle(np.array([np.pi, -np.pi, 7.0, -7.0])), [-np.pi, -np.pi, 7 - 2 * np.pi, 2 * np.pi - 7]
    )
