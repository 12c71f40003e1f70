"""The helicopter as the controller believes it: the paper's (1) with parameters (27) and limits (28), (29)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import cos, expm1, inf, sin
from typing import Annotated

from annotated_types import Ge, Gt, Le, Unit, doc

GRAVITY = 9.81
"""m/s^2."""

State = tuple[float, float, float, float, float, float, float, float]
"""x y z yaw (world), vx vy vz (body), yaw rate: the eight physical states as Python floats.

Rotations are written out here: on Python floats a call of `controllers.rotations` takes several times as long.
"""
Input = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class Model:
    """Parameters of (1) and its limits.

    The paper prints (29), and b_psi before b_z in (27), in the order (x, y, yaw, z): hover needs
    u_z = 9.81 / 18 = 0.545, above the printed limit of 0.4. Here the order is (x, y, z, yaw).

    Source: Kunz, Huck, Summers, ECC 2013, (1), (27)-(29).
    """

    b_x: Annotated[float, Gt(0), Unit("m/s^2"), doc("forward acceleration at full pitch stick")] = 2.0
    k_x: Annotated[float, Ge(-100), Le(0), Unit("1/s"), doc("forward drag")] = -0.5
    b_y: Annotated[float, Gt(0), Unit("m/s^2"), doc("sideward acceleration at full roll stick")] = 2.1
    k_y: Annotated[float, Ge(-100), Le(0), Unit("1/s"), doc("sideward drag")] = -0.4
    b_z: Annotated[
        float, Gt(9.81), Unit("m/s^2"), doc("upward acceleration at full thrust, gravity not subtracted")
    ] = 18.0
    b_yaw: Annotated[float, Gt(0), Unit("rad/s^2"), doc("yaw acceleration at full yaw stick")] = 111.0
    k_yaw: Annotated[float, Ge(-1000), Le(0), Unit("1/s"), doc("yaw damping")] = -5.0
    vx_max: Annotated[float, Gt(0), Unit("m/s"), doc("forward speed limit (28)")] = 3.0
    vy_max: Annotated[float, Gt(0), Unit("m/s"), doc("sideward speed limit (28)")] = 3.0
    vz_max: Annotated[float, Gt(0), Unit("m/s"), doc("vertical speed limit (28)")] = 2.0
    yaw_rate_max: Annotated[float, Gt(0), Unit("rad/s"), doc("yaw rate limit (28)")] = 25.0
    u_x_max: Annotated[float, Gt(0), Le(1), Unit("full stick"), doc("pitch input limit (29)")] = 1.0
    u_y_max: Annotated[float, Gt(0), Le(1), Unit("full stick"), doc("roll input limit (29)")] = 1.0
    u_z_min: Annotated[float, Ge(0), Le(1), Unit("full stick"), doc("least thrust (29)")] = 0.0
    u_z_max: Annotated[float, Gt(0), Le(1), Unit("full stick"), doc("greatest thrust (29)")] = 1.0
    u_yaw_max: Annotated[float, Gt(0), Le(1), Unit("full stick"), doc("yaw input limit (29)")] = 0.4

    @property
    def u_min(self) -> Input:
        """Lower input limits, (u_x, u_y, u_z, u_yaw)."""
        return (-self.u_x_max, -self.u_y_max, self.u_z_min, -self.u_yaw_max)

    @property
    def u_max(self) -> Input:
        """Upper input limits, (u_x, u_y, u_z, u_yaw)."""
        return (self.u_x_max, self.u_y_max, self.u_z_max, self.u_yaw_max)

    @property
    def v_max(self) -> tuple[float, float, float, float]:
        """Limits on the magnitudes of vx, vy, vz (m/s) and the yaw rate (rad/s)."""
        return (self.vx_max, self.vy_max, self.vz_max, self.yaw_rate_max)

    @property
    def u_slew(self) -> Input:
        """Greatest speeds of the inputs, full stick / s: the paper's model has no limit."""
        return (inf, inf, inf, inf)

    @property
    def u_hover(self) -> Input:
        """The input that keeps the helicopter in hover."""
        return (0.0, 0.0, GRAVITY / self.b_z, 0.0)


def rates(model: Model, x: State, u: Input) -> State:
    """Return the time derivative of the physical states, (1)."""
    _, _, _, yaw, vx, vy, vz, r = x
    c, s = cos(yaw), sin(yaw)
    return (
        c * vx - s * vy,
        s * vx + c * vy,
        vz,
        r,
        model.b_x * u[0] + model.k_x * vx + r * vy,
        model.b_y * u[1] + model.k_y * vy - r * vx,
        model.b_z * u[2] - GRAVITY,
        model.b_yaw * u[3] + model.k_yaw * r,
    )


