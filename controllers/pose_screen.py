"""Which poses an estimator fuses, and when refused poses are believed after all.

A motion that the estimator did not foresee moves the poses away from the prediction step by step. A tracker that takes
one marker for another moves them at once: then the poses jump, and come back after a while.
"""

from math import pi
from typing import Literal, NamedTuple

import numpy as np

from controllers.rotations import wrap_angle
from controllers.signals import Array, Pose

Verdict = Literal["fuse", "refuse", "restart"]


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
    noise: Array
    """(4,) believed standard deviations of x y z (m) and yaw (rad)."""
    stray_rates: Array
    """(4,) errors of predicted velocities (m/s) and yaw rate (rad/s) that are no jump."""


class PoseScreen:
    """The screen of one flight."""

    def __init__(self, settings: ScreenSettings) -> None:
        self._settings = settings
        # Two poses differ by the noise of both.
        self._noise_reach = np.sqrt(2.0 * settings.gate) * settings.noise
        self._began = -1
        self._last_pose = b""
        self._last_stamp, self._last_innovation = -1, np.zeros(4)
        self._is_flipped = False
        self._refused_in_a_row, self._refused_since, self._has_jumped = 0, 0, False

    def restart(self, stamp: int) -> None:
        """Forget the refused poses: the estimator stands on the pose captured at `stamp` (ns)."""
        if self._began < 0:
            self._began = stamp
        self._last_stamp, self._last_innovation = stamp, np.zeros(4)
        self._refused_in_a_row, self._is_flipped = 0, False

    def is_frozen(self, pose: Pose, innovation: Array) -> bool:
        """Return whether a pose is the last one with a new stamp.

        No two poses of noisy cameras are equal. Those of exact cameras are where the helicopter stands still: then the
        prediction agrees to less than a thousandth of the believed noise.
        """
        last, self._last_pose = self._last_pose, pose.position.tobytes() + pose.quat_wxyz.tobytes()
        if not self._settings.withstand_faults or last != self._last_pose:
            return False
        return bool((np.abs(innovation) > 1e-3 * self._settings.noise).any())

    def judge(self, stamp: int, fused_stamp: int, innovation: Array, variance: Array) -> tuple[Verdict, Array]:
        """Decide whether a pose is used, corrected or refused.

        Args:
            stamp: When it was captured, ns.
            fused_stamp: The same of the newest fused pose.
            innovation: (4,) measured minus predicted x y z yaw.
            variance: (4,) of the innovation.

        Returns:
            The verdict, and the innovation (4,) to use: without the half turn if the heading is flipped.
        """
        last, time = self._last_innovation, stamp - self._last_stamp
        self._last_stamp, self._last_innovation = stamp, innovation
        if not self._outside(innovation, variance):
            self._refused_in_a_row, self._is_flipped = 0, False
            return "fuse", innovation
        is_smooth = self._within_reach(innovation - last, time)
        turned = innovation.copy()
        turned[3] = wrap_angle(innovation[3] + pi)
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

    def _outside(self, innovation: Array, variance: Array) -> bool:
        gate = self._settings.gate
        for error, allowed in zip(innovation.tolist(), variance.tolist(), strict=True):
            if error * error > gate * allowed:
                return True
        return False

    def _within_reach(self, moved: Array, time: int) -> bool:
        """Return whether a helicopter can stray so far from its prediction in a time (ns)."""
        moved = np.array([*moved[:3], wrap_angle(moved[3])])
        return bool((np.abs(moved) <= self._noise_reach + 1e-9 * time * self._settings.stray_rates).all())
