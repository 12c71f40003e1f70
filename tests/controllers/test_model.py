from fractions import Fraction
from math import cos, exp, expm1, factorial, sin

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from controllers.ltv import Linearisation
from controllers.model import GRAVITY, Model, _yaw_response, advance, rates

PERIOD = 0.02
X = (0.3, -0.2, 1.0, 0.7, 0.5, -0.4, 0.1, 1.5)
U = (0.3, -0.2, 0.6, 0.1)


def between(low, high):
    return st.floats(low, high, allow_subnormal=False)


states = st.tuples(
    *[between(-3, 3)] * 3, between(-30, 30), between(-3, 3), between(-3, 3), between(-2, 2), between(-25, 25)
)
inputs = st.tuples(between(-1, 1), between(-1, 1), between(0, 1), between(-0.4, 0.4))
pushes = st.tuples(*[between(-1, 1)] * 3, between(-10, 10))
models = st.builds(
    Model,
    b_x=between(0.5, 5),
    k_x=between(-2, 0),
    b_y=between(0.5, 5),
    k_y=between(-2, 0),
    b_z=between(10, 30),
    b_yaw=between(10, 200),
    k_yaw=between(-20, 0),
)


def integrated(model, x, u, dt, push=(0.0, 0.0, 0.0, 0.0)):
    """The end of (1) with a further push (world), by an eighth-order method at nearly full precision."""

    def f(_, x):
        dx = np.array(rates(model, tuple(x), u))
        c, s = cos(x[3]), sin(x[3])
        dx[4:] += [c * push[0] + s * push[1], c * push[1] - s * push[0], push[2], push[3]]
        return dx

    return solve_ivp(f, (0.0, dt), x, method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]


@given(models, states, inputs, between(0.001, PERIOD), pushes)
def test_advance_is_the_integral_of_the_rates(model, x, u, dt, push):
    end = advance(model, x, u, dt, push)
    expected = integrated(model, x, u, dt, push)
    # Closed forms against rtol 1e-12 of a yaw of up to 31 rad.
    np.testing.assert_allclose(np.take(end, [2, 3, 6, 7]), expected[[2, 3, 6, 7]], rtol=0, atol=1e-10)
    # Simpson's error of a push of 17 m/s^2 (full stick, drag, push) that turns by 0.6 rad: 17 dt 0.6^4 / 2880 = 1.5e-5.
    np.testing.assert_allclose(end, expected, rtol=0, atol=2e-5)


@pytest.mark.parametrize("k", [-0.99e-3, -1.01e-3, -1e-4, -1e-9, 0.0])
def test_slow_damping_of_the_yaw_keeps_its_digits(k):
    """Where the closed form loses digits the series stand: r' = k r over 0.1 s, against exact fractions."""
    t = Fraction(1, 10)
    terms = [Fraction(k) ** n * t ** (n + 1) / factorial(n + 1) for n in range(12)]
    gain = float(sum(terms))
    turn = float(sum(t * term / (n + 2) for n, term in enumerate(terms)))
    # The series leave out h^3 / 24 and h^3 / 60 of it, h = 1e-4 at most.
    assert _yaw_response(k, 0.1) == pytest.approx((gain, turn), rel=5e-13 if k > -1e-3 else 1e-11)


def test_the_error_shrinks_with_the_fourth_power_of_the_step():
    x, u, over = (0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 10.0), (1.0, -1.0, 0.5, 0.2), 0.4
    truth = integrated(Model(), x, u, over)
    errors = []
    for steps in (10, 20):
        end = x
        for _ in range(steps):
            end = advance(Model(), end, u, over / steps)
        errors.append(np.abs(np.array(end) - truth).max())
    # 2^4 = 16, and what is left of the fifth order at a turn of 0.5 rad a step.
    assert 12 < errors[0] / errors[1] < 20


@given(inputs, between(0.001, PERIOD), between(-3, 3))
def test_straight_flight_settles_exponentially(u, dt, v):
    model = Model()
    end = advance(model, (0, 0, 1, 0, v, 0, 0, 0), (u[0], 0.0, u[2], 0.0), dt)
    steady = -model.b_x * u[0] / model.k_x
    # The fifth-order term of exp(k dt) is (0.5 * 0.02)^5 / 120 = 1e-12, times up to 7 m/s.
    assert end[4] == pytest.approx(steady + (v - steady) * exp(model.k_x * dt), abs=1e-11)
    assert end[0] == pytest.approx(steady * dt + (v - steady) * expm1(model.k_x * dt) / model.k_x, abs=1e-11)
    # Nothing sideways: sin(0) is exactly 0.
    assert (end[1], end[3], end[5], end[7]) == (0, 0, 0, 0)


