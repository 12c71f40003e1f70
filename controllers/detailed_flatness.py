"""States and inputs of the detailed model from the flat outputs and their derivatives up to the fifth."""

from math import comb

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
    body = _to_body(yaw)
    moving = [_product(body, path[1:], n) for n in range(4)]
    forces = path[2:].copy()
    forces[0] -= complex(*acting.push[:2])
    asked = [_product(body, forces, n) for n in range(4)]

    x = np.empty((flat.shape[1], N_DETAILED))
    u = np.empty((flat.shape[1], 4))
    x[:, 0:4], x[:, 6], x[:, 7] = flat[0], height[1], yaw[1]
    axes = (model.k_x, model.b_x, model.pitch_frequency), (model.k_y, model.b_y, model.roll_frequency)
    for axis, (k, b, w) in enumerate(axes):
        v = [_part(value, axis) for value in moving]
        a = [_part(value, axis) - k * v[n] for n, value in enumerate(asked)]
        damping, hub = 2.0 * model.attitude_damping / w, model.hub_drag * k
        servo = [(a[n + 2] / (w * w) + damping * a[n + 1] + a[n] - hub * v[n]) / b for n in (0, 1)]
        own = 8 + 3 * axis
        x[:, 4 + axis], x[:, own], x[:, own + 1], x[:, own + 2] = v[0], a[0], a[1], servo[0] - acting.trim[axis]
        u[:, axis] = x[:, own + 2] + model.servo_lag * servo[1]
    x[:, 14] = height[2] + (GRAVITY - acting.push[2])
    u[:, 2] = (x[:, 14] + model.thrust_lag * height[3]) / model.b_z
    x[:, 15] = yaw[2] - model.k_yaw * yaw[1] - acting.push[3]
    u[:, 3] = (x[:, 15] + model.yaw_lag * (yaw[3] - model.k_yaw * yaw[2])) / model.b_yaw
    return x, 0.5 * (u[:-1] + u[1:])


def _to_body(yaw: Array) -> list[Array]:
    """The turn exp(-i yaw) into the body frame and its first three time derivatives, each (n,)."""
    r, dr, ddr = yaw[1], yaw[2], yaw[3]
    turn = np.exp(-1j * yaw[0])
    square = r * r
    return [turn, -1j * r * turn, (-1j * dr - square) * turn, (1j * (square * r - ddr) - 3.0 * r * dr) * turn]


def _product(a: list[Array], b: Array, n: int) -> Array:
    """The n-th derivative of a product, from the derivatives of its factors."""
    total = a[0] * b[n]
    for k in range(1, n + 1):
        total = total + comb(n, k) * a[k] * b[n - k]
    return total


def _part(value: Array, axis: int) -> Array:
    """The forward (0) or portward (1) part of complex numbers."""
    return value.imag if axis else value.real
