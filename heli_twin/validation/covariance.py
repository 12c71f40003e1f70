"""The covariance of a window as one matrix: what a history says of the future needs more than whitened residuals.

Gusts reach position and attitude through drag and its moment at the hubs, about level flight; small white accelerations
stand for the timing of single commands; the cameras have white noise and a slow error.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack as _lapack

from controllers.model import GRAVITY
from controllers.signals import Array
from heli_twin.calibration.noise import BIN_S, SLOW_TIME_S
from heli_twin.calibration.parameters import INDEX, values

SUBSTEPS = 4
PLANE = (0, 1, 4, 5)
"""Channels that the wind reaches: x y pitch roll."""
lapack: Any = _lapack
"""Its functions carry no types."""
CHUNK = 16
"""Windows whose matrices are in memory at the same time."""


class Weighted(NamedTuple):
    """A chunk of windows with the inverse of their covariance."""

    windows: slice
    plane: Array
    """(w, 4 bins, 4 bins) inverse covariance of x y pitch roll."""
    z: Array
    """(w, bins, bins)."""
    yaw: Array
    log_det: Array
    """(w,) logarithm of the determinant of C."""


def wind_response(theta: Array, yaw: Array) -> Array:
    """Return the response of x y pitch roll of each bin to wind in each bin, (w, 4 bins, 2 bins).

    Args:
        theta: (n,) the fit's vector.
        yaw: (w, bins) heading.
    """
    return _response(theta, yaw, is_wind=True)


def torque_response(theta: Array, yaw: Array) -> Array:
    """Return the response of x y pitch roll to angular accelerations of pitch and roll, (w, 4 bins, 2 bins)."""
    return _response(theta, yaw, is_wind=False)


def _response(theta: Array, yaw: Array, *, is_wind: bool) -> Array:
    c = dict(zip(INDEX, values(theta), strict=True))
    kx, ky, hub = c["drag_x_per_mass"], c["drag_y_per_mass"], c["hub_drag_per_iyy"]
    ratio, w2 = c["iyy_per_ixx"], c["attitude_frequency"] ** 2
    damp = 2.0 * c["attitude_damping"] * c["attitude_frequency"]
    (w, n), h = yaw.shape, BIN_S / SUBSTEPS
    cos, sin = np.cos(yaw)[:, None, :], np.sin(yaw)[:, None, :]
    out = np.zeros((w, 4, n, 2, n))
    px, py, vx, vy, t, r, tt, rr = np.zeros((8, w, 2, n))
    for k in range(n):
        live = slice(0, k + 1)
        force = np.zeros((2, 2, k + 1))
        force[0, 0, k] = force[1, 1, k] = 1.0
        cy, sy = cos[:, :, k, None], sin[:, :, k, None]
        P, Q, VX, VY, T, R, TT, RR = (s[:, :, live] for s in (px, py, vx, vy, t, r, tt, rr))
        for _ in range(SUBSTEPS):
            ux, uy = (VX - force[0], VY - force[1]) if is_wind else (VX, VY)
            ax, ay = cy * ux + sy * uy, cy * uy - sy * ux
            jx, jy = (0.0, 0.0) if is_wind else (force[0], force[1])
            TT += h * (jx - w2 * T - damp * TT - hub * kx * ax)
            RR += h * (jy - ratio * w2 * R - np.sqrt(ratio) * damp * RR + ratio * hub * ky * ay)
            fx, fy = GRAVITY * T - kx * ax, -GRAVITY * R - ky * ay
            VX += h * (cy * fx - sy * fy)
            VY += h * (sy * fx + cy * fy)
            for i, (state, speed) in enumerate(((P, VX), (Q, VY), (T, TT), (R, RR))):
                state += h * speed
                out[:, i, k, :, live] += state / SUBSTEPS
    return out.reshape(w, 4 * n, 2 * n)


def _integrators(damping: float, n: int) -> Array:
    """Response (n, n) of an angle or a height to an acceleration in each bin."""
    since = BIN_S * np.maximum(np.arange(n)[:, None] - np.arange(n)[None, :] + 0.5, 0.0)
    if damping < 1e-6:
        return BIN_S * since
    return BIN_S * (1.0 - np.exp(-damping * since)) / damping


def _lags(n: int) -> Array:
    """Times (n, n) between bins, s."""
    return BIN_S * np.abs(np.subtract.outer(np.arange(n), np.arange(n)))


class Windage(NamedTuple):
    """The parts of each window's covariance, which changes slowly with the parameters."""

    wind: Array
    torque: Array
    z: Array
    yaw: Array
    frames: Array
    """(w, bins) poses in each bin."""


