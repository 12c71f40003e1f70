import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import cumulative_trapezoid
from scipy.linalg import expm
from whole_model import whole

from controllers.ltv import SUBSYSTEMS, WHOLE, Linearisation, shift
from controllers.model import Model, advance

PERIOD, K_I, N = 0.02, 2.0, 19
MODEL = Model()
seeds = st.integers(0, 2**32 - 1)


def along(coupling="full", discretisation="euler", period=PERIOD):
    return Linearisation(MODEL, K_I, period, coupling, discretisation)


def flying(seed, steps=N):
    """A state, inputs and a reference path as random as a flight within the limits can be."""
    rng = np.random.default_rng(seed)
    x0 = rng.uniform(-1, 1, 10) * [1, 1, 1, 10, 3, 3, 2, 25, 0.5, 0.5]
    u = rng.uniform(MODEL.u_min, MODEL.u_max, (steps, 4))
    return x0, u, rng.uniform(-1, 1, (steps + 1, 2))


@given(seeds, st.integers(1, 40))
@settings(max_examples=50)
def test_the_rollout_is_the_model_flown_step_by_step(seed, steps):
    x0, u, xy_ref = flying(seed, steps)
    flown = along().rollout(x0, u, xy_ref)
    x = tuple(x0[:8])
    np.testing.assert_array_equal(flown[0], x0)
    for k in range(steps):
        x = advance(MODEL, x, tuple(u[k]), PERIOD)
        # The same arithmetic, at most in another order: yaw up to 30 rad.
        np.testing.assert_allclose(flown[k + 1, :8], x, rtol=0, atol=1e-12)


@given(seeds)
@settings(max_examples=50)
def test_the_integral_states_are_trapezoids_of_the_error(seed):
    x0, u, xy_ref = flying(seed)
    flown = along().rollout(x0, u, xy_ref)
    area = cumulative_trapezoid(K_I * (flown[:, :2] - xy_ref), dx=PERIOD, axis=0, initial=0)
    # Sums of twenty terms below 1 m s.
    np.testing.assert_allclose(flown[:, 8:], x0[8:] + area, rtol=0, atol=1e-14)


@given(seeds, st.sampled_from(["removed", "full"]), st.floats(0.001, PERIOD))
@settings(max_examples=50)
def test_exact_discretisation_is_the_matrix_exponential(seed, coupling, period):
    x = np.stack([flying(seed + i)[0] for i in range(3)])
    exact = along(coupling, "exact", period)
    AB = exact.jacobians(x)
    found = exact.discretise(AB)
    for k in range(3):
        held = expm(period * np.block([[AB[k]], [np.zeros((4, 14))]]))
        # Both are good to a few digits of entries of order 1.
        np.testing.assert_allclose(found[k], held[:10], rtol=0, atol=1e-13)


def test_euler_is_the_first_order_of_exact():
    x = flying(3)[0][None]
    AB = along().jacobians(x)
    # (17) to the letter: one product and one sum.
    for euler in along().discretise(AB), along().matrices(x, WHOLE):
        np.testing.assert_allclose(euler[0], np.eye(10, 14) + PERIOD * AB[0], rtol=0, atol=1e-15)
    off = []
    for period in (1e-3, 0.5e-3):
        euler, exact = along(period=period), along(discretisation="exact", period=period)
        difference = np.abs(euler.discretise(AB) - exact.discretise(AB))
        off.append([difference[..., :10].max(), difference[..., 10:].max()])
    # What is left is of second order: a quarter at half the period, and 2 % of third order (25 rad/s times 1 ms).
    np.testing.assert_allclose(np.divide(*off), 4.0, rtol=0.03)


def prediction(ltv, u, coupling="full"):
    A, B = whole(ltv, SUBSYSTEMS[coupling])
    x = [ltv.x_nominal[0]]
    for k in range(len(u)):
        x.append(ltv.x_nominal[k + 1] + A[k] @ (x[k] - ltv.x_nominal[k]) + B[k] @ (u[k] - ltv.u_nominal[k]))
    return np.array(x)


@given(seeds, st.sampled_from(["removed", "full"]), st.sampled_from(["euler", "exact"]))
@settings(max_examples=30)
def test_the_linear_model_passes_through_the_nominal_flight(seed, coupling, discretisation):
    x0, u, xy_ref = flying(seed)
    ltv = along(coupling, discretisation)(x0, u, xy_ref)
    np.testing.assert_array_equal(ltv.x_nominal, along().rollout(x0, u, xy_ref))
    np.testing.assert_array_equal(prediction(ltv, u, coupling), ltv.x_nominal)


