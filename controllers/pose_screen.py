"""Which poses an estimator fuses, and when refused poses are believed after all.

A motion that the estimator did not foresee moves the poses away from the prediction step by step. A tracker that takes
one marker for another moves them at once: then the poses jump, and come back after a while.
"""

from math import pi, sqrt
from typing import Literal, NamedTuple

from controllers.rotations import wrap_angle
from controllers.signals import Array, Pose

Verdict = Literal["fuse", "refuse", "restart"]
Errors = tuple[float, float, float, float]
"""Of x y z (m) and yaw (rad), or their variances."""


def errors(values: Array) -> Errors:
    """Return an array (4,) as plain numbers."""
    x, y, z, yaw = values.tolist()
    return x, y, z, yaw


class ScreenSettings(NamedTuple):
    """Settings of a screen."""

    gate: float
    """Squared innovation over its variance that refuses a pose."""
    reset_after: int
    """Refused poses in a row after which the estimator restarts."""
    withstand_faults: bool
    """Recognise poses that jump, flip or freeze."""
    jump_time: int
    """Duration of a jump after which the estimator restarts, ns."""
    noise: Errors
    """Believed standard deviations of x y z (m) and yaw (rad)."""
    stray_rates: Errors
    """Errors of predicted velocities (m/s) and yaw rate (rad/s) that are no jump."""


class PoseScreen:
    """The screen of one flight."""

    def __init__(self, settings: ScreenSettings) -> None:
        self._settings = settings
        # Two poses differ by the noise of both.
        self._noise_reach = [sqrt(2.0 * settings.gate) * noise for noise in settings.noise]
        self._began = -1
        self._last_pose = b""
        self._last_stamp, self._last_innovation = -1, _NO_ERRORS
        self._is_flipped = False
        self._refused_in_a_row, self._refused_since, self._has_jumped = 0, 0, False

    def restart(self, stamp: int) -> None:
        """Forget the refused poses: the estimator stands on the pose captured at `stamp` (ns)."""
        if self._began < 0:
            self._began = stamp
        self._last_stamp, self._last_innovation = stamp, _NO_ERRORS
        self._refused_in_a_row, self._is_flipped = 0, False

    def is_frozen(self, pose: Pose, innovation: Errors) -> bool:
        """Return whether a pose is the last one with a new stamp.

        No two poses of noisy cameras are equal. Those of exact cameras are where the helicopter stands still: then the
        prediction agrees to less than a thousandth of the believed noise.
        """
        if not self._settings.withstand_faults:
            return False
        last, self._last_pose = self._last_pose, pose.position.tobytes() + pose.quat_wxyz.tobytes()
        if last != self._last_pose:
            return False
        return any(abs(e) > 1e-3 * noise for e, noise in zip(innovation, self._settings.noise, strict=True))

    def judge(self, stamp: int, fused_stamp: int, innovation: Errors, variance: Errors) -> tuple[Verdict, Errors]:
        """Decide whether a pose is used, corrected or refused.

        Args:
            stamp: When it was captured, ns.
            fused_stamp: The same of the newest fused pose.
            innovation: Measured minus predicted x y z yaw.
            variance: Of the innovation.

        Returns:
            The verdict, and the innovation to use: without the half turn if the heading is flipped.
        """
        last, time = self._last_innovation, stamp - self._last_stamp
        self._last_stamp, self._last_innovation = stamp, innovation
        if not self._outside(innovation, variance):
            self._refused_in_a_row, self._is_flipped = 0, False
            return "fuse", innovation
        x, y, z, yaw = innovation
        is_smooth = self._within_reach((x - last[0], y - last[1], z - last[2], yaw - last[3]), time)
        turned: Errors = (x, y, z, wrap_angle(yaw + pi))
        # The first pose may have been the wrong one.
        is_settled = self._settings.withstand_faults and stamp - self._began >= self._settings.jump_time
        # A half turn that comes at once is the tracker's mistake.
        may_be_flipped = is_settled and (self._is_flipped or not is_smooth)
        if may_be_flipped and not self._outside(turned, variance):
            self._refused_in_a_row, self._is_flipped = 0, True
            return "fuse", turned
        if is_settled and not is_smooth:
            self._refused_in_a_row = 0
        if self._refused_in_a_row == 0:
            self._refused_since = stamp
            self._has_jumped = not self._within_reach(innovation, stamp - fused_stamp)
        self._refused_in_a_row += 1
        if self._has_jumped and is_settled:
            believed = stamp - self._refused_since >= self._settings.jump_time
        else:
            believed = self._refused_in_a_row >= self._settings.reset_after
        return ("restart" if believed else "refuse"), innovation

    def _outside(self, innovation: Errors, variance: Errors) -> bool:
        gate, (x, y, z, yaw), (var_x, var_y, var_z, var_yaw) = self._settings.gate, innovation, variance
        return x * x > gate * var_x or y * y > gate * var_y or z * z > gate * var_z or yaw * yaw > gate * var_yaw

    def _within_reach(self, moved: Errors, time: int) -> bool:
        """Return whether a helicopter can stray so far from its prediction in a time (ns)."""
        moved = (*moved[:3], wrap_angle(moved[3]))
        reach = zip(moved, self._noise_reach, self._settings.stray_rates, strict=True)
        return all(abs(way) <= noise + 1e-9 * time * rate for way, noise, rate in reach)


_NO_ERRORS: Errors = (0.0, 0.0, 0.0, 0.0)
