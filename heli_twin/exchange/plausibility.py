"""Plausibility of a recording: wrong axes, wrong units and mirrored axes are recognised and refused."""

import numpy as np

from controllers.signals import Array
from heli_twin.exchange.cleaning import Clean, clean
from heli_twin.exchange.formats import ImportRefused, Take
from heli_twin.exchange.frames import FRAMES

FARTHEST_M = 100.0
"""The farthest that cameras in a room can see."""
FASTEST_M_S = 30.0
TILT_LIMIT_RAD = np.radians(50.0)
"""Of the mean tilt: a helicopter that hovers or cruises leans less."""
BELOW_FLOOR_M, BELOW_FLOOR_SHARE = -0.3, 0.2
"""A room's origin may stand a little above its floor."""
CLEAR_ACCELERATION_M_S2, MIRRORED = 0.1, -0.6
"""Rms acceleration that tells something, and the cosine between it and the lean that only a mirror explains."""
G = 9.81


def check_plausible(take: Take, recording: Clean, frame: str, unit: str, rate: float) -> None:
    """Refuse a recording that no helicopter in a room can have left.

    Args:
        take: As its file has it, to try other axes.
        recording: The same, cleaned with these axes and units.
        frame: Of its axes; empty for the take's own.
        unit: Of its lengths; empty for the take's own.
        rate: As for `clean`.

    Raises:
        ImportRefused: One sentence that names the flag that mends it.
    """
    far = float(np.abs(recording.position).max())
    if far > FARTHEST_M:
        hint = "mm" if far < 1000.0 * FARTHEST_M else "no length"
        raise ImportRefused(
            f"a position is {far:.4g} m from the origin, {FARTHEST_M:g} m at most: is it in {hint}? Then say --units mm"
        )
    speed = _median_speed(recording)
    if speed > FASTEST_M_S:
        raise ImportRefused(
            f"half of the time it flies faster than {speed:.3g} m/s, {FASTEST_M_S:g} at most: say --units"
        )
    tilt, below = _mean_tilt(recording.quat_wxyz), float(np.mean(recording.position[:, 2] < BELOW_FLOOR_M))
    if tilt > TILT_LIMIT_RAD or below > BELOW_FLOOR_SHARE:
        better = _better_frame(take, frame or take.frame, unit, rate)
        advice = f"say --frame {better}" if better else f"say --frame, one of {', '.join(FRAMES)}"
        raise ImportRefused(
            f"its mean tilt is {np.degrees(tilt):.0f} deg, and {100 * below:.0f} % of it is below the floor: the axes"
            f" are not {FRAMES[frame or take.frame].text}; {advice}"
        )
    _check_handedness(recording)


def _median_speed(recording: Clean) -> float:
    if len(recording.time) < 2:
        return 0.0
    return float(np.median(np.linalg.norm(np.diff(recording.position, axis=0), axis=1) / np.diff(recording.time)))


def _up(quat_wxyz: Array) -> Array:
    """The body's up axis in the world (n, 3)."""
    w, x, y, z = quat_wxyz.T
    return np.column_stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])


def _mean_tilt(quat_wxyz: Array) -> float:
    return float(np.mean(np.arccos(np.clip(_up(quat_wxyz)[:, 2], -1.0, 1.0))))


def _better_frame(take: Take, present: str, unit: str, rate: float) -> str:
    """The axes in which the helicopter is upright and above the floor; empty if there are none."""
    for name in FRAMES:
        if name == present:
            continue
        other = clean(take, frame=name, unit=unit, rate=rate)
        below = np.mean(other.position[:, 2] < BELOW_FLOOR_M)
        if _mean_tilt(other.quat_wxyz) <= TILT_LIMIT_RAD and below <= BELOW_FLOOR_SHARE:
            return name
    return ""


def _check_handedness(recording: Clean) -> None:
    """A helicopter accelerates to where it leans; where one axis says the contrary, it is mirrored."""
    time, position = recording.time, recording.position
    if len(time) < 50 or time[-1] < 2.0:
        return
    # Half a second each side: slower than camera noise, faster than a manoeuvre.
    grid = np.arange(time[0], time[-1], 0.05)
    smooth = np.column_stack([_smoothed(np.interp(grid, time, position[:, i])) for i in range(2)])
    lean = np.column_stack([_smoothed(np.interp(grid, time, _up(recording.quat_wxyz)[:, i])) for i in range(2)])
    acceleration = np.gradient(np.gradient(smooth, 0.05, axis=0), 0.05, axis=0)[10:-10]
    lean = G * lean[10:-10]
    size, leaning = np.sqrt(np.mean(acceleration**2, axis=0)), np.sqrt(np.mean(lean**2, axis=0))
    if not len(lean) or (size < CLEAR_ACCELERATION_M_S2).any() or (leaning < CLEAR_ACCELERATION_M_S2).any():
        return
    cosine = np.mean(acceleration * lean, axis=0) / (size * leaning)
    if (cosine < MIRRORED).any() and not (cosine < MIRRORED).all():
        axis = "north" if cosine[0] < MIRRORED else "west"
        raise ImportRefused(
            f"it accelerates {axis} when it leans the other way: an axis is mirrored, export right-handed axes"
        )


def _smoothed(values: Array) -> Array:
    return np.convolve(np.pad(values, 5, mode="edge"), np.full(11, 1 / 11), mode="valid")
