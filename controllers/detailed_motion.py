"""The motion of the detailed model from moment to moment, turned by its heading: what the filter predicts with."""

from typing import NamedTuple

import numpy as np

from controllers.detailed_model import GUST, PUSH, P, Step, U, V
from controllers.signals import Array

IN_WORLD = [V, GUST, PUSH]
"""Columns that are kept in the world frame; the others, and the covariance, are in the turned frame."""


class Motion(NamedTuple):
    """The mean of the filter at one moment."""

    position: Array
    """(2,) x y, world, m."""
    plane: Array
    """(2, 9) columns of both axes; P and U are not used."""
    z: Array
    """(4,) height, velocity, T, push minus g."""
    yaw: Array
    """(4,) yaw, rate, n, push."""
    camera_bias: Array
    """(3,) slow error of the cameras: x y in the turned frame, z, m."""


def advance(solution: Step, motion: Motion, u: Array) -> Motion:
    """The motion one step later: in the plane it is taken in the frame at the middle of the step's headings."""
    yaw, z = np.empty(4), np.empty(4)
    yaw[:3], yaw[3] = solution.yaw @ np.array([*motion.yaw, u[3]]), motion.yaw[3]
    z[:3], z[3] = solution.z @ np.array([*motion.z, u[2]]), motion.z[3]
    turned = turn(0.5 * (motion.yaw[0] + yaw[0]))
    plane = motion.plane.copy()
    plane[:, IN_WORLD] = turned @ plane[:, IN_WORLD]
    plane[:, P], plane[:, U] = 0.0, u[:2]
    plane[:, : GUST + 1] = np.matmul(solution.plane, plane[:, :, None])[..., 0]
    position = motion.position + turned.T @ plane[:, P]
    plane[:, IN_WORLD] = turned.T @ plane[:, IN_WORLD]
    return Motion(position, plane, z, yaw, motion.camera_bias)


def turn(yaw: float) -> Array:
    """Rotation (2, 2) of horizontal vectors from the world into the frame turned by the yaw."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, s], [-s, c]])


def tilt_of(quat_wxyz: Array) -> Array:
    """Horizontal part (2,), world, of the direction of the mast."""
    w, x, y, z = (quat_wxyz / np.sqrt(quat_wxyz @ quat_wxyz)).tolist()
    return np.array([2.0 * (x * z + w * y), 2.0 * (y * z - w * x)])
