"""The helicopter as the controller believes it: the paper's (1) with parameters (27) and limits (28), (29)."""

from dataclasses import dataclass
from math import cos, expm1, sin
from typing import Annotated

from annotated_types import Ge, Gt, Le, Unit, doc

GRAVITY = 9.81
"""m/s^2."""

State = tuple[float, float, float, float, float, float, float, float]
"""x y z yaw (world), vx vy vz (body), yaw rate: the eight physical states as plain numbers, which is faster here."""
Input = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class Model:
    """Parameters of (1) and its limits.

    The print gives (29), and b_psi before b_z in (27), in the order (x, y, yaw, z): hover needs
    u_z = 9.81 / 18 = 0.545, which the printed limit of 0.4 forbids. They stand here as (x, y, z, yaw).

    Source: Kunz, Huck, Summers, ECC 2013, (1), (27)-(29).
    """

    b_x: Annotated[float, Gt(0), Unit("m/s^2"), doc("forward acceleration at full pitch stick")] = 2.0
    k_x: Annotated[float, Le(0), Unit("1/s"), doc("forward drag")] = -0.5
    b_y: Annotated[float, Gt(0), Unit("m/s^2"), doc("sideward acceleration at full roll stick")] = 2.1
    k_y: Annotated[float, Le(0), Unit("1/s"), doc("sideward drag")] = -0.4
    b_z: Annotated[float, Gt(9.81), Unit("m/s^2"), doc("upward acceleration at full thrust, gravity not subtracted")] = 18.0
    b_yaw: Annotated[float, Gt(0), Unit("rad/s^2"), doc("yaw acceleration at full yaw stick")] = 111.0
    k_yaw: Annotated[float, Le(0), Unit("1/s"), doc("yaw damping")] = -5.0
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
    def u_hover(self) -> Input:
        """The input that holds the helicopter still."""
        return (0.0, 0.0, GRAVITY / self.b_z, 0.0)


def rates(model: Model, x: State, u: Input) -> State:
    """Time derivative of the physical states, (1)."""
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


def advance(
    model: Model, x: State, u: Input, dt: float, a: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
) -> State:
    """The state `dt` seconds later under a constant input: exact in z and yaw, fourth order in x and y.

    Height and yaw are linear and are solved in closed form. Along that yaw, position and velocity in the plane
    are integrated by one Runge-Kutta 4 step, in the world frame, where the turning terms of (1) cancel.

    Args:
        model: Believed parameters.
        x: State at the start.
        u: Input held over the step.
        dt: Length of the step, s.
        a: Further constant acceleration: x y z (world, m/s^2), yaw (rad/s^2).
    """
    px, py, pz, yaw, vx, vy, vz, r = x
    az = model.b_z * u[2] - GRAVITY + a[2]
    ar, k = model.b_yaw * u[3] + a[3], model.k_yaw
    # r' = ar + k r: gain(t) = (exp(k t) - 1) / k is the response of r to its rate of change at the start.
    half = 0.5 * dt
    gain_mid, gain = (expm1(k * half) / k, expm1(k * dt) / k) if k else (half, dt)
    r_rate = ar + k * r
    yaw_mid = yaw + r * half + (r_rate * (gain_mid - half) / k if k else 0.5 * ar * half * half)
    yaw_end = yaw + r * dt + (r_rate * (gain - dt) / k if k else 0.5 * ar * dt * dt)

    ux, uy, kx, ky = model.b_x * u[0], model.b_y * u[1], model.k_x, model.k_y
    ax, ay = a[0], a[1]

    def acceleration(c: float, s: float, wx: float, wy: float) -> tuple[float, float]:
        fx = ux + kx * (c * wx + s * wy)
        fy = uy + ky * (c * wy - s * wx)
        return c * fx - s * fy + ax, s * fx + c * fy + ay

    c0, s0, cm, sm, c1, s1 = cos(yaw), sin(yaw), cos(yaw_mid), sin(yaw_mid), cos(yaw_end), sin(yaw_end)
    wx, wy = c0 * vx - s0 * vy, s0 * vx + c0 * vy
    k1x, k1y = acceleration(c0, s0, wx, wy)
    k2x, k2y = acceleration(cm, sm, wx + half * k1x, wy + half * k1y)
    k3x, k3y = acceleration(cm, sm, wx + half * k2x, wy + half * k2y)
    k4x, k4y = acceleration(c1, s1, wx + dt * k3x, wy + dt * k3y)
    sixth = dt / 6.0
    wx_end = wx + sixth * (k1x + 2.0 * (k2x + k3x) + k4x)
    wy_end = wy + sixth * (k1y + 2.0 * (k2y + k3y) + k4y)
    return (
        px + dt * wx + dt * sixth * (k1x + k2x + k3x),
        py + dt * wy + dt * sixth * (k1y + k2y + k3y),
        pz + dt * vz + 0.5 * az * dt * dt,
        yaw_end,
        c1 * wx_end + s1 * wy_end,
        c1 * wy_end - s1 * wx_end,
        vz + az * dt,
        r + r_rate * gain,
    )
