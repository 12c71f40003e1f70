"""Axes of recordings, and how they become ours: the world north-west-up, the body nose-port-up."""

from typing import NamedTuple

import numpy as np

from controllers.signals import Array


class Frame(NamedTuple):
    """The axes of a recording."""

    text: str
    """For a person."""
    R_ours_world: Array
    """(3, 3) from the recording's world to ours."""
    R_ours_body: Array
    """(3, 3) from the recording's body to ours."""


_Y_UP = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
_DOWN = np.diag([1.0, -1.0, -1.0])

FRAMES = {
    "zup": Frame("x forward, y left, z up", np.eye(3), np.eye(3)),
    "yup": Frame("x left, y up, z forward, as Motive exports", _Y_UP, _Y_UP),
    "ned": Frame("x north, y east, z down; body nose, starboard, down", _DOWN, _DOWN),
    "enu": Frame(
        "x east, y north, z up; body nose, port, up, as in ROS",
        np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
        np.eye(3),
    ),
}
LENGTH_UNITS_M = {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "in": 0.0254, "ft": 0.3048}


def to_ours(frame: Frame, position: Array, quat_wxyz: Array) -> tuple[Array, Array]:
    """Positions (n, 3) and attitudes (n, 4) along our axes; rows with NaN stay NaN."""
    from scipy.spatial.transform import Rotation

    quaternions = np.full_like(quat_wxyz, np.nan)
    known = np.isfinite(quat_wxyz).all(axis=1)
    if known.any():
        turned = (
            Rotation.from_matrix(frame.R_ours_world)
            * Rotation.from_quat(quat_wxyz[known], scalar_first=True)
            * Rotation.from_matrix(frame.R_ours_body.T)
        )
        quaternions[known] = turned.as_quat(canonical=True, scalar_first=True)
    return position @ frame.R_ours_world.T, quaternions
