"""States and inputs of a trajectory from its flat outputs, (2)-(9)."""

from typing import NamedTuple

import numpy as np

from controllers.model import GRAVITY, Model
from controllers.rotations import rotate_to_body
from controllers.signals import Array


class FlatOutput(NamedTuple):
    """The flat outputs (3) and their derivatives along a trajectory."""

    z: Array
    """(..., 4) x y z (world, m), yaw (rad)."""
    dz: Array
    """(..., 4) first time derivative."""
    ddz: Array
    """(..., 4) second time derivative."""


def state(flat: FlatOutput) -> Array:
    """Return the physical states (..., 8) along a flat output, (4)."""
    x = np.concatenate([flat.z, flat.dz], axis=-1)
    x[..., 4:6] = rotate_to_body(flat.dz[..., :2], flat.z[..., 3])
    return x


def feed_forward(model: Model, flat: FlatOutput) -> Array:
    """Return the inputs (..., 4) that fly a flat output, (5)-(8).

    (5) is printed with the wrong sign of g: (1) gives u_z = (z'' + g) / b_z.
    """
    yaw = flat.z[..., 3]
    c, s = np.cos(yaw), np.sin(yaw)
    (dx, dy, _, dyaw), (ddx, ddy, ddz, ddyaw) = np.moveaxis(flat.dz, -1, 0), np.moveaxis(flat.ddz, -1, 0)
    return np.stack(
        [
            (c * (ddx - model.k_x * dx) + s * (ddy - model.k_x * dy)) / model.b_x,
            (c * (ddy - model.k_y * dy) - s * (ddx - model.k_y * dx)) / model.b_y,
            (ddz + GRAVITY) / model.b_z,
            (ddyaw - model.k_yaw * dyaw) / model.b_yaw,
        ],
        axis=-1,
    )
