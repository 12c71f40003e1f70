"""States and inputs of the detailed model from the flat outputs and their derivatives up to the fifth."""

import numpy as np

from controllers.detailed_ltv import Disturbances
from controllers.detailed_model import N_DETAILED, DetailedModel
from controllers.model import GRAVITY
from controllers.signals import Array

HIGHEST_DERIVATIVE = 5
"""Of the flat outputs: the servo's rate takes the third derivative of the acceleration by tilt."""


def detailed_reference(model: DetailedModel, flat: Array, acting: Disturbances) -> tuple[Array, Array]:
    """Return the states and inputs that fly a flat output against a constant push and trim.

    Horizontal vectors are complex numbers, north + i west: a turn by the heading is a product. Gusts are left out: they
    fade, and the controller weighs what to do against them.

    Args:
        model: Believed parameters.
        flat: (6, N + 1, 4) flat outputs and their time derivatives, as in `Reference.flat`.
        acting: Disturbances.

    Returns:
        States (N + 1, 16), and inputs (N, 4): the means of those at both ends of each period.

    Source: the flatness of (2)-(9), with tilt, servo and lags between.
    """
    path, yaw, height = flat[..., 0] + 1j * flat[..., 1], flat[..., 3], flat[..., 2]
    turns = _turns(yaw)
    forces = path[2:].copy()
    forces[0] -= complex(*acting.push[:2])
    # Derivatives 0 to 3 of velocity and force in the body frame, each (4, N + 1, 2): ahead and to port.
    v, force = (np.einsum("jkn,kn->jn", turns, w).view(float).reshape(4, -1, 2) for w in (path[1:5], forces))
    k, b = np.array([model.k_x, model.k_y]), np.array([model.b_x, model.b_y])
    w = np.array(model.frequencies)
    a = force - k * v
    servo = (a[2:] / (w * w) + 2.0 * model.attitude_damping / w * a[1:3] + a[:2] - model.hub_drag * k * v[:2]) / b

    x = np.empty((flat.shape[1], N_DETAILED))
    u = np.empty((flat.shape[1], 4))
    x[:, :4], x[:, 4:6], x[:, 6], x[:, 7] = flat[0], v[0], height[1], yaw[1]
    x[:, [8, 11]], x[:, [9, 12]], x[:, [10, 13]] = a[0], a[1], servo[0] - acting.trim
    u[:, :2] = x[:, [10, 13]] + model.servo_lag * servo[1]
    x[:, 14] = height[2] + (GRAVITY - acting.push[2])
    u[:, 2] = (x[:, 14] + model.thrust_lag * height[3]) / model.b_z
    x[:, 15] = yaw[2] - model.k_yaw * yaw[1] - acting.push[3]
    u[:, 3] = (x[:, 15] + model.yaw_lag * (yaw[3] - model.k_yaw * yaw[2])) / model.b_yaw
    return x, 0.5 * (u[:-1] + u[1:])


def _turns(yaw: Array) -> Array:
    """The turn exp(-i yaw) into the body frame as factors of the derivatives of a product with it.

    Args:
        yaw: (6, n) yaw and its time derivatives.

    Returns:
        (4, 4, n): the j-th derivative of exp(-i yaw) w is the sum over k of [j, k] times the k-th derivative of w.
    """
    r, dr, ddr = yaw[1], yaw[2], yaw[3]
    square, factors = r * r, np.zeros((4, 4, yaw.shape[1]), dtype=complex)
    factors[0, 0] = factors[1, 1] = factors[2, 2] = factors[3, 3] = turn = np.exp(-1j * yaw[0])
    factors[1, 0] = first = -1j * r * turn
    factors[2, 0] = second = (-1j * dr - square) * turn
    factors[3, 0] = (1j * (square * r - ddr) - 3.0 * r * dr) * turn
    factors[2, 1], factors[3, 2], factors[3, 1] = 2.0 * first, 3.0 * first, 3.0 * second
    return factors