@given(inputs, between(0.001, 10))
def test_yaw_settles_at_gain_over_damping(u, dt):
    model = Model()
    *_, yaw, _, _, _, r = advance(model, (0, 0, 1, 0, 0, 0, 0, 0), (0, 0, u[2], u[3]), dt)
    steady = -model.b_yaw * u[3] / model.k_yaw
    # Closed forms of at most 90 rad.
    assert r == pytest.approx(-steady * expm1(model.k_yaw * dt), abs=1e-12)
    assert yaw == pytest.approx(steady * (dt + -expm1(model.k_yaw * dt) / model.k_yaw), abs=1e-12)


@given(between(0, 1), between(0.001, 10), between(-2, 2))
def test_height_is_a_parabola(u_z, dt, vz):
    end = advance(Model(), (0, 0, 1, 0, 0, 0, vz, 0), (0, 0, u_z, 0), dt)
    a = 18 * u_z - GRAVITY
    # Rounding of terms of up to 500 m.
    assert end[2] == pytest.approx(1 + vz * dt + 0.5 * a * dt**2, abs=1e-11)
    assert end[6] == pytest.approx(vz + a * dt, abs=1e-12)


@given(st.sampled_from([0.0, *(-(10.0**-n) for n in range(3, 17))]), between(0.001, PERIOD))
@example(k_yaw=0.0, dt=PERIOD)
def test_yaw_without_damping_is_the_limit_of_little_damping(k_yaw, dt):
    r, u_yaw = 2.0, 0.3
    *_, yaw, _, _, _, r_end = advance(Model(k_yaw=k_yaw), (0, 0, 1, 0, 0, 0, 0, r), (0, 0, 0.5, u_yaw), dt)
    a, h = 111 * u_yaw + k_yaw * r, k_yaw * dt
    # The Taylor series up to h^2; the next term is h^3 / 120 of a dt^2, 1e-17 at most. Cancellation costs a closed form
    # 2e-16 / h of a dt^2 = 0.013 rad: everything below h = 2e-6 has to be computed in another way.
    assert yaw == pytest.approx(r * dt + a * dt**2 * (1 / 2 + h / 6 + h**2 / 24), abs=1e-12)
    assert r_end == pytest.approx(r + a * dt * (1 + h / 2 + h**2 / 6), abs=1e-12)


@given(states, pushes, between(0.001, PERIOD))
def test_a_push_accelerates_in_the_world(x, push, dt):
    """Without drag and sticks the helicopter may turn as it likes."""
    end = advance(Model(k_x=0.0, k_y=0.0), x, Model().u_hover, dt, push)
    v_start, v_end = in_the_world(x), in_the_world(end)
    # A constant push has no integration error: rounding only.
    np.testing.assert_allclose(np.subtract(v_end, v_start), np.multiply(push[:2], dt), rtol=0, atol=1e-13)
    moved = np.multiply(v_start, dt) + np.multiply(push[:2], 0.5 * dt**2)
    np.testing.assert_allclose(np.subtract(end[:2], x[:2]), moved, rtol=0, atol=1e-13)


def in_the_world(x):
    return cos(x[3]) * x[4] - sin(x[3]) * x[5], sin(x[3]) * x[4] + cos(x[3]) * x[5]


@given(models, states, inputs, between(-7, 7))
def test_a_turned_start_turns_the_flight(model, x, u, angle):
    c, s = cos(angle), sin(angle)

    def turn(x):
        return (c * x[0] - s * x[1], s * x[0] + c * x[1], x[2], x[3] + angle, *x[4:])

    # Rounding: sines of angles up to 40 rad are good to 1e-14.
    np.testing.assert_allclose(
        advance(model, turn(x), u, PERIOD), turn(advance(model, x, u, PERIOD)), rtol=0, atol=1e-12
    )


