"""The detailed model: its equations, its linear model, its reference, and the paper's model as its limit."""

from math import cos, sin

import numpy as np
import pytest
from whole_model import whole

from controllers.condensed_qp import StepByStep, Weights
from controllers.detailed_flatness import HIGHEST_DERIVATIVE, PreparedReference, detailed_reference
from controllers.detailed_ltv import HEIGHT_AND_YAW, PLANE, DetailedLinearisation, Disturbances
from controllers.detailed_model import N_DETAILED, DetailedModel, exponential
from controllers.model import GRAVITY, Model, simulator
from controllers.signals import Array
from controllers.trajectories import Trajectory, derivatives
from controllers.trajectories.circle import Circle
from controllers.trajectories.ferris_wheel import FerrisWheel
from controllers.trajectories.lemniscate import Lemniscate

MODEL = DetailedModel(hub_drag=1.4, pitch_frequency=12.0)
ACTING = Disturbances(np.array([0.1, -0.07]), np.array([0.03, -0.02]), np.array([0.1, -0.05, 0.2, 1.0]))
CALM = Disturbances(np.zeros(2), np.zeros(2), np.zeros(4))
RNG = np.random.default_rng(15)


def rates(m: DetailedModel, x: Array, u: Array, gust: Array, acting: Disturbances) -> Array:
    """The equations of the model as its documentation has them, written out one by one."""
    yaw, vx, vy, vz, r = x[3], x[4], x[5], x[6], x[7]
    c, s = cos(yaw), sin(yaw)
    gx, gy = c * gust[0] + s * gust[1], c * gust[1] - s * gust[0]
    px, py = c * acting.push[0] + s * acting.push[1], c * acting.push[1] - s * acting.push[0]
    ax, jx, sx, ay, jy, sy, thrust, torque = x[8:]
    wx, wy, damping = m.pitch_frequency, m.roll_frequency, 2.0 * m.attitude_damping
    x_moment = m.b_x * (sx + acting.trim[0]) - ax + m.hub_drag * (m.k_x * vx + gx)
    y_moment = m.b_y * (sy + acting.trim[1]) - ay + m.hub_drag * (m.k_y * vy + gy)
    return np.array([
        c * vx - s * vy,
        s * vx + c * vy,
        vz,
        r,
        m.k_x * vx + ax + gx + px + r * vy,
        m.k_y * vy + ay + gy + py - r * vx,
        thrust - GRAVITY + acting.push[2],
        torque + m.k_yaw * r + acting.push[3],
        jx,
        wx * wx * x_moment - damping * wx * jx,
        (u[0] - sx) / m.servo_lag,
        jy,
        wy * wy * y_moment - damping * wy * jy,
        (u[1] - sy) / m.servo_lag,
        (m.b_z * u[2] - thrust) / m.thrust_lag,
        (m.b_yaw * u[3] - torque) / m.yaw_lag,
    ])  # fmt: skip


def integrated(m: DetailedModel, x: Array, u: Array, acting: Disturbances, period: float = 0.02) -> Array:
    """The states after each period, by Runge-Kutta 4 in steps of 1 ms."""
    states, h, gust, fade = [x], 0.001, acting.gust, np.exp(-0.0005 / m.gust_time)
    for held in u:
        for _ in range(round(period / h)):
            middle, end = gust * fade, gust * fade * fade
            k1 = rates(m, x, held, gust, acting)
            k2 = rates(m, x + 0.5 * h * k1, held, middle, acting)
            k3 = rates(m, x + 0.5 * h * k2, held, middle, acting)
            k4 = rates(m, x + h * k3, held, end, acting)
            x, gust = x + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4), end
        states.append(x)
    return np.array(states)


def some_flight(turning: float) -> tuple[Array, Array]:
    x0 = 0.3 * RNG.standard_normal(N_DETAILED)
    x0[7], x0[14] = turning, GRAVITY
    u = np.array([0.0, 0.0, 0.55, 0.0]) + RNG.uniform(-0.2, 0.2, (19, 4)) * [1, 1, 0.3, 0.1]
    return x0, u


def test_the_nominal_trajectory_solves_the_equations() -> None:
    """Each period is taken at its middle heading: while it turns, the error falls with the square of the period."""
    for turning in (0.0, 1.0, -2.0):
        x0, u = some_flight(turning)
        exact = integrated(MODEL, x0, u, ACTING)
        coarse = DetailedLinearisation(MODEL, 0.02, len(u))(x0, u, ACTING).x_nominal
        fine = DetailedLinearisation(MODEL, 0.005, 4 * len(u))(x0, np.repeat(u, 4, axis=0), ACTING).x_nominal[::4]
        assert np.abs(coarse - exact)[:, :8].max() < 1e-4
        assert np.abs(fine - exact).max() < 0.08 * np.abs(coarse - exact).max() + 1e-6


def test_without_turning_the_nominal_trajectory_is_exact() -> None:
    x0, u = some_flight(0.0)
    x0[15], u[:, 3] = 0.0, 0.0
    calm = ACTING._replace(push=np.array([0.1, -0.05, 0.2, 0.0]))
    nominal = DetailedLinearisation(MODEL, 0.02, len(u))(x0, u, calm).x_nominal
    np.testing.assert_allclose(nominal, integrated(MODEL, x0, u, calm), atol=2e-7)


