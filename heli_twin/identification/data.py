"""A flight as regression data: poses and sent commands, cleaned, on one grid, seen through one smooth window.

Differentiating a noisy pose twice would drown the signal. Here (1) is multiplied by a smooth window that slides along
the flight and integrated, the weak form: position, speed, acceleration and input all pass the same window, which
leaves their relation as it is and takes the cameras' noise down to a hundredth of what the helicopter does.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from controllers.model import GRAVITY
from controllers.signals import Array
from heli_twin.recording import Log

GRID = 0.01
"""Spacing of the grid that poses are brought to, s."""
WINDOW = 0.4
"""Length of the window, s: longer than the helicopter's lags, shorter than its manoeuvres."""
ROW = 0.1
"""Spacing of the rows of the regression, s."""
GAP = 0.1
"""Poses further apart than this, s, end a stretch."""
SHORTEST = 5.0
"""A stretch with less than this, s, is left out."""
FLOOR = 0.2
"""Below this height, m, the floor holds or lifts the helicopter, and no model here knows of it."""
JUMP_LENGTH, JUMP_ANGLE = 0.005, 0.05
"""A pose further from the median of its neighbours than this, m and rad, is a swapped marker."""


class Equation(NamedTuple):
    """One axis of (1) along a stretch, every column through the window: accel = b input + k speed + push."""

    accel: Array
    """(n,) acceleration; in z with gravity added."""
    input: Callable[[float, float], Array]
    """From a delay and the part of it that is a first-order lag, s, to the (n,) inputs as they act."""
    speed: Array | None
    """(n,) what damping acts on; None in z."""
    push: Array
    """(n, m) directions of a steady push: of its own, or fixed to the room while the helicopter turns."""


class Stretch(NamedTuple):
    """A piece of a flight without gaps."""

    log: str
    """Name of the log."""
    time: Array
    """(n,) of the rows, s since the start of the flight."""
    axes: dict[str, Equation]
    """By axis x, y, z, yaw."""


def stretches(log: Log, name: str) -> Iterator[Stretch]:
    """The usable pieces of a flight: with poses, with commands, above the floor.

    Args:
        log: The flight; of it, `/mocap/pose` and `/command/sent` are read, which a real lab has too.
        name: What to call it.
    """
    t, pose = _clean(log)
    if len(log.sent.time) < 2 or not len(t):
        return
    # Delays reach back: the first second has commands from before the log.
    inside = (pose[:, 2] > FLOOR) & (t > 1e-9 * log.sent.time[0] + 1.0) & (t < 1e-9 * log.sent.time[-1])
    breaks = np.flatnonzero(np.diff(t[inside]) > GAP) + 1
    for piece_t, piece in zip(np.split(t[inside], breaks), np.split(pose[inside], breaks), strict=True):
        if len(piece_t) and piece_t[-1] - piece_t[0] >= SHORTEST:
            grid = np.arange(piece_t[0], piece_t[-1], GRID)
            yield _stretch(name, grid, np.stack([np.interp(grid, piece_t, column) for column in piece.T]), log)


def _clean(log: Log) -> tuple[Array, Array]:
    """Capture times (n,), s, and poses (n, 5): x y z yaw, and the share of thrust that points upwards."""
    stamp, first = np.unique(log.pose.stamp, return_index=True)
    q = log.pose.quat_wxyz[first]
    pose = np.column_stack([log.pose.position[first], np.zeros((len(q), 2))])
    finite = np.isfinite(pose).all(axis=1) & np.isfinite(q).all(axis=1) & (np.abs(q).max(axis=1, initial=0) > 0.1)
    pose, t = pose[finite], 1e-9 * stamp[finite].astype(np.float64)
    w, x, y, z = (q[finite] / np.linalg.norm(q[finite], axis=1, keepdims=True)).T
    pose[:, 3] = np.unwrap(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))
    pose[:, 4] = 1.0 - 2.0 * (x * x + y * y)
    if len(pose) < 5:
        return t[:0], pose[:0]
    around = np.lib.stride_tricks.sliding_window_view(np.pad(pose[:, :4], ((2, 2), (0, 0)), mode="edge"), 5, axis=0)
    off = np.abs(pose[:, :4] - np.median(around, axis=-1))
    steady = (off[:, :3] < JUMP_LENGTH).all(axis=1) & (off[:, 3] < JUMP_ANGLE)
    return t[steady], pose[steady]


