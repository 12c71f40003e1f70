"""The marker body, which sits beside the centre of gravity and a little tilted: what that does to measured poses.

Poses h (w, bins, 6) are x y z yaw pitch roll of the centre of gravity.
"""

import numpy as np

from controllers.signals import Array


def by_tilt(h: Array) -> Array:
    """Return the derivative (w, bins, 6, 3) of a measured pose by a small tilt of the markers about their axes."""
    pitch, roll = h[..., 4], h[..., 5]
    sr, cr, tp, cp = np.sin(roll), np.cos(roll), np.tan(pitch), np.cos(pitch)
    out = np.zeros((*h.shape, 3))
    out[..., 3, 1], out[..., 3, 2] = sr / cp, cr / cp
    out[..., 4, 1], out[..., 4, 2] = cr, -sr
    out[..., 5, 0], out[..., 5, 1], out[..., 5, 2] = 1.0, tp * sr, tp * cr
    return out


def by_lever(h: Array) -> Array:
    """Return the derivative (w, bins, 6, 3) of a measured pose by the place of the markers in the body."""
    (sy, sp, sr), (cy, cp, cr) = (np.moveaxis(f(h[..., 3:]), -1, 0) for f in (np.sin, np.cos))
    out = np.zeros((*h.shape, 3))
    out[..., 0, :] = np.stack([cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr], axis=-1)
    out[..., 1, :] = np.stack([sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr], axis=-1)
    out[..., 2, :] = np.stack([-sp, cp * sr, cp * cr], axis=-1)
    return out


def lever_turned(h: Array, lever: Array) -> Array:
    """Return the derivative (w, bins, 3, 3) of the markers' position by yaw, pitch and roll."""
    base, out = by_lever(h)[..., :3, :], np.empty((*h.shape[:2], 3, 3))
    for i in range(3):
        moved = h.copy()
        moved[..., 3 + i] += 1e-5
        out[..., i] = np.einsum("wbic,wc->wbi", (by_lever(moved)[..., :3, :] - base) / 1e-5, lever)
    return out
