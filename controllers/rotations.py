"""Rotations by the yaw, and angles: frames are *world* (north-west-up) and *body* (turned by the yaw alone)."""

from math import pi
from typing import TypeVar

import numpy as np

from controllers.signals import Array

Angle = TypeVar("Angle", float, Array)


def wrap_angle(angle: Angle) -> Angle:
    """Return the same direction as an angle in [-pi, pi), rad."""
    return (angle + pi) % (2 * pi) - pi


def rotate_to_body(vector_world: Array, yaw: Array) -> Array:
    """Rotate horizontal vectors from the world frame to the body frame.

    Args:
        vector_world: (..., 2) components to north and west.
        yaw: (...), rad.

    Returns:
        (..., 2) components ahead and to port.
    """
    c, s = np.cos(yaw), np.sin(yaw)
    x, y = vector_world[..., 0], vector_world[..., 1]
    return np.stack([c * x + s * y, c * y - s * x], axis=-1)


def rotate_to_world(vector_body: Array, yaw: Array) -> Array:
    """Rotate horizontal vectors from the body frame to the world frame: the inverse of `rotate_to_body`.

    Args:
        vector_body: (..., 2) components ahead and to port.
        yaw: (...), rad.

    Returns:
        (..., 2) components to north and west.
    """
    return rotate_to_body(vector_body, -yaw)


def yaw_of(quat_wxyz: Array) -> Array:
    """Return the yaw (...), rad in [-pi, pi], of attitudes (..., 4) of the body in the world (z-y-x angles)."""
    w, x, y, z = np.moveaxis(np.asarray(quat_wxyz), -1, 0)
    return np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