def _stretch(name: str, t: Array, pose: Array, log: Log) -> Stretch:
    """The equations of one stretch.

    Two things are known that (1) leaves out, and would bias its gains by 1 to 2 %: tilting grows with the thrust that
    is tilted, and thrust lifts by its upright share only. Both are 1 in hover.
    """
    x, y, z, yaw, upright = pose
    window = 1.0 + np.cos(np.linspace(-np.pi, np.pi, 2 * round(WINDOW / GRID / 2) + 1))
    window /= window.sum()
    every = round(ROW / GRID)

    def seen(signal: Array) -> Array:
        return np.asarray(np.convolve(signal, window, "valid")[::every], np.float64)

    heading = np.convolve(np.pad(yaw, len(window) // 2, mode="edge"), window, "valid")[1:-1]
    c, s, up = np.cos(heading), np.sin(heading), upright[1:-1]
    (vx, vy, _, r), (ax, ay, az, ar) = zip(*map(_derivatives, (x, y, z, yaw)), strict=True)
    still = np.ones_like(c)
    sent = _Sent(log, t)
    hover = float(np.mean(sent(2, 0.0, 0.0) * up))

    def tilting(axis: int) -> Callable[[float, float], Array]:
        return lambda delay, lag: seen(sent(axis, delay, lag) * sent(2, delay, lag) / hover)

    def lifting(delay: float, lag: float) -> Array:
        return seen(sent(2, delay, lag) * up)

    def turning(delay: float, lag: float) -> Array:
        return seen(sent(3, delay, lag))

    axes = {
        "x": Equation(seen(c * ax + s * ay), tilting(0), seen(c * vx + s * vy), np.column_stack([seen(c), seen(s)])),
        "y": Equation(seen(c * ay - s * ax), tilting(1), seen(c * vy - s * vx), np.column_stack([seen(c), seen(-s)])),
        "z": Equation(seen(az + GRAVITY), lifting, None, seen(still)[:, None]),
        "yaw": Equation(seen(ar), turning, seen(r), seen(still)[:, None]),
    }
    return Stretch(name, seen(t[1:-1]), axes)


def _derivatives(signal: Array) -> tuple[Array, Array]:
    """Central differences, 1/s and 1/s^2, of all but the first and the last sample."""
    slope = (signal[2:] - signal[:-2]) / (2.0 * GRID)
    return slope, (signal[2:] - 2.0 * signal[1:-1] + signal[:-2]) / GRID**2


class _Sent:
    """The inputs as they were sent, each held until the next, averaged over every interval of the grid."""

    def __init__(self, log: Log, t: Array) -> None:
        changes = 1e-9 * log.sent.time
        self._edges = np.append(changes, changes[-1] + np.median(np.diff(changes)))
        self._u = log.sent.u
        self._integral = np.vstack([np.zeros(4), np.cumsum(self._u * np.diff(self._edges)[:, None], axis=0)])
        self._bounds = np.append(t[1:-1], t[-1]) - 0.5 * GRID

    def __call__(self, axis: int, delay: float, lag: float) -> Array:
        """Input number `axis` (n,) that acts `delay` s late, of which `lag` s are a first-order lag."""
        t = self._bounds - (delay - lag)
        integral = np.interp(t, self._edges, self._integral[:, axis])
        if lag > 0.0:
            # lag s' = u - s: the integral of the lagged input s is that of u, less lag s.
            integral -= lag * self._lagged(axis, lag, t)
        return np.diff(integral) / GRID

    def _lagged(self, axis: int, lag: float, t: Array) -> Array:
        u = self._u[:, axis]
        reached = [float(u[0])]
        for target, fade in zip(u.tolist(), np.exp(-np.diff(self._edges) / lag).tolist(), strict=True):
            reached.append(target + (reached[-1] - target) * fade)
        i = np.clip(np.searchsorted(self._edges, t, side="right") - 1, 0, len(u) - 1)
        return u[i] + (np.array(reached)[i] - u[i]) * np.exp(-np.maximum(t - self._edges[i], 0.0) / lag)
