import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from controllers.model import Model, advance, rates
from heli_twin.lab.plant import STILL_AIR, Air, is_whole_nanoseconds, physical_state
from heli_twin.lab.plant.ideal import Ideal

MS = 1_000_000
X = np.array([0.3, -0.2, 1.0, 0.7, 0.5, -0.4, 0.1, 1.5])
U = np.array([0.3, -0.2, 0.6, 0.1])

inputs = st.tuples(*[st.floats(-1, 1)] * 2, st.floats(0, 1), st.floats(-0.4, 0.4)).map(np.array)


def test_hover_is_an_equilibrium():
    plant = Ideal().start(np.array([0, 0, 1, 0.3, 0, 0, 0, 0]))
    plant.advance(10_000 * MS, np.array(Model().u_hover), STILL_AIR)
    # b_z (g / b_z) - g is rounding, 2e-15 m/s^2, over 10 s.
    np.testing.assert_allclose(physical_state(plant.truth()), [0, 0, 1, 0.3, 0, 0, 0, 0], atol=1e-12)
    assert plant.truth().stamp == 10_000 * MS


def test_it_is_upright_and_turns_about_its_mast():
    truth = Ideal().start(X).truth()
    np.testing.assert_allclose(truth.quat_wxyz, (np.cos(0.35), 0.0, 0.0, np.sin(0.35)))
    np.testing.assert_array_equal(truth.angular_velocity, (0.0, 0.0, 1.5))


def test_one_step_is_the_model_to_the_last_digit():
    plant = Ideal(step=0.02).start(X)
    plant.advance(20 * MS, U, STILL_AIR)
    expected = advance(Model(), tuple(X), tuple(U), 0.02)
    # Truth gives velocities in the world; turning there and back is rounding.
    np.testing.assert_allclose(physical_state(plant.truth()), expected, rtol=0, atol=1e-15 * 8)


@given(inputs)
def test_a_control_period_is_the_model_s_prediction(u):
    plant = Ideal().start(X)
    plant.advance(20 * MS, u, STILL_AIR)
    # One Runge-Kutta step of 20 ms against twenty of 1 ms: the longer one's error, (r dt)^5 / 120.
    np.testing.assert_allclose(physical_state(plant.truth()), advance(Model(), tuple(X), tuple(u), 0.02), atol=1e-8)


@given(inputs, st.lists(st.integers(0, 60), min_size=1, max_size=5), st.sampled_from([0.0, 1.0]))
def test_a_flight_in_pieces_is_the_flight_at_once(u, stops, blows):
    air = Air(blows * np.array([0.4, -0.3, 0.2]), np.array([0.1, 0.05, 0.0]), 0.97)
    once, pieces = Ideal().start(X), Ideal().start(X)
    once.advance(60 * MS, u, air)
    for ms in [*sorted(stops), 60]:
        pieces.advance(ms * MS, u, air)
    for a, b in zip(once.truth(), pieces.truth(), strict=True):
        np.testing.assert_array_equal(a, b)


def test_its_derivative_is_the_model_s():
    plant = Ideal(step=1e-5).start(X)
    plant.advance(10_000, U, STILL_AIR)
    slope = (physical_state(plant.truth()) - X) / 1e-5
    # A forward difference: half the step times the second derivative, about 20 1/s^2 in yaw.
    np.testing.assert_allclose(slope, rates(Model(), tuple(X), tuple(U)), atol=1e-3)


def test_steady_wind_is_a_moving_frame():
    wind = np.array([0.8, -0.5, 0.0])
    still, windy = Ideal().start(X), Ideal().start(_moving(X, wind))
    for k in range(1, 101):
        u = np.array([0.5 * np.sin(0.1 * k), 0.3, 0.55, 0.2])
        still.advance(20 * k * MS, u, STILL_AIR)
        windy.advance(20 * k * MS, u, Air(wind, np.zeros(3)))
    a, b = still.truth(), windy.truth()
    # The same arithmetic but for a sum and a difference in each of 2000 steps.
    np.testing.assert_allclose(b.velocity - wind, a.velocity, atol=1e-12)
    np.testing.assert_allclose(b.position - 2.0 * wind, a.position, atol=1e-12)


def test_push_and_thrust_factor_accelerate():
    plant = Ideal().start(np.array([0, 0, 1, 0.3, 0, 0, 0, 0]))
    air = Air(np.zeros(3), np.array([0.0, 0.0, 0.2]), 0.9)
    plant.advance(1000 * MS, np.array(Model().u_hover), air)
    # Constant acceleration, integrated in closed form.
    assert plant.truth().velocity[2] == pytest.approx(0.2 - 0.1 * 9.81, abs=1e-12)


def test_the_parameters_are_its_own():
    plant = Ideal(model=Model(b_z=20.0)).start(X)
    plant.advance(1000 * MS, np.array([0, 0, 0.5, 0]), STILL_AIR)
    # Constant acceleration, integrated in closed form.
    assert plant.truth().velocity[2] == pytest.approx(X[6] + 10.0 - 9.81, abs=1e-12)


def test_the_sticks_clip_what_they_are_asked():
    plant = Ideal().start(X)
    plant.advance(20 * MS, np.array([3.0, -2.0, -1.0, 5.0]), STILL_AIR)
    np.testing.assert_array_equal(plant.truth().actuators, [1.0, -1.0, 0.0, 1.0])


def test_the_floor_is_reported():
    plant = Ideal().start(np.array([0, 0, 0.1, 0, 0, 0, 0, 0]))
    assert not plant.truth().touching
    plant.advance(200 * MS, np.zeros(4), STILL_AIR)
    assert plant.truth().touching


@pytest.mark.parametrize(("until", "u"), [(1_500_000, U), (-MS, U), (MS, np.array([0, np.nan, 0, 0]))])
def test_what_cannot_be_flown_is_refused(until, u):
    with pytest.raises(ValueError, match=r"until|finite"):
        Ideal().start(X).advance(until, u, STILL_AIR)


def test_a_step_is_whole_nanoseconds():
    with pytest.raises(ValueError, match="whole number of nanoseconds"):
        Ideal(step=1 / 3000)
    # A thousandth of a nanosecond is rounding.
    assert is_whole_nanoseconds(0.001 + 0.9e-12)
    assert not is_whole_nanoseconds(0.001 + 1.1e-12)


def _moving(x, wind):
    """The state x with the velocity `wind` (world) added."""
    c, s = np.cos(x[3]), np.sin(x[3])
    turned = np.array([c * wind[0] + s * wind[1], c * wind[1] - s * wind[0], wind[2]])
    return x + np.concatenate([np.zeros(4), turned, np.zeros(1)])
