import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from controllers.flatness import FlatOutput, feed_forward, state
from controllers.model import GRAVITY, Model, rates

amplitudes = st.lists(st.floats(-1, 1), min_size=4, max_size=4).map(np.array)
rate = st.floats(0.1, 3)
times = st.floats(0, 10)
models = st.builds(
    Model,
    b_x=st.floats(0.5, 5),
    k_x=st.floats(-2, 0),
    b_y=st.floats(0.5, 5),
    k_y=st.floats(-2, 0),
    b_z=st.floats(10, 30),
    b_yaw=st.floats(10, 200),
    k_yaw=st.floats(-20, 0),
)


class Wave:
    """A flat output that swings in all four axes and turns on and on."""

    def __init__(self, a, b, w):
        self._a, self._b, self._w = a, b, w * np.array([1.0, 1.3, 0.7, 1.9])

    def __call__(self, t):
        phase = self._w * np.asarray(t)[..., None]
        c, s, w = np.cos(phase), np.sin(phase), self._w
        a, b, turning = self._a, self._b, np.array([0, 0, 0, 1.5])
        return FlatOutput(
            a * c + b * s + turning * np.asarray(t)[..., None], w * (b * c - a * s) + turning, -(w**2) * (a * c + b * s)
        )


@given(models, amplitudes, amplitudes, rate, times)
def test_a_flat_reference_satisfies_the_dynamics(model, a, b, w, t):
    wave, h = Wave(a, b, w), 1e-5
    x, u = state(wave(t)), feed_forward(model, wave(t))
    slope = (state(wave(t + h)) - state(wave(t - h))) / (2 * h)
    # A central difference: h^2 / 6 = 2e-11 times a third derivative of up to 6^4, and rounding 1e-15 / h.
    np.testing.assert_allclose(rates(model, tuple(x), tuple(u)), slope, rtol=0, atol=1e-7)


@given(models, st.floats(-5, 5))
def test_thrust_carries_the_weight(model, climb):
    """(5) is printed with the wrong sign of g."""
    still = np.zeros(4)
    at_rest, climbing = (
        feed_forward(model, FlatOutput(still, still, np.array([0, 0, ddz, 0]))) for ddz in (0.0, climb)
    )
    # One addition and one division.
    assert at_rest[2] == pytest.approx(GRAVITY / model.b_z, rel=1e-15)
    assert climbing[2] - at_rest[2] == pytest.approx(climb / model.b_z, abs=1e-15)
    assert not at_rest[[0, 1, 3]].any()


@given(models, amplitudes, amplitudes, rate, times, st.floats(-7, 7))
def test_a_turned_room_needs_the_same_inputs(model, a, b, w, t, angle):
    flat = Wave(a, b, w)(t)
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    turned = FlatOutput(turn @ flat.z + [0, 0, 0, angle], turn @ flat.dz, turn @ flat.ddz)
    # Rounding: inputs of up to 70, sines of angles up to 40 rad are good to 1e-14.
    np.testing.assert_allclose(feed_forward(model, turned), feed_forward(model, flat), rtol=0, atol=1e-11)
    np.testing.assert_allclose(state(turned)[4:], state(flat)[4:], rtol=0, atol=1e-12)


def test_many_times_at_once_are_one_after_the_other():
    wave, t = Wave(np.full(4, 0.5), np.arange(4.0), 1.1), np.linspace(0, 5, 12).reshape(3, 4)
    together, one_by_one = wave(t), [wave(single) for single in t.ravel()]
    # Vectorised sines may differ in their last digit.
    np.testing.assert_allclose(state(together).reshape(-1, 8), [state(flat) for flat in one_by_one], atol=1e-14)
    np.testing.assert_allclose(
        feed_forward(Model(), together).reshape(-1, 4), [feed_forward(Model(), f) for f in one_by_one], atol=1e-14
    )
