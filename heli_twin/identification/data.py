"""A flight as regression data: poses and sent commands, cleaned, on one grid, averaged by one smooth window.

The second derivative of a noisy pose is mostly noise. Here (1) is multiplied by a smooth window that slides along the
flight, and integrated (the weak form): speed, acceleration and input are averaged by the same window, which does not
change the relation between them and reduces the cameras' noise to a hundredth of the helicopter's motion.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from controllers.model import GRAVITY
from controllers.rotations import rotate_to_body, yaw_of
from controllers.signals import Array
from heli_twin.recording import Log

GRID_S = 0.01
"""Spacing of the grid on which poses are interpolated."""
WINDOW_S = 0.4
"""Length of the window: longer than the helicopter's lags, shorter than its manoeuvres."""
ROW_S = 0.1
"""Spacing of the rows of the regression."""
MAX_GAP_S = 0.1
"""Poses further apart than this end a stretch."""
MIN_STRETCH_S = 5.0
"""A shorter stretch is left out."""
WARM_UP_S = 1.0
"""Left out at the beginning of a log: delayed commands from before the log still act."""
MIN_HEIGHT_M = 0.2
"""Below this height the floor holds or lifts the helicopter, which (1) does not describe."""
MAX_JUMP_M, MAX_JUMP_RAD = 0.005, 0.05
"""A pose further than this from the median of its neighbours is an outlier, such as swapped markers."""


class Equation(NamedTuple):
    """One axis of (1) along a stretch, every column windowed: accel = b input + k speed + push."""

    accel: Array
    """(n,) acceleration; in z with gravity added."""
    input: Callable[[float, float], Array]
    """From a delay and the part of it that is a first-order lag, s, to the (n,) inputs that act then."""
    speed: Array | None
    """(n,) the speed that damping is proportional to; None in z."""
    push: Array
    """(n, m) directions of a constant push: along the axis, or fixed to the room while the helicopter turns."""


class Stretch(NamedTuple):
    """A part of a flight without gaps."""

    log: str
    """Name of the log."""
    time: Array
    """(n,) of the rows, s since the start of the flight."""
    axes: dict[str, Equation]
    """By axis x, y, z, yaw; an axis whose input the log does not have is not there."""


def stretches(log: Log, name: str) -> Iterator[Stretch]:
    """The usable parts of a flight: with poses, with commands, above the floor.

    Args:
        log: The flight. Only `/mocap/pose` and `/command/sent` are read, which a real lab records too.
        name: Name of the log in messages.
    """
    t, pose = _clean(log)
    if len(log.sent.time) < 2 or not len(t):
        return
    begin, end = 1e-9 * log.sent.time[0] + WARM_UP_S, 1e-9 * log.sent.time[-1]
    inside = (pose[:, 2] > MIN_HEIGHT_M) & (t > begin) & (t < end)
    breaks = np.flatnonzero(np.diff(t[inside]) > MAX_GAP_S) + 1
    for piece_t, piece in zip(np.split(t[inside], breaks), np.split(pose[inside], breaks), strict=True):
        if len(piece_t) and piece_t[-1] - piece_t[0] >= MIN_STRETCH_S:
            grid = np.arange(piece_t[0], piece_t[-1], GRID_S)
            yield _stretch(name, grid, np.stack([np.interp(grid, piece_t, column) for column in piece.T]), log)


def clean_poses(log: Log) -> tuple[Array, Array, Array]:
    """Return capture times (n,), s, positions (n, 3), m, and unit attitudes (n, 4) without outliers and repetitions.

    A mistaken marker moves or turns the body from one pose to the next. `identify` and `calibrate` clean alike.
    """
    stamp, first = np.unique(log.pose.stamp, return_index=True)
    q, position = log.pose.quat_wxyz[first], log.pose.position[first]
    finite = np.isfinite(position).all(axis=1) & np.isfinite(q).all(axis=1) & (np.abs(q).max(axis=1, initial=0) > 0.1)
    position, t = position[finite], 1e-9 * stamp[finite].astype(np.float64)
    unit = q[finite] / np.linalg.norm(q[finite], axis=1, keepdims=True)
    if len(position) < 5:
        return t[:0], position[:0], unit[:0]
    pose = np.column_stack([position, angles_of(unit)])
    around = np.lib.stride_tricks.sliding_window_view(np.pad(pose, ((2, 2), (0, 0)), mode="edge"), 5, axis=0)
    jump = np.abs(pose - np.median(around, axis=-1))
    steady = (jump[:, :3] < MAX_JUMP_M).all(axis=1) & (jump[:, 3:] < MAX_JUMP_RAD).all(axis=1)
    return t[steady], position[steady], unit[steady]


def angles_of(quat_wxyz: Array) -> Array:
    """Return yaw (unwrapped), pitch and roll (n, 3) of unit attitudes (n, 4)."""
    w, x, y, z = quat_wxyz.T
    pitch = np.arcsin(np.clip(2.0 * (w * y - x * z), -1.0, 1.0))
    roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    return np.asarray(np.column_stack([np.unwrap(yaw_of(quat_wxyz)), pitch, roll]), np.float64)


