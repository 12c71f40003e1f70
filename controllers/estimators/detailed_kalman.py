"""Kalman filter with the detailed model: attitude from the cameras, servos from the commands, gusts as a state."""

from collections import deque
from dataclasses import dataclass
from functools import lru_cache
from math import exp, isfinite
from typing import Annotated, Literal, NamedTuple

import numpy as np
from annotated_types import Ge, Gt, Le, Unit, doc

from controllers.detailed_model import ESTIMATED_STATES, GUST, PUSH, TRIM, A, DetailedModel, J, P, S, V, step
from controllers.detailed_motion import IN_WORLD, Motion, advance, tilt_of, turn
from controllers.estimators.kalman import heading
from controllers.model import GRAVITY, Model
from controllers.pose_screen import PoseScreen, ScreenSettings, errors
from controllers.rotations import wrap_angle
from controllers.servo_play import ServoPlay
from controllers.signals import Array, Estimate, NamedState, Pose, nanoseconds

_FILTERED = [P, V, A, J, GUST, TRIM, PUSH]
"""Columns of a horizontal axis that the filter corrects, before the cameras' slow error. The servo is known."""
_A, _GUST, _PUSH = 2, 4, 6
"""Places of some of them among the filtered ones; position comes first, the cameras' slow error last."""
_SHOWN = np.zeros((3, 8))
_SHOWN[0, 0] = _SHOWN[1, 1] = _SHOWN[2, _GUST] = _SHOWN[2, _PUSH] = 1.0
"""Position, velocity and the whole disturbance from the filtered columns."""


@dataclass(frozen=True, slots=True)
class DetailedKalman:
    """Per horizontal axis: position, velocity, tilt, jerk, gust, trim and push; per z and yaw as the plain filter.

    The gust is an Ornstein-Uhlenbeck process with the model's strength and time; trim and push are almost constant. The
    covariance is that of axes along and across the heading: a slow turn does not change it. The cameras' slow error is
    a state too: without it, the filter would trust its position too much.

    With these walks the covariance is consistent in `lab_simple`: the NEES of position and velocity is 7.5 to 8.7 on
    hover, circle and lemniscate, where 8 is expected, the NIS 3.9 of 4 (`heli-twin reestimate`). `tilt_walk` is larger
    than the twin needs, so that a loop whose attitude is slower or faster than believed stays away from a limit cycle.

    A law whose model is the paper's is served with the defaults of the detailed one.
    """

    kind: Literal["detailed_kalman"] = "detailed_kalman"
    command_delay: Annotated[float, Ge(0), Le(1), Unit("s"), doc("believed time from control step to effect")] = 0.022
    position_noise: Annotated[float, Gt(0), Unit("m"), doc("believed white noise of a position")] = 0.0003
    camera_bias: Annotated[float, Ge(0), Unit("m"), doc("believed slow error of a position")] = 0.0005
    camera_bias_time: Annotated[float, Gt(0), Unit("s"), doc("time in which the slow error changes")] = 5.0
    angle_noise: Annotated[float, Gt(0), Unit("rad"), doc("the same of heading and tilt")] = 0.0052
    velocity_walk: Annotated[float, Ge(0), Unit("m/s/sqrt(s)"), doc("unmodelled acceleration in the plane")] = 0.005
    tilt_walk: Annotated[float, Ge(0), Unit("m/s^3/sqrt(s)"), doc("unmodelled moment, as jerk")] = 1.0
    trim_walk: Annotated[float, Ge(0), Unit("1/sqrt(s)"), doc("drift of the trim, full stick")] = 0.005
    push_walk: Annotated[float, Ge(0), Unit("m/s^2/sqrt(s)"), doc("drift of the push in the plane")] = 0.01
    climb_walk: Annotated[float, Ge(0), Unit("m/s/sqrt(s)"), doc("unmodelled acceleration upwards")] = 0.02
    yaw_rate_walk: Annotated[float, Ge(0), Unit("rad/s/sqrt(s)"), doc("unmodelled yaw acceleration")] = 0.1
    lift_walk: Annotated[float, Ge(0), Unit("m/s^2/sqrt(s)"), doc("drift of the push upwards")] = 0.4
    yaw_push_walk: Annotated[float, Ge(0), Unit("rad/s^2/sqrt(s)"), doc("drift of the yaw disturbance")] = 0.5
    gate: Annotated[float, Gt(0), doc("squared innovation over its variance that refuses a pose; 10.8 is 0.1 %")] = 10.8
    reset_after: Annotated[int, Ge(1), doc("refused poses in a row of which the last is believed, if none jumps")] = 5
    jump_time: Annotated[float, Ge(0), Le(10), Unit("s"), doc("how long a jump has to last to be believed")] = 0.6
    stray_speed: Annotated[float, Gt(0), Unit("m/s"), doc("error of the predicted velocity that is no jump")] = 1.0
    stray_yaw_rate: Annotated[float, Gt(0), Unit("rad/s"), doc("error of the predicted yaw rate, no jump")] = 5.0
    floor: Annotated[float, Ge(0), Unit("m"), doc("height of the centre of gravity when it stands on the floor")] = (
        0.045
    )

    @property
    def lead(self) -> float:
        """Time from the control step to the moment for which its estimates hold, s."""
        return self.command_delay

    @property
    def extra_states(self) -> tuple[NamedState, ...]:
        """Those of the detailed model, then gust (world) and trim."""
        return ESTIMATED_STATES

    def start(self, model: Model) -> "DetailedKalmanFilter":
        """A filter for one flight that believes in `model`."""
        return DetailedKalmanFilter(self, DetailedModel.of(model))


