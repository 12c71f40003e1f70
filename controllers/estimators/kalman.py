"""Kalman filter on poses and command history, rolled forward to the moment the next command acts."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from math import atan2, cos, exp, isfinite, sin
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt, Le, Unit, doc

from controllers.model import Input, Model, Push, State, simulator
from controllers.pose_screen import Errors, PoseScreen, ScreenSettings
from controllers.rotations import wrap_angle
from controllers.signals import Array, Estimate, Pose, nanoseconds

FADE_AFTER_NS = 100_000_000
"""Time without a fused pose after which the disturbance fades; no pose of a sound lab is as late."""


@dataclass(frozen=True, slots=True)
class Kalman:
    """Per axis x y z yaw: position, velocity and a disturbance acceleration, driven by the model and the commands.

    `position_noise` covers the white and the slow error of the cameras. With these walks of velocity and yaw rate the
    filter's covariance is consistent in the lab: the NEES is 6.8 on hover and circle, where 8 is expected (`heli-twin
    reestimate`). Five refused poses in a row are 50 ms: in six times the lab's wind, a filter that waits for twenty
    predicts from a velocity that is no longer true.

    `withstand_faults`: a jump of the poses is believed only when it lasts for `jump_time` (see `pose_screen`), a
    heading that jumps by 180 degrees is turned back, poses that repeat the last one bit by bit are refused, and while
    no pose is fused the disturbance fades to its mean.
    """

    kind: Literal["kalman"] = "kalman"
    roll_forward: Annotated[bool, doc("predict on to when the command acts; off: take old poses for new")] = True
    command_delay: Annotated[float, Ge(0), Le(1), Unit("s"), doc("believed time from control step to effect")] = 0.022
    position_noise: Annotated[float, Gt(0), Unit("m"), doc("believed standard deviation of a position")] = 0.0005
    yaw_noise: Annotated[float, Gt(0), Unit("rad"), doc("believed standard deviation of a heading")] = 0.0052
    velocity_walk: Annotated[float, Gt(0), Unit("m/s/sqrt(s)"), doc("unmodelled acceleration, white")] = 0.05
    yaw_rate_walk: Annotated[float, Gt(0), Unit("rad/s/sqrt(s)"), doc("unmodelled yaw acceleration, white")] = 0.3
    disturbance_walk: Annotated[float, Ge(0), Unit("m/s^2/sqrt(s)"), doc("drift of the disturbance")] = 0.2
    yaw_disturbance_walk: Annotated[float, Ge(0), Unit("rad/s^2/sqrt(s)"), doc("drift of the yaw disturbance")] = 1.0
    gate: Annotated[float, Gt(0), doc("squared innovation over its variance that refuses a pose; 10.8 is 0.1 %")] = 10.8
    reset_after: Annotated[int, Ge(1), doc("refused poses in a row of which the last is believed, if none jumps")] = 5
    withstand_faults: Annotated[bool, doc("recognise poses that jump, flip or freeze; off: the gate alone")] = True
    jump_time: Annotated[float, Ge(0), Le(10), Unit("s"), doc("how long a jump has to last to be believed")] = 0.6
    stray_speed: Annotated[float, Gt(0), Unit("m/s"), doc("error of the predicted velocity that is no jump")] = 1.0
    stray_yaw_rate: Annotated[float, Gt(0), Unit("rad/s"), doc("error of the predicted yaw rate, no jump")] = 5.0
    # A gust fades in 0.7 s; what is wrong with the believed drag is gone when an unseen helicopter has stopped.
    gust_time: Annotated[float, Gt(0), Unit("s"), doc("time in which an unseen disturbance fades to its mean")] = 0.3
    mean_time: Annotated[float, Ge(0.001), Unit("s"), doc("time over which the mean disturbance is taken")] = 10.0
    # The skids reach 0.045 m below the centre of gravity.
    floor: Annotated[float, Ge(0), Unit("m"), doc("height of the centre of gravity when it stands on the floor")] = (
        0.045
    )

    @property
    def lead(self) -> float:
        """Time from the control step to the moment for which its estimates hold, s."""
        return self.command_delay if self.roll_forward else 0.0

    def start(self, model: Model) -> "KalmanFilter":
        """A filter for one flight that believes in `model`."""
        return KalmanFilter(self, model)


class KalmanFilter:
    """The filter of one flight: the state at the newest fused pose, its covariance, and the commands sent since."""

    def __init__(self, spec: Kalman, model: Model) -> None:
        self._spec = spec
        self._delay = nanoseconds(spec.command_delay)
        place, speed = spec.position_noise, spec.stray_speed
        noise, stray = (place, place, place, spec.yaw_noise), (speed, speed, speed, spec.stray_yaw_rate)
        self._R = [deviation**2 for deviation in noise]
        jump_time = nanoseconds(spec.jump_time)
        # Some millimetres are the cameras' error.
        self._stands_below = spec.floor + 0.003
        self._screen = PoseScreen(
            ScreenSettings(spec.gate, spec.reset_after, spec.withstand_faults, jump_time, noise, stray)
        )
        # Drag is taken along the world axes here: its share in the covariance of one frame is below 1 %.
        place = (spec.velocity_walk**2, spec.disturbance_walk**2)
        turn = (spec.yaw_rate_walk**2, spec.yaw_disturbance_walk**2)
        self._axes = [(model.k_x, *place), (model.k_y, *place), (0.0, *place), (model.k_yaw, *turn)]
        """Of each axis: damping, 1/s, and the growth of the variances of velocity and disturbance, per s."""
        # Cameras and commands keep time, so that the same few durations come back.
        self._simulator = lru_cache(64)(partial(simulator, model))
        self._transition = lru_cache(64)(self._transition_over)
        self._acting: deque[tuple[int, Input]] = deque([(-(1 << 62), model.u_hover)])
        self._x: State | None = None
        self._d = self._d_mean = (0.0, 0.0, 0.0, 0.0)
        self._mean_time, self._averaged = nanoseconds(spec.mean_time), 0
        """Time over which the mean disturbance is taken so far, ns."""
        self._P: Sequence[Spread] = ()
        self._stamp, self._age = -1, 0
        self._rejected = 0
        self._compared: tuple[Errors, Errors] | None = None

    def command_sent(self, now: int, u: Array) -> None:
        """Remember the input u (4,) decided at `now` (ns): it acts `command_delay` later."""
        ux, uy, uz, uyaw = u.tolist()
        self._acting.append((now + self._delay, (ux, uy, uz, uyaw)))

    def receive(self, now: int, pose: Pose) -> None:
        """Fuse a pose at its capture time.

        A pose that is stale, non-finite, frozen or outside the gate is refused.

        Args:
            now: When it arrived, ns.
            pose: What the cameras measured.
        """
        self._compared = None
        x, y, z = pose.position.tolist()
        yaw = heading(pose.quat_wxyz)
        if not isfinite(x + y + z + yaw) or pose.stamp <= self._stamp:
            self._rejected += 1
            return
        measured = (x, y, z, yaw)
        if self._x is None:
            self._restart(pose.stamp, (*measured, 0.0, 0.0, 0.0, 0.0))
        else:
            self._fuse(pose, measured)
        self._age = now - pose.stamp

    @property
    def innovation(self) -> tuple[Array, Array] | None:
        """Innovation (4,) of x y z yaw and its variance (4,), of the last pose that was compared with a prediction.

        Fused or refused, it is measured minus predicted.
        """
        return self._compared and (np.array(self._compared[0]), np.array(self._compared[1]))

    def estimate(self, now: int) -> Estimate | None:
        """The state at the time when a command sent at `now` acts.

        Without roll-forward, it is the state at the newest pose's capture, stamped `now`.

        Args:
            now: Control time, ns.

        Returns:
            The estimate; None before the first usable pose.
        """
        if self._x is None:
            return None
        stamp = now + self._delay if self._spec.roll_forward else now
        until = stamp if self._spec.roll_forward else now - self._age
        x = self._predict(self._x, self._stamp, until)
        variance = np.array([p for p00, _, _, p11, _, p22 in self._spread(until) for p in (p00, p11, p22)])
        push = np.array(self._push(until))
        return Estimate(stamp, np.array(x), push, variance.reshape(4, 3), self._stamp, self._rejected)

    def covariance(self, until: int) -> Array:
        """Covariances (4, 3, 3) of position, velocity and disturbance of each axis x y z yaw at `until` (ns)."""
        return np.array(self._spread(until))[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(4, 3, 3)

    def _restart(self, stamp: int, x: State) -> None:
        self._x, self._stamp, self._d = x, stamp, (0.0, 0.0, 0.0, 0.0)
        self._screen.restart(stamp)
        # The motion is unknown: 1 m/s, 3 rad/s, and 0.3 m/s^2 or 3 rad/s^2 of disturbance, standard deviations.
        motion = [(1.0, 0.09)] * 3 + [(9.0, 9.0)]
        self._P = [(R, 0.0, 0.0, velocity, 0.0, push) for R, (velocity, push) in zip(self._R, motion, strict=True)]

    def _fuse(self, pose: Pose, measured: Input) -> None:
        assert self._x is not None
        stamp, since = pose.stamp, self._stamp
        x, d = self._predict(self._x, since, stamp), self._push(stamp)
        mx, my, mz, m_yaw = measured
        innovation: Errors = (mx - x[0], my - x[1], mz - x[2], wrap_angle(m_yaw - x[3]))
        spread, R = self._spread(stamp), self._R
        S: Errors = (spread[0][0] + R[0], spread[1][0] + R[1], spread[2][0] + R[2], spread[3][0] + R[3])
        if self._screen.is_frozen(pose, innovation):
            self._rejected += 1
            return
        verdict, innovation = self._screen.judge(stamp, since, innovation, S)
        self._compared = innovation, S
        if verdict != "fuse":
            self._rejected += 1
            if verdict == "restart":
                # The predicted motion is still the best guess, but its covariance is not valid any more.
                self._restart(stamp, _corrected(x, innovation, (0.0, 0.0, 0.0, 0.0)))
            return
        self._P, changes = _fused(spread, S, innovation)
        (dx, dvx, dax), (dy, dvy, day), (dz, dvz, daz), (dyaw, dr, dar) = changes
        self._x = _corrected(x, (dx, dy, dz, dyaw), (dvx, dvy, dvz, dr))
        self._d = (d[0] + dax, d[1] + day, d[2] + daz, d[3] + dar)
        self._average(stamp - since)
        self._stamp = stamp
        while len(self._acting) > 1 and self._acting[1][0] <= stamp:
            self._acting.popleft()

    def _average(self, time: int) -> None:
        """Take the disturbance of the last `time` ns into its mean."""
        self._averaged = min(self._averaged + time, self._mean_time)
        share = min(time / self._averaged, 1.0)
        mx, my, mz, m_yaw = self._d_mean
        dx, dy, dz, d_yaw = self._d
        self._d_mean = (
            mx + share * (dx - mx),
            my + share * (dy - my),
            mz + share * (dz - mz),
            m_yaw + share * (d_yaw - m_yaw),
        )

    def _push(self, until: int) -> Push:
        """The disturbance that is expected at `until` (ns): in time without poses, the gust in it fades."""
        unseen = until - self._stamp - FADE_AFTER_NS
        if unseen <= 0 or not self._spec.withstand_faults:
            return self._d
        keep = exp(-1e-9 * unseen / self._spec.gust_time)
        mx, my, mz, m_yaw = self._d_mean
        dx, dy, dz, d_yaw = self._d
        return (mx + keep * (dx - mx), my + keep * (dy - my), mz + keep * (dz - mz), m_yaw + keep * (d_yaw - m_yaw))

    def _predict(self, x: State, start: int, until: int) -> State:
        """Integrate the believed model from `start` to `until` (ns) under the commands that act in between."""
        begin, acting = start, self._acting[0][1]
        for since, u in self._acting:
            if since >= until:
                break
            if since > begin:
                x, begin = self._moved(x, acting, begin, since), since
            acting = u
        return self._moved(x, acting, begin, until) if until > begin else x

    def _moved(self, x: State, u: Input, begin: int, end: int) -> State:
        """Integrate the believed model from `begin` to `end` (ns) under one input."""
        push = self._push(begin) if begin - self._stamp > FADE_AFTER_NS else self._d
        (moved,) = self._simulator((end - begin) * 1e-9)(x, (u,), push)
        return self._on_the_floor(x, moved) if moved[2] < self._stands_below and moved[6] < 0.0 else moved

    def _on_the_floor(self, x: State, moved: State) -> State:
        """The state of a helicopter that would sink into the floor: it stands, and its skids do not slide."""
        height = x[2] if x[2] < self._stands_below else max(moved[2], self._spec.floor)
        return (x[0], x[1], height, x[3], 0.0, 0.0, 0.0, 0.0)

    def _spread(self, until: int) -> "list[Spread]":
        """The covariances of each axis, predicted to `until` (ns)."""
        return _predicted(self._P, self._transition(max(until - self._stamp, 0)))

    def _transition_over(self, time: int) -> "list[Transition]":
        """Transition of the covariance of each axis over `time` ns."""
        dt, curve = 1e-9 * time, 0.5 * (1e-9 * time) ** 2
        return [
            (dt + curve * k, curve, 1.0 + dt * k + curve * k * k, dt + curve * k, dt * velocity_walk, dt * walk)
            for k, velocity_walk, walk in self._axes
        ]


Spread = tuple[float, float, float, float, float, float]
"""Covariance P of position, velocity and disturbance of one axis: p00 p01 p02 p11 p12 p22.

On Python floats, since NumPy takes twice as long for matrices as small as these.
"""
Transition = tuple[float, float, float, float, float, float]
"""a b c e of F = [[1, a, b], [0, c, e], [0, 0, 1]], and the variances that velocity and disturbance gain."""


# One call for all axes: a call takes as long as a third of the arithmetic of one.
def _predicted(spreads: Sequence[Spread], transitions: Sequence[Transition]) -> list[Spread]:
    """F P F' + W of each axis."""
    predicted: list[Spread] = []
    for P, transition in zip(spreads, transitions, strict=True):
        p00, p01, p02, p11, p12, p22 = P
        a, b, c, e, velocity_walk, walk = transition
        q01, q02, q12 = p01 + a * p11 + b * p12, p02 + a * p12 + b * p22, c * p12 + e * p22
        q00, q11 = p00 + a * (p01 + q01) + b * (p02 + q02), c * (c * p11 + e * p12) + e * q12 + velocity_walk
        predicted.append((q00, c * q01 + e * q02, q02, q11, q12, p22 + walk))
    return predicted


def _fused(
    spreads: Sequence[Spread], variances: Errors, innovations: Errors
) -> tuple[list[Spread], list[tuple[float, float, float]]]:
    """P of each axis after a position with an innovation, and the changes of position, velocity and disturbance.

    Args:
        spreads: P before.
        variances: Of the innovations.
        innovations: Measured minus predicted positions.
    """
    left: list[Spread] = []
    changes: list[tuple[float, float, float]] = []
    for (p00, p01, p02, p11, p12, p22), S, innovation in zip(spreads, variances, innovations, strict=True):
        k0, k1, k2 = p00 / S, p01 / S, p02 / S
        left.append((p00 - k0 * p00, p01 - k0 * p01, p02 - k0 * p02, p11 - k1 * p01, p12 - k1 * p02, p22 - k2 * p02))
        changes.append((k0 * innovation, k1 * innovation, k2 * innovation))
    return left, changes


def heading(quat_wxyz: Array) -> float:
    """The yaw of an attitude (4,), scalar first, rad in (-pi, pi]; NaN where the quaternion is far from unit length.

    Unlike `yaw_of`, it accepts a quaternion of any norm from 0.7 to 1.4, as trackers send them.
    """
    w, x, y, z = quat_wxyz.tolist()
    norm = w * w + x * x + y * y + z * z
    if not 0.5 < norm < 2.0:
        return float("nan")
    return atan2(2.0 * (w * z + x * y), norm - 2.0 * (y * y + z * z))


def _corrected(x: State, position: Input, velocity_world: Input) -> State:
    """Add corrections (4,) of x y z yaw and of their rates; the corrected yaw leaves the velocity in the world as is.

    Args:
        x: State, velocity in the body frame.
        position: Corrections of x y z (m) and yaw (rad).
        velocity_world: Corrections of their rates, world frame, m/s and rad/s.
    """
    c, s = cos(x[3]), sin(x[3])
    wx = c * x[4] - s * x[5] + velocity_world[0]
    wy = s * x[4] + c * x[5] + velocity_world[1]
    yaw = x[3] + position[3]
    c, s = cos(yaw), sin(yaw)
    return (
        x[0] + position[0],
        x[1] + position[1],
        x[2] + position[2],
        yaw,
        c * wx + s * wy,
        c * wy - s * wx,
        x[6] + velocity_world[2],
        x[7] + velocity_world[3],
    )
