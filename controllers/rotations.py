"""Rotations by the yaw, and angles: frames are *world* (north-west-up) and *body* (turned by the yaw alone)."""

from math import pi
from typing import TypeVar

import numpy as np

from controllers.signals import Array

Angle = TypeVar("Angle", float, Array)


def wrap_angle(angle: Angle) -> Angle:
    """The same direction in [-pi, pi), rad."""
    return (angle + pi) % (2 * pi) - pi


def rotate_to_body(vector_world: Array, yaw: Array) -> Array:
    """Horizontal parts of vectors, seen along the axes of the body.

    Args:
        vector_world: (..., 2) north and west.
        yaw: (...), rad.

    Returns:
        (..., 2) along the nose and to port.
    """
    c, s = np.cos(yaw), np.sin(yaw)
    x, y = vector_world[..., 0], vector_world[..., 1]
    return np.stack([c * x + s * y, c * y - s * x], axis=-1)


def rotate_to_world(vector_body: Array, yaw: Array) -> Array:
    """Horizontal parts of vectors, seen along the axes of the room: the inverse of `rotate_to_body`.

    Args:
        vector_body: (..., 2) along the nose and to port.
        yaw: (...), rad.

    Returns:
        (..., 2) north and west.
    """
    return rotate_to_body(vector_body, -yaw)


def yaw_of(quat_wxyz: Array) -> Array:
    """The yaw (...), rad, in [-pi, pi], of attitudes (..., 4) of the body in the world, scalar first (z-y-x angles)."""
    w, x, y, z = np.moveaxis(np.asarray(quat_wxyz), -1, 0)
    return np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