class Spread(NamedTuple):
    """Covariances of the errors."""

    plane: Array
    """(2, 8, 8) of the filtered columns of each axis and the cameras' slow error."""
    chains: Array
    """(2, 4, 4) of z and yaw: position, velocity, push and the cameras' slow error."""


class DetailedKalmanFilter:
    """The filter of one flight: mean and covariance at the newest fused pose, and the commands sent since."""

    def __init__(self, spec: DetailedKalman, model: DetailedModel) -> None:
        self._spec, self._model = spec, model
        self._delay, self._play = nanoseconds(spec.command_delay), ServoPlay(model.servo_play)
        white = np.array([spec.position_noise] * 3 + [spec.angle_noise])
        slow = np.array([spec.camera_bias] * 3 + [0.0])
        self._R, noise = white**2, np.hypot(white, slow)
        self._tilt_variance = (GRAVITY * spec.angle_noise) ** 2
        speed, jump_time = spec.stray_speed, nanoseconds(spec.jump_time)
        stray = (speed, speed, speed, spec.stray_yaw_rate)
        self._screen = PoseScreen(ScreenSettings(spec.gate, spec.reset_after, True, jump_time, errors(noise), stray))
        # Some millimetres are the cameras' error.
        self._stands_below = spec.floor + 0.003
        self._transition = lru_cache(64)(self._transition_over)
        self._acting: deque[tuple[int, Array]] = deque([(-(1 << 62), np.array(model.u_hover))])
        self._motion: Motion | None = None
        self._spread = self._unknown()
        self._stamp, self._rejected = -1, 0
        self.innovation: tuple[Array, Array] | None = None
        """Of the last pose that was compared with a prediction, fused or refused: measured minus predicted x y z yaw
        (4,), and its variance (4,)."""
        self.tilt_innovation: tuple[Array, Array] | None = None
        """Of the last pose, if it was fused: measured minus predicted acceleration by tilt, ahead and to port, m/s^2
        (2,), and its variance (2,)."""

    def command_sent(self, now: int, u: Array) -> None:
        """Remember the input u (4,) decided at `now` (ns): it acts `command_delay` later."""
        self._acting.append((now + self._delay, self._play.follow(u)))

    def receive(self, now: int, pose: Pose) -> None:
        """Fuse a pose at its capture time; one that is stale, non-finite, frozen or outside the gate is refused."""
        self.innovation = self.tilt_innovation = None
        yaw = heading(pose.quat_wxyz)
        if not isfinite(yaw + float(pose.position.sum())) or pose.stamp <= self._stamp:
            self._rejected += 1
        elif self._motion is None:
            u, model = self._model.u_hover, self._model
            at_rest = np.zeros((2, 9))
            z = np.array([pose.position[2], 0.0, model.b_z * u[2], -GRAVITY])
            yaw_at_rest = np.array([yaw, 0.0, 0.0, 0.0])
            self._restart(pose.stamp, Motion(pose.position[:2].copy(), at_rest, z, yaw_at_rest, np.zeros(3)))
        else:
            self._fuse(pose, yaw)

    def estimate(self, now: int) -> Estimate | None:
        """The state at the time when a command sent at `now` (ns) acts; None before the first usable pose."""
        if self._motion is None:
            return None
        stamp = now + self._delay
        position, plane, z, yaw, _ = self._predict(self._motion, self._stamp, stamp)
        spread = self._spread_at(stamp)
        turned = turn(yaw[0])
        gust, push = plane[:, GUST], plane[:, PUSH]
        x = np.array([*position, z[0], yaw[0], *(turned @ plane[:, V]), z[1], yaw[1]])
        disturbance = np.array([*(gust + push), z[3] + GRAVITY, yaw[3]])
        variances = spread.plane.diagonal(axis1=1, axis2=2)
        known = np.zeros(1)
        extra = np.concatenate([plane[0, A : S + 1], plane[1, A : S + 1], z[2:3], yaw[2:3], gust, plane[:, TRIM]])
        extra_variance = np.concatenate(
            [variances[0, 2:4], known, variances[1, 2:4], known, known, known, variances[:, _GUST], variances[:, 5]]
        )
        variance = self.covariance(stamp).diagonal(axis1=1, axis2=2).copy()
        return Estimate(stamp, x, disturbance, variance, self._stamp, self._rejected, extra, extra_variance)

    def covariance(self, until: int) -> Array:
        """Covariances (4, 3, 3) of position, velocity and disturbance of each axis x y z yaw at `until` (ns)."""
        spread = self._spread_at(until)
        return np.concatenate([_SHOWN @ spread.plane @ _SHOWN.T, spread.chains[:, :3, :3]])

    def _unknown(self) -> Spread:
        """The covariance when only one pose is known: 1 m/s, 3 rad/s, and a thrust that is 2 m/s^2 more or less."""
        gust, slow = self._model.gust_acceleration, self._spec.camera_bias**2
        plane = np.zeros((2, 8, 8))
        for axis in (0, 1):
            np.fill_diagonal(plane[axis], [self._R[0], 1.0, 0.1, 1.0, gust[axis] ** 2, 0.01, 0.09, slow])
        chains = np.stack([np.diag([self._R[2], 1.0, 4.0, slow]), np.diag([self._R[3], 9.0, 9.0, 0.0])])
        return Spread(plane, chains)

    def _restart(self, stamp: int, motion: Motion) -> None:
        self._motion, self._stamp = motion, stamp
        self._screen.restart(stamp)
        self._spread = self._unknown()

    def _fuse(self, pose: Pose, measured_yaw: float) -> None:
        assert self._motion is not None
        stamp, since = pose.stamp, self._stamp
        motion, spread = self._predict(self._motion, since, stamp), self._spread_at(stamp)
        turned = turn(motion.yaw[0])
        ahead, aside = turned @ (pose.position[:2] - motion.position) - motion.camera_bias[:2]
        above = pose.position[2] - motion.z[0] - motion.camera_bias[2]
        innovation = np.array([ahead, aside, above, wrap_angle(measured_yaw - motion.yaw[0])])
        variance = np.concatenate([_seen(spread.plane)[1], _seen(spread.chains)[1]]) + self._R
        found = errors(innovation)
        if self._screen.is_frozen(pose, found):
            self._rejected += 1
            return
        verdict, found = self._screen.judge(stamp, since, found, errors(variance))
        innovation = np.array(found)
        self.innovation = innovation, variance
        if verdict != "fuse":
            self._rejected += 1
            if verdict == "restart":
                # The predicted motion is still the best guess, but its covariance is not valid any more.
                plane = motion.plane.copy()
                plane[:, [GUST, PUSH]] = 0.0
                position, z, yaw = motion.position + turned.T @ innovation[:2], motion.z.copy(), motion.yaw.copy()
                z[0] += innovation[2]
                yaw[0] += innovation[3]
                # A push upwards is mostly a wrong thrust, which lasts; it may be large just after the start.
                yaw[3] = 0.0
                self._restart(stamp, Motion(position, plane, z, yaw, np.zeros(3)))
            return
        self._correct(motion, spread, turned, innovation, pose.quat_wxyz)
        self._stamp = stamp
        while len(self._acting) > 1 and self._acting[1][0] <= stamp:
            self._acting.popleft()

    def _correct(self, motion: Motion, spread: Spread, turned: Array, innovation: Array, quat_wxyz: Array) -> None:
        """Fuse position and heading, then the tilt, unless the tilt alone is outside the gate."""
        # Of z and yaw.
        C = spread.chains
        seen, variance = _seen(C)
        K = seen / (variance + self._R[2:])[:, None]
        (z0, z1, z3, z_bias), (yaw0, yaw1, yaw3, _) = K * innovation[2:, None]
        C = C - K[:, :, None] * seen[:, None, :]
        # Of the plane, axis by axis in the turned frame.
        S_ = spread.plane
        seen, variance = _seen(S_)
        K = seen / (variance + self._R[:2])[:, None]
        change = K * innovation[:2, None]
        S_ = S_ - K[:, :, None] * seen[:, None, :]
        tilt = turned @ (GRAVITY * tilt_of(quat_wxyz)) - motion.plane[:, A] - change[:, _A]
        variance = S_[:, _A, _A] + self._tilt_variance
        self.tilt_innovation = tilt, variance
        if (tilt * tilt <= 4.0 * self._spec.gate * variance).all():
            K = S_[:, :, _A] / variance[:, None]
            change += K * tilt[:, None]
            S_ = S_ - K[:, :, None] * S_[:, None, _A, :]
        plane = motion.plane.copy()
        world = turned.T @ change[:, [0, 1, _GUST, _PUSH]]
        plane[:, [A, J, TRIM]] += change[:, [2, 3, 5]]
        plane[:, IN_WORLD] += world[:, 1:]
        self._motion = Motion(
            motion.position + world[:, 0],
            plane,
            motion.z + np.array([z0, z1, 0.0, z3]),
            motion.yaw + np.array([yaw0, yaw1, 0.0, yaw3]),
            motion.camera_bias + np.array([*change[:, -1], z_bias]),
        )
        self._spread = Spread(S_, C)

    def _predict(self, motion: Motion, start: int, until: int) -> Motion:
        """The motion from `start` to `until` (ns) under the commands that act in between."""
        pieces = self._acting
        for i, (since, u) in enumerate(pieces):
            end = min(until, pieces[i + 1][0]) if i + 1 < len(pieces) else until
            begin = max(start, since)
            if end > begin:
                moved = advance(step(self._model, (end - begin) * 1e-9), motion, u)
                if moved.z[0] < self._stands_below and moved.z[1] < 0.0:
                    moved = self._on_the_floor(motion, moved)
                motion = moved
        return motion

    def _on_the_floor(self, before: Motion, moved: Motion) -> Motion:
        """The motion of a helicopter that would sink into the floor: it stands, and its skids do not slide."""
        height = before.z[0] if before.z[0] < self._stands_below else max(float(moved.z[0]), self._spec.floor)
        plane, z = moved.plane.copy(), moved.z.copy()
        plane[:, [V, A, J]] = 0.0
        z[:2] = height, 0.0
        return moved._replace(
            position=before.position, plane=plane, z=z, yaw=np.array([before.yaw[0], 0.0, *moved.yaw[2:]])
        )

    def _spread_at(self, until: int) -> Spread:
        """The covariances, predicted to `until` (ns)."""
        ahead = until - self._stamp
        if ahead <= 0:
            return self._spread
        (F, Q), (F_chains, Q_chains) = self._transition(ahead)
        return Spread(
            F @ self._spread.plane @ F.transpose(0, 2, 1) + Q,
            F_chains @ self._spread.chains @ F_chains.transpose(0, 2, 1) + Q_chains,
        )

    def _transition_over(self, ahead: int) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """Transitions and process noise of plane (2, 8, 8) and of z and yaw (2, 4, 4) over a time, ns."""
        spec, model, dt = self._spec, self._model, ahead * 1e-9
        solution, keep = step(model, dt), exp(-dt / spec.camera_bias_time)
        slow = spec.camera_bias**2 * (1.0 - keep * keep)
        F, Q = np.zeros((2, 8, 8)), np.zeros((2, 8, 8))
        F[:, 5, 5] = F[:, 6, 6] = 1.0
        F[:, 7, 7] = keep
        F[:, :5, :7] = solution.plane[:, [P, V, A, J, GUST]][:, :, _FILTERED]
        fading = 1.0 - exp(-2.0 * dt / model.gust_time)
        walks = np.array([0.0, spec.velocity_walk, 0.0, spec.tilt_walk, 0.0, spec.trim_walk, spec.push_walk]) ** 2 * dt
        for noise, gust in zip(Q, model.gust_acceleration, strict=True):
            np.fill_diagonal(noise, [*walks, slow])
            noise[_GUST, _GUST] = gust * gust * fading
        chains, Q_chains = np.zeros((2, 4, 4)), np.zeros((2, 4, 4))
        chains[:, 2, 2], chains[:, 3, 3] = 1.0, keep
        for transition, rows in zip(chains, (solution.z, solution.yaw), strict=True):
            transition[:2, :3] = rows[:2, [0, 1, 3]]
        np.fill_diagonal(Q_chains[0], [0.0, spec.climb_walk**2 * dt, spec.lift_walk**2 * dt, slow])
        np.fill_diagonal(Q_chains[1], [0.0, spec.yaw_rate_walk**2 * dt, spec.yaw_push_walk**2 * dt, 0.0])
        return (F, Q), (chains, Q_chains)


def _seen(covariance: Array) -> tuple[Array, Array]:
    """Covariances (m, n) of m camera readings (position plus slow error) with n states each, and variances (m,)."""
    seen = covariance[:, 0] + covariance[:, -1]
    return seen, seen[:, 0] + seen[:, -1]