def _clean(log: Log) -> tuple[Array, Array]:
    """Capture times (n,), s, and poses (n, 5) without outliers: x y z yaw, vertical share of thrust."""
    t, position, unit = clean_poses(log)
    # Unwrapped again: an outlier in between may have cost a turn.
    upright = 1.0 - 2.0 * (unit[:, 1] ** 2 + unit[:, 2] ** 2)
    return t, np.column_stack([position, np.unwrap(yaw_of(unit)), upright])


def _stretch(name: str, t: Array, pose: Array, log: Log) -> Stretch:
    """The equations of one stretch.

    Two known effects that (1) leaves out are corrected, since they would bias the gains by 1 to 2 %: the horizontal
    force of a tilt is proportional to the thrust, and only the vertical share of the thrust lifts. Both factors are 1
    in hover.

    Args:
        name: Of the log.
        t: (n,) the grid, s.
        pose: (5, n) x y z yaw and the vertical share of thrust, on the grid.
        log: The flight.
    """
    x, y, z, yaw, upright = pose
    window = 1.0 + np.cos(np.linspace(-np.pi, np.pi, 2 * round(WINDOW_S / GRID_S / 2) + 1))
    window /= window.sum()
    every = round(ROW_S / GRID_S)

    def windowed(signal: Array) -> Array:
        return np.asarray(np.convolve(signal, window, "valid")[::every], np.float64)

    heading = np.convolve(np.pad(yaw, len(window) // 2, mode="edge"), window, "valid")[1:-1]
    up = upright[1:-1]
    (vx, vy, _, r), (ax, ay, az, ar) = zip(*map(_derivatives, (x, y, z, yaw)), strict=True)
    accel = rotate_to_body(np.column_stack([ax, ay]), heading)
    speed = rotate_to_body(np.column_stack([vx, vy]), heading)
    # A push of 1 m/s^2 to the north and one to the west, each along the nose and to port.
    pushes = [rotate_to_body(push, heading) for push in np.eye(2)]
    constant = windowed(np.ones_like(heading))[:, None]
    sent = _Sent(log, t)
    hover = float(np.mean(sent(2, 0.0, 0.0) * up))

    def tilting(axis: int) -> Callable[[float, float], Array]:
        if not np.isfinite(hover):
            # A recording without thrust commands: the thrust is taken to be that of hover.
            return lambda delay, lag: windowed(sent(axis, delay, lag))
        return lambda delay, lag: windowed(sent(axis, delay, lag) * sent(2, delay, lag) / hover)

    def planar(axis: int) -> Equation:
        push = np.column_stack([windowed(push[:, axis]) for push in pushes])
        return Equation(windowed(accel[:, axis]), tilting(axis), windowed(speed[:, axis]), push)

    def lifting(delay: float, lag: float) -> Array:
        return windowed(sent(2, delay, lag) * up)

    def turning(delay: float, lag: float) -> Array:
        return windowed(sent(3, delay, lag))

    axes = {
        "x": planar(0),
        "y": planar(1),
        "z": Equation(windowed(az + GRAVITY), lifting, None, constant),
        "yaw": Equation(windowed(ar), turning, windowed(r), constant),
    }
    known = np.asarray(np.isfinite(log.sent.u).all(axis=0))
    return Stretch(
        name, windowed(t[1:-1]), {axis: axes[axis] for axis, is_known in zip(axes, known, strict=True) if is_known}
    )


def _derivatives(signal: Array) -> tuple[Array, Array]:
    """First and second central differences, per s and s^2, at all samples but the first and the last."""
    slope = (signal[2:] - signal[:-2]) / (2.0 * GRID_S)
    return slope, (signal[2:] - 2.0 * signal[1:-1] + signal[:-2]) / GRID_S**2


class _Sent:
    """The inputs that were sent, each held until the next, averaged over every interval of the grid."""

    def __init__(self, log: Log, t: Array) -> None:
        changes = 1e-9 * log.sent.time
        self._edges = np.append(changes, changes[-1] + np.median(np.diff(changes)))
        self._u = log.sent.u
        self._integral = np.vstack([np.zeros(4), np.cumsum(self._u * np.diff(self._edges)[:, None], axis=0)])
        self._bounds = np.append(t[1:-1], t[-1]) - 0.5 * GRID_S

    def __call__(self, axis: int, delay: float, lag: float) -> Array:
        """Input number `axis` (n,), delayed by `delay` s, of which `lag` s are a first-order lag."""
        t = self._bounds - (delay - lag)
        integral = np.interp(t, self._edges, self._integral[:, axis])
        if lag > 0.0:
            # lag s' = u - s: the integral of the lagged input s is that of u, minus lag s.
            integral -= lag * self._lagged(axis, lag, t)
        return np.diff(integral) / GRID_S

    def _lagged(self, axis: int, lag: float, t: Array) -> Array:
        """Input number `axis` after a first-order lag (s), at times t (n,), s."""
        u = self._u[:, axis]
        reached = [float(u[0])]
        for target, fade in zip(u.tolist(), np.exp(-np.diff(self._edges) / lag).tolist(), strict=True):
            reached.append(target + (reached[-1] - target) * fade)
        i = np.clip(np.searchsorted(self._edges, t, side="right") - 1, 0, len(u) - 1)
        return u[i] + (np.array(reached)[i] - u[i]) * np.exp(-np.maximum(t - self._edges[i], 0.0) / lag)