def test_the_jacobians_are_those_of_the_equations() -> None:
    x0, u = some_flight(1.0)
    A, B = whole(DetailedLinearisation(MODEL, 0.02, 1)(x0, u[:1], ACTING), (PLANE, HEIGHT_AND_YAW))
    before = integrated(MODEL, x0, u[:1], ACTING)[1]
    for state in (*PLANE.states, 2, 3, 6, 7, 14, 15):
        ahead = x0.copy()
        ahead[state] += 1e-4
        slope = (integrated(MODEL, ahead, u[:1], ACTING)[1] - before) / 1e-4
        if state in (3, 7, 15):
            # The coupling that the paper leaves out too: heading and yaw rate on the horizontal motion.
            slope[PLANE.states] = 0.0
        np.testing.assert_allclose(A[0][:, state], slope, atol=2e-3, err_msg=str(state))
    for k in range(4):
        more = u[:1].copy()
        more[0, k] += 1e-4
        slope = (integrated(MODEL, x0, more, ACTING)[1] - before) / 1e-4
        if k == 3:
            slope[PLANE.states] = 0.0
        np.testing.assert_allclose(B[0][:, k], slope, atol=2e-3, err_msg=str(k))


def test_the_papers_model_is_its_limit() -> None:
    x0, u = some_flight(1.0)
    differences = []
    for fast in (1.0, 4.0, 16.0):
        model = DetailedModel(
            pitch_frequency=60 * fast, roll_frequency=60 * fast, attitude_damping=1.0,
            servo_lag=4e-3 / fast, thrust_lag=4e-3 / fast, yaw_lag=4e-3 / fast,
        )  # fmt: skip
        x0[8:] = [2.0 * u[0, 0], 0.0, u[0, 0], 2.1 * u[0, 1], 0.0, u[0, 1], 18.0 * u[0, 2], 111.0 * u[0, 3]]
        detailed = DetailedLinearisation(model, 0.02, len(u))(x0, u, CALM).x_nominal[-1, :8]
        px, py, pz, yaw, vx, vy, vz, r = x0[:8].tolist()
        paper = simulator(Model(), 0.02)((px, py, pz, yaw, vx, vy, vz, r), u.tolist(), (0.0, 0.0, 0.0, 0.0))[-1]
        differences.append(np.abs(detailed - paper).max())
    assert differences[1] < 0.4 * differences[0]
    assert differences[2] < 0.4 * differences[1]
    assert differences[2] < 0.02


@pytest.mark.parametrize("trajectory", [Circle(), Lemniscate(), FerrisWheel()], ids=lambda t: t.kind)
def test_the_reference_inputs_fly_the_reference_states(trajectory: Trajectory) -> None:
    h, steps = 0.001, 1500
    flat = derivatives(trajectory, 5.0 + h * np.arange(steps + 1), HIGHEST_DERIVATIVE)
    acting = ACTING._replace(gust=np.zeros(2))
    x, u = detailed_reference(MODEL, flat, acting)
    flown = DetailedLinearisation(MODEL, h, steps)(x[0], u, acting).x_nominal
    np.testing.assert_allclose(flown, x, atol=1e-3)
    np.testing.assert_allclose(flown[:, :4], x[:, :4], atol=2e-6)


def test_the_matrix_exponential_is_that_of_scipy() -> None:
    from scipy.linalg import expm

    for size in (1e-6, 0.3, 4.0, 300.0):
        M = size * RNG.standard_normal((7, 7))
        np.testing.assert_allclose(exponential(M), expm(M), rtol=1e-9 * max(size, 1.0), atol=1e-12 * abs(expm(M)).max())
    np.testing.assert_array_equal(exponential(np.zeros((3, 3))), np.eye(3))


def test_a_papers_model_gets_the_defaults_of_the_detailed_one() -> None:
    detailed = DetailedModel.of(Model(b_x=1.7))
    assert (detailed.b_x, detailed.servo_lag) == (1.7, 0.03)
    assert DetailedModel.of(MODEL) is MODEL


def test_the_prepared_reference_is_the_reference() -> None:
    flat = derivatives(Lemniscate(), np.linspace(0.0, 3.0, 40), HIGHEST_DERIVATIVE)
    reference = PreparedReference(MODEL)
    prepared = reference.prepare(flat)
    # Linear in what acts, sample by sample: rounding of up to 1000 m/s^4 in the servo's rate.
    for found, wanted in zip(
        reference.against(prepared[5:20], ACTING), detailed_reference(MODEL, flat[:, 5:20], ACTING), strict=True
    ):
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-10)


def test_the_recursion_flies_what_the_linear_model_says() -> None:
    x0, u = some_flight(2.0)
    weights = Weights(np.arange(16.0), np.ones(4), np.eye(16)).of(PLANE)
    recursion = StepByStep(len(u), PLANE, weights, flies=True)
    linearise = DetailedLinearisation(MODEL, 0.02, len(u))
    ltv, flown = linearise(x0, u, ACTING), linearise(x0, u, ACTING, recursion.fly)
    np.testing.assert_allclose(flown.x_nominal, ltv.x_nominal, rtol=0, atol=1e-12)
    one = recursion.condense(flown.x_nominal, None, weights.sqrt_Qf)
    other = StepByStep(len(u), PLANE, weights).condense(ltv.x_nominal, ltv.parts[0], weights.sqrt_Qf)
    for a, b in zip(one, other, strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-12 * np.abs(b).max())
    more = u.copy()
    more[:, :2] += 0.01 * RNG.standard_normal((len(u), 2))
    again = linearise(x0, more, ACTING).x_nominal - ltv.x_nominal
    np.testing.assert_allclose(recursion.states(more[:, :2] - u[:, :2]), again[:, PLANE.states], rtol=0, atol=1e-12)
