"""States and inputs of the detailed model from the flat outputs and their derivatives up to the fifth."""

from functools import lru_cache

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


CALM = Disturbances(np.zeros(2), np.zeros(2), np.zeros(4))
"""Nothing acts."""
_IN_PLANE = [CALM._replace(push=unit) for unit in np.eye(4)[:2]]
_OTHERS = [
    *(CALM._replace(push=unit) for unit in np.eye(4)[2:]),
    *(CALM._replace(trim=unit) for unit in np.eye(2)),
]


class PreparedReference:
    """The same reference, most of which is computed once for many samples: it is linear in what acts."""

    def __init__(self, model: DetailedModel) -> None:
        self._model = model
        at_rest = np.zeros((HIGHEST_DERIVATIVE + 1, 2, 4))
        still = self._stacked(at_rest, CALM)[0]
        self._by_others = np.stack([self._stacked(at_rest, unit)[0] - still for unit in _OTHERS], axis=1)
        """(20, 4) states and inputs per push upwards and in yaw, and per trim of pitch and roll."""

    def prepare(self, flat: Array) -> Array:
        """Return (k, 20, 3) states and inputs of each sample: without disturbances, and per push in x and y.

        Args:
            flat: (6, k, 4) flat outputs and their derivatives.
        """
        calm, *pushed = (self._stacked(flat, acting) for acting in (CALM, *_IN_PLANE))
        return np.stack([calm, *(one - calm for one in pushed)], axis=-1)

    def _stacked(self, flat: Array, acting: Disturbances) -> Array:
        x, u = detailed_reference(self._model, flat, acting)
        # The input of the last sample is not known: it is held from there on.
        return np.concatenate([x, np.concatenate([u, u[-1:]])], axis=1)

    def against(self, prepared: Array, acting: Disturbances) -> tuple[Array, Array]:
        """Return states (N + 1, 16) and inputs (N, 4) against what acts, from the prepared samples (N + 1, 20, 3)."""
        px, py, pz, p_yaw = acting.push
        rows = (prepared.reshape(-1, 3) @ np.array([1.0, px, py])).reshape(-1, N_DETAILED + 4)
        rows += self._by_others @ np.array([pz, p_yaw, *acting.trim])
        return rows[:, :N_DETAILED], rows[:-1, N_DETAILED:]


@lru_cache(8)
def prepared_reference(model: DetailedModel) -> PreparedReference:
    """Return the reference of a model."""
    return PreparedReference(model)


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