@given(seeds)
@settings(max_examples=30)
def test_along_steady_flight_the_error_is_of_second_order_in_the_input(seed):
    """There the Jacobian stands still between two samples, and exact discretisation is the derivative of the flight."""
    rng = np.random.default_rng(seed)
    vx, vy = rng.uniform(-2, 2, 2)
    x0 = np.array([*rng.uniform(-1, 1, 3), rng.uniform(-3, 3), vx, vy, 0, 0, 0, 0])
    steady = (-MODEL.k_x * vx / MODEL.b_x, -MODEL.k_y * vy / MODEL.b_y, MODEL.u_hover[2], 0.0)
    u, xy_ref = np.tile(steady, (N, 1)), np.zeros((N + 1, 2))
    ltv = along("full", "exact")(x0, u, xy_ref)
    du = rng.uniform(-0.02, 0.02, (N, 4))
    errors = []
    for scale in (1.0, 0.5):
        flown = along().rollout(x0, u + scale * du, xy_ref)
        # The integral states are trapezoids, which differ from the exact integral in the first order.
        errors.append(np.abs(flown - prediction(ltv, u + scale * du))[:, :8].max())
    # A quarter; the third order adds up to 0.1, a turn of rad, times its share.
    assert 3.5 < errors[0] / errors[1] < 4.5


@pytest.mark.parametrize("discretisation", ["euler", "exact"])
def test_along_any_flight_the_error_of_the_slope_shrinks_with_the_period(discretisation):
    off = []
    for refine in (10, 20):
        x0, u, xy_ref = flying(5)
        u, xy_ref, period = np.repeat(u, refine, axis=0), np.zeros((N * refine + 1, 2)), PERIOD / refine
        du = 1e-5 * np.repeat(flying(6)[1], refine, axis=0)
        ltv = along("full", discretisation, period)(x0, u, xy_ref)
        up, down = (along(period=period).rollout(x0, u + s * du, xy_ref) for s in (1, -1))
        slope = prediction(ltv, u + du) - ltv.x_nominal
        off.append(np.abs(0.5 * (up - down) - slope)[-1].max())
    # First order: half at half the period, and a tenth of that in higher orders.
    assert off[0] / off[1] == pytest.approx(2.0, rel=0.1)


def test_removed_coupling_does_not_see_what_yaw_does_to_the_path():
    x0, u, xy_ref = flying(7)
    turned = u + np.array([0, 0, 0, 0.01])
    removed, full = (prediction(along(coupling)(x0, u, xy_ref), turned, coupling) for coupling in ("removed", "full"))
    nominal = along().rollout(x0, u, xy_ref)
    plane, rest = [0, 1, 4, 5, 8, 9], [2, 3, 6, 7]
    np.testing.assert_array_equal(removed[:, plane], nominal[:, plane])
    assert np.abs(full[:, plane] - nominal[:, plane]).max() > 1e-3
    np.testing.assert_array_equal(removed[:, rest], full[:, rest])


@given(seeds, st.integers(1, 40))
def test_the_shifted_plan_flies_the_rest_of_the_plan(seed, steps):
    x0, u, _ = flying(seed, steps)
    path, shifted = np.zeros((steps + 1, 2)), shift(u)
    # (25): the first input is flown, the last one is flown twice.
    np.testing.assert_array_equal(shifted[:-1], u[1:])
    np.testing.assert_array_equal(shifted[-1], u[-1])
    flown = along().rollout(x0, u, path)
    again = along().rollout(flown[1], shifted, path)
    # Integral states add up from another start: rounding.
    np.testing.assert_allclose(again[:-1], flown[1:], rtol=0, atol=1e-14)


@given(seeds, st.sampled_from(["removed", "full"]), st.sampled_from(["euler", "exact"]))
@settings(max_examples=30)
def test_no_part_acts_on_another(seed, coupling, method):
    x0, u, xy_ref = flying(seed)
    ltv, method_of = along(coupling, method)(x0, u, xy_ref), along(coupling, method)
    A, B = np.split(method_of.discretise(method_of.jacobians(ltv.x_nominal[:-1])), [10], axis=2)
    for subsystem, AB in zip(SUBSYSTEMS[coupling], ltv.parts, strict=True):
        own_A, own_B = np.split(AB, [len(subsystem.states)], axis=2)
        # The same sums, of products with fewer zeros.
        close = {"rtol": 0, "atol": 1e-13 if method == "exact" else 1e-15}
        np.testing.assert_allclose(own_A, A[:, subsystem.states[:, None], subsystem.states], **close)
        np.testing.assert_allclose(own_B, B[:, subsystem.states[:, None], subsystem.inputs], **close)
        assert not subsystem.constant or not np.ptp(AB, axis=0).any()
        np.testing.assert_array_equal(subsystem.states[subsystem.own_velocities], subsystem.velocities)
        A[:, subsystem.states[:, None], subsystem.states] = B[:, subsystem.states[:, None], subsystem.inputs] = 0.0
    # Nothing is left between the parts, to the last digit.
    assert not A.any()
    assert not B.any()
    assert sorted(np.concatenate([subsystem.states for subsystem in SUBSYSTEMS[coupling]])) == list(range(10))
    assert [*np.concatenate([subsystem.inputs for subsystem in SUBSYSTEMS[coupling]])] == [0, 1, 2, 3]
