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
    yaw, u = flat.z[..., 3], flat.ddz.copy()
    drag = np.array([model.k_x, model.k_y]) * rotate_to_body(flat.dz[..., :2], yaw)
    u[..., :2] = rotate_to_body(flat.ddz[..., :2], yaw) - drag
    u[..., 2] += GRAVITY
    u[..., 3] -= model.k_yaw * flat.dz[..., 3]
    return u / np.array([model.b_x, model.b_y, model.b_z, model.b_yaw])