@given(models, states, inputs)
def test_a_mirrored_start_mirrors_the_flight(model, x, u):
    port_to_starboard = np.array([1, -1, 1, -1, 1, -1, 1, -1])
    sticks = np.array([1, -1, 1, -1])
    mirrored = advance(model, tuple(port_to_starboard * x), tuple(sticks * u), PERIOD)
    # The same products with other signs: rounding only.
    np.testing.assert_allclose(mirrored, port_to_starboard * advance(model, x, u, PERIOD), rtol=0, atol=1e-14)


@given(models, states, inputs, between(0.001, PERIOD), between(0.001, PERIOD))
def test_height_and_yaw_do_not_depend_on_how_time_is_cut(model, x, u, first, second):
    once = advance(model, x, u, first + second)
    twice = advance(model, advance(model, x, u, first), u, second)
    # Both are exact; yaw of up to 31 rad, and what cancellation in the closed form leaves at little damping.
    np.testing.assert_allclose(np.take(twice, [2, 3, 6, 7]), np.take(once, [2, 3, 6, 7]), rtol=0, atol=1e-12)


@given(models, between(-3, 3), between(-3, 3), between(-30, 30), between(0.001, 10))
def test_hover_is_an_equilibrium(model, x, y, yaw, dt):
    still = (x, y, 1.0, yaw, 0.0, 0.0, 0.0, 0.0)
    # b_z (g / b_z) - g is the rounding of g, 2e-15 m/s^2, here for up to 10 s.
    np.testing.assert_allclose(rates(model, still, model.u_hover), np.zeros(8), rtol=0, atol=4e-15)
    np.testing.assert_allclose(advance(model, still, model.u_hover, dt), still, rtol=0, atol=2e-13)


def test_the_parameters_are_the_paper_s():
    # Kunz, Huck, Summers, ECC 2013, (27).
    model = Model()
    assert (model.b_x, model.k_x, model.b_y, model.k_y) == (2.0, -0.5, 2.1, -0.4)
    assert (model.b_z, model.b_yaw, model.k_yaw) == (18.0, 111.0, -5.0)


def test_the_limits_are_the_paper_s_in_an_order_that_can_hover():
    model = Model()
    # (28) and (29), which is printed in the order x y yaw z.
    assert model.v_max == (3.0, 3.0, 2.0, 25.0)
    assert model.u_min == (-1.0, -1.0, 0.0, -0.4)
    assert model.u_max == (1.0, 1.0, 1.0, 0.4)
    assert all(low < u < high for low, u, high in zip(model.u_min, model.u_hover, model.u_max, strict=True))


K_I = 2.0


def flow(model, x, u):
    """(1) with its integral states, reference at the origin."""
    return np.array([*rates(model, tuple(x[:8]), tuple(u)), K_I * x[0], K_I * x[1]])


def slopes(f, at):
    """Central differences of `f` along every axis: error h^2 / 6 times the third derivative, and rounding 1e-16 / h."""
    h = 1e-5
    return np.stack([(f(at + h * e) - f(at - h * e)) / (2 * h) for e in np.eye(len(at))], axis=1)


@given(models, states, inputs)
@settings(max_examples=50)
def test_the_jacobians_are_the_slopes_of_the_rates(model, x, u):
    x, u = np.array([*x, 0.3, -0.1]), np.array(u)
    A, B = np.split(Linearisation(model, K_I, PERIOD, "full", "euler").jacobians(x[None]), [10], axis=2)
    # h^2 / 6 of 5 m/s and rounding of rates of up to 200 rad/s^2, both below 1e-8.
    np.testing.assert_allclose(A[0], slopes(lambda x: flow(model, x, u), x), rtol=0, atol=1e-8)
    np.testing.assert_allclose(B[0], slopes(lambda u: flow(model, x, u), u), rtol=0, atol=1e-8)


@given(models, states, states)
def test_removed_coupling_leaves_out_six_entries_and_nothing_else(model, x1, x2):
    x = np.array([[*x1, 0.0, 0.0], [*x2, 0.0, 0.0]])
    full = Linearisation(model, K_I, PERIOD, "full", "euler").jacobians(x)
    removed = Linearisation(model, K_I, PERIOD, "removed", "euler").jacobians(x)
    # Rows x and y (position, body velocity) by yaw and yaw rate, and the yaw rate between vx and vy.
    rows, columns = [0, 1, 4, 4, 5, 5], [3, 3, 5, 7, 4, 7]
    assert not removed[:, rows, columns].any()
    full[:, rows, columns] = 0.0
    np.testing.assert_array_equal(removed, full)