def windage(theta: Array, yaw: Array, frames: Array) -> Windage:
    """Return the responses to everything random."""
    torque = torque_response(theta, yaw)
    damping, n = float(values(theta)[INDEX["yaw_damping_per_izz"]]), frames.shape[1]
    z, turn = _integrators(0.0, n), _integrators(damping, n)
    return Windage(wind_response(theta, yaw), torque @ torque.transpose(0, 2, 1), z @ z.T, turn @ turn.T, frames)


def weighted(air: Windage, eta: Array) -> Iterator[Weighted]:
    """Yield the inverse covariances, some windows at a time.

    Args:
        air: The responses.
        eta: (9,) logarithms of `noise.COMPONENTS`.
    """
    for begin in range(0, len(air.frames), CHUNK):
        yield _chunk(air, eta, slice(begin, begin + CHUNK))


def _chunk(air: Windage, eta: Array, windows: slice) -> Weighted:
    s = np.exp(2.0 * eta)
    wind, frames = air.wind[windows], air.frames[windows]
    w, n = frames.shape
    present, fading = frames > 0, np.exp(-_lags(n) / SLOW_TIME_S)
    many = np.where(present, frames, 1.0)
    keep = np.concatenate([present] * 4, axis=1)
    gust = s[0] * _gust(wind, np.exp(eta[1])) * _outer(keep)
    torque = s[2] * air.torque[windows] * _outer(keep)
    slow = np.zeros((w, 4 * n, 4 * n))
    slow[:, :n, :n] = slow[:, n : 2 * n, n : 2 * n] = s[3] * fading * _outer(present)
    zero, white = np.zeros((w, n)), np.where(present, 1.0 / many, 0.0)
    place = np.concatenate([s[4] * white, s[4] * white, zero, zero], axis=1)
    angle = np.concatenate([zero, zero, s[5] * white, s[5] * white], axis=1)
    plane = gust + torque + slow
    _add_diagonal(plane, np.where(keep, place + angle, 1.0))
    z_jitter = s[6] * air.z * _outer(present)
    z_slow = s[3] * fading * _outer(present)
    z = z_jitter + z_slow
    _add_diagonal(z, np.where(present, s[4] * white, 1.0))
    yaw_jitter = s[7] * air.yaw * _outer(present)
    yaw = yaw_jitter.copy()
    _add_diagonal(yaw, np.where(present, s[8] * white, 1.0))
    (plane, plane_det), (z, z_det), (yaw, yaw_det) = map(_inverse, (plane, z, yaw))
    return Weighted(windows, plane, z, yaw, plane_det + z_det + yaw_det)


def _gust(wind: Array, time: float) -> Array:
    n = wind.shape[-1] // 2
    correlation = np.exp(-_lags(n) / time)
    north, west = wind[:, :, :n], wind[:, :, n:]
    return north @ correlation @ north.transpose(0, 2, 1) + west @ correlation @ west.transpose(0, 2, 1)


def _outer(keep: NDArray[np.bool_]) -> NDArray[np.bool_]:
    return keep[:, :, None] & keep[:, None, :]


def _add_diagonal(matrices: Array, diagonal: Array) -> None:
    i = np.arange(matrices.shape[-1])
    matrices[:, i, i] += diagonal


def _inverse(matrices: Array) -> tuple[Array, Array]:
    """Inverse and logarithm of the determinant of symmetric positive matrices (w, n, n)."""
    out, det = np.empty_like(matrices), np.empty(len(matrices))
    for i, matrix in enumerate(matrices):
        factor, bad = lapack.dpotrf(matrix, lower=1)
        if bad:
            raise np.linalg.LinAlgError("the covariance of a window is not positive")
        det[i] = 2.0 * np.log(np.diag(factor)).sum()
        inverse, _ = lapack.dpotri(factor, lower=1)
        lower = np.tril(inverse)
        out[i] = lower + np.tril(inverse, -1).T
    return out, det


def blocks(weights: Weighted, rows: Array) -> dict[str, tuple[Array, Array]]:
    """The inverse covariance and the rows (w, n, c) of each block, of rows (w, bins, 6, c)."""
    part = rows[weights.windows]
    w, n, _, c = part.shape
    plane = np.moveaxis(part[:, :, PLANE], 2, 1).reshape(w, 4 * n, c)
    return {
        "plane": (weights.plane, plane),
        "z": (weights.z, part[:, :, 2]),
        "yaw": (weights.yaw, part[:, :, 3]),
    }