Push = tuple[float, float, float, float]
"""Acceleration added to that of (1): x y z (world, m/s^2), yaw (rad/s^2)."""


def advance(model: Model, x: State, u: Input, dt: float, push: Push = (0.0, 0.0, 0.0, 0.0)) -> State:
    """Return the state `dt` seconds later under a constant input and a constant `push`; see `simulator`."""
    return simulator(model, dt)(x, (u,), push)[0]


def simulator(model: Model, dt: float) -> Callable[[State, Sequence[Input], Push], list[State]]:
    """Return a simulation of the nonlinear model in steps of `dt`: exact in z and yaw, fourth order in x and y.

    Height and yaw are linear and are solved in closed form. Along that yaw, horizontal position and velocity are
    integrated by one Runge-Kutta 4 step in the world frame, where the yaw rate terms of (1) cancel. It is written in
    Python floats for speed: the controller takes about twenty such steps every control period.

    Args:
        model: Believed parameters.
        dt: Length of the step, s.

    Returns:
        A function of the initial state, the inputs (one a step) and a constant push, which returns the state
        after each step: to the last digit what a call for each step gives.
    """
    half, sixth, square = 0.5 * dt, dt / 6.0, 0.5 * dt * dt
    gain, turn = _yaw_response(model.k_yaw, dt)
    _, turn_half = _yaw_response(model.k_yaw, half)
    k = model.k_yaw
    b_x, b_y, b_z, b_yaw, k_x, k_y = model.b_x, model.b_y, model.b_z, model.b_yaw, model.k_x, model.k_y
    k_difference, k_sum = k_x - k_y, k_x + k_y

    def simulate(x: State, inputs: Sequence[Input], push: Push) -> list[State]:
        px, py, pz, yaw, vx, vy, vz, r = x
        ax, ay, a_z, a_yaw = push
        a_z -= GRAVITY
        c, s = cos(yaw), sin(yaw)
        states: list[State] = []
        for u_x, u_y, u_z, u_yaw in inputs:
            rate = b_yaw * u_yaw + a_yaw + k * r
            yaw_mid = yaw + r * half + rate * turn_half
            yaw += r * dt + rate * turn
            az = b_z * u_z + a_z
            fx, fy = b_x * u_x, b_y * u_y
            # In the world frame the horizontal acceleration is g + K w: velocity w, push and rotated input g, and
            # the rotated drag K, a symmetric matrix. Evaluated at the start, the middle and the end of the step.
            cm, sm = cos(yaw_mid), sin(yaw_mid)
            wx, wy = c * vx - s * vy, s * vx + c * vy
            bx, by = fx + k_x * vx, fy + k_y * vy
            x1, y1 = c * bx - s * by + ax, s * bx + c * by + ay
            gx, gy = cm * fx - sm * fy + ax, sm * fx + cm * fy + ay
            kc = k_difference * cm
            kxx, kxy = k_y + kc * cm, kc * sm
            kyy = k_sum - kxx
            mx, my = wx + half * x1, wy + half * y1
            x2, y2 = gx + kxx * mx + kxy * my, gy + kxy * mx + kyy * my
            mx, my = wx + half * x2, wy + half * y2
            x3, y3 = gx + kxx * mx + kxy * my, gy + kxy * mx + kyy * my
            c, s = cos(yaw), sin(yaw)
            mx, my = wx + dt * x3, wy + dt * y3
            bx, by = fx + k_x * (c * mx + s * my), fy + k_y * (c * my - s * mx)
            x4, y4 = c * bx - s * by + ax, s * bx + c * by + ay
            x23, y23 = x2 + x3, y2 + y3
            ex, ey = wx + sixth * (x1 + x23 + x23 + x4), wy + sixth * (y1 + y23 + y23 + y4)
            px += dt * (wx + sixth * (x1 + x23))
            py += dt * (wy + sixth * (y1 + y23))
            pz += dt * vz + square * az
            vx, vy, vz, r = c * ex + s * ey, c * ey - s * ex, vz + dt * az, r + rate * gain
            states.append((px, py, pz, yaw, vx, vy, vz, r))
        return states

    return simulate


def _yaw_response(k: float, t: float) -> tuple[float, float]:
    """Changes of yaw rate and yaw under r' = a + k r after a time t, per unit of r' at the start."""
    h = k * t
    if h > -1e-4:
        # The closed form loses digits here; the series are exact to a relative 1e-13.
        return t * (1.0 + h * (0.5 + h / 6.0)), t * t * (0.5 + h * (1.0 / 6.0 + h / 24.0))
    gain = expm1(h) / k
    return gain, (gain - t) / k
