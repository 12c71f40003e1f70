"""The twin's equations in NumPy, for many windows and many parameters at once.

They are those of `heli_twin.lab.plant.mujoco` with the effects hub drag, ground effect, thrust-yaw coupling and
battery, and they are integrated as MuJoCo does: semi-implicit Euler, joint damping implicit.
With q = (yaw, pitch, roll), all
torques divided by Iyy and I = diag(Ixx, Iyy, Izz) / Iyy:

    M(q) q'' = J' torque_body + torque_joint - J' (I dJ/dt q' + omega x I omega),   omega = J q',   M = J' I J
    v' = T/m R e_z - R_yaw diag(drag / m) R_yaw' v + push - g e_z

A test holds them against MuJoCo.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from controllers.model import GRAVITY
from controllers.signals import Array
from heli_twin.calibration.data import BIN_STEPS, STEP_S
from heli_twin.calibration.parameters import INDEX, ROTOR_RADIUS_M, Lab, values

LOWER_HUB_M, DAMPING_LOSS = 0.028, 3.0
"""Of the ground effect: see the plant effect `ground_effect`."""


class Lanes(NamedTuple):
    """The states that are simulated side by side: p variants of w windows."""

    theta: Array
    """(p, n) the fit's vectors."""
    start: Array
    """(p, w, 12) first states: position, velocity, yaw pitch roll, and their rates."""
    push: Array
    """(p, w, 3) acceleration, world, m/s^2."""
    drive: Array
    """(steps, d, 4, w) pitch, roll, thrust per mass, yaw of d different drives."""
    which: NDArray[np.int64]
    """(p,) the drive of each variant."""
    wind: Array | None = None
    """(p, w, 2) m/s; None: still air."""


class Transitions(NamedTuple):
    """The equations linearised along each window. State: pose (x y z yaw pitch roll), then its rates."""

    state: Array
    """(w, bins, 12, 12) from the start of a bin to its end."""
    state_by_wind: Array
    """(w, bins, 12, 2) of a wind that blows for the bin, north and west."""
    pose: Array
    """(w, bins, 6, 12) of the bin's mean pose by the state at its start."""
    pose_by_wind: Array
    """(w, bins, 6, 2)."""


DELTA = np.array([1e-3] * 6 + [1e-2] * 6 + [1e-2] * 2)
"""Steps of the differences: poses, rates, wind."""
STRIDE = 4
"""Steps at once where the equations are linearised: good enough for a covariance and for derivatives."""


def simulate(lanes: Lanes, weights: Array, early: Array, lab: Lab, stride: int = 1) -> Array:
    """Return the mean pose of each bin (p, w, bins, 6): x y z yaw pitch roll of the centre of gravity.

    Args:
        lanes: What to simulate.
        weights: (w, steps + 1) share of each step in its bin.
        early: (w, bins) share of the first step after each bin.
        lab: The build.
        stride: Steps at once.
    """
    p, w = lanes.push.shape[:2]
    step, in_bin = _stepper(lanes, lab, stride * STEP_S), BIN_STEPS // stride
    drive, weights, early = _coarse(lanes.drive, weights, early, stride)
    seen, seen_early = (np.asarray(a.any(axis=0)).tolist() for a in (weights, early))
    pose, rate = _split(np.ascontiguousarray(np.moveaxis(lanes.start, -1, 0)))
    out = np.zeros((early.shape[1], 6, p, w))
    for k in range(len(drive)):
        if seen[k]:
            out[k // in_bin] += weights[:, k] * pose
        step(pose, rate, drive[k][lanes.which])
        if (k + 1) % in_bin == 0 and seen_early[k // in_bin]:
            out[k // in_bin] += early[:, k // in_bin] * pose
    return np.moveaxis(out, (0, 1), (2, 3))


def transitions(lanes: Lanes, weights: Array, early: Array, lab: Lab) -> Transitions:
    """Return the equations linearised along the windows of one variant; arguments as in `simulate`."""
    w, n = lanes.push.shape[1], len(DELTA)
    wind = np.zeros((1 + n, w, 2))
    wind[n - 1, :, 0], wind[n, :, 1] = DELTA[-2:]
    many = Lanes(
        np.broadcast_to(lanes.theta, (1 + n, lanes.theta.shape[1])),
        np.broadcast_to(lanes.start, (1 + n, w, 12)),
        np.broadcast_to(lanes.push, (1 + n, w, 3)),
        lanes.drive,
        np.zeros(1 + n, np.int64),
        wind,
    )
    step = _stepper(many, lab, STRIDE * STEP_S)
    drive, weights, early = _coarse(lanes.drive, weights, early, STRIDE)
    pose, rate = _split(np.ascontiguousarray(np.moveaxis(many.start, -1, 0)))
    bins, in_bin = early.shape[1], BIN_STEPS // STRIDE
    end, mean = np.empty((bins, 12, n, w)), np.empty((bins, 6, n, w))
    for k in range(bins):
        pose[:, 1:], rate[:, 1:] = pose[:, :1], rate[:, :1]
        for i in range(6):
            pose[i, 1 + i] += DELTA[i]
            rate[i, 7 + i] += DELTA[6 + i]
        seen = np.zeros_like(pose)
        for j in range(k * in_bin, (k + 1) * in_bin):
            seen += weights[:, j] * pose
            step(pose, rate, drive[j][many.which])
        seen += early[:, k] * pose
        both = np.concatenate([pose, rate])
        end[k] = (both[:, 1:] - both[:, :1]) / DELTA[:, None]
        mean[k] = (seen[:, 1:] - seen[:, :1]) / DELTA[:, None]
    end, mean = np.moveaxis(end, 3, 0), np.moveaxis(mean, 3, 0)
    parts = end[..., :12], end[..., 12:], mean[..., :12], mean[..., 12:]
    return Transitions(*map(np.ascontiguousarray, parts))


def _coarse(drive: Array, weights: Array, early: Array, stride: int) -> tuple[Array, Array, Array]:
    """Drives and shares for some steps at once; a share is divided between the poses before and behind it."""
    if stride == 1:
        return drive, weights, early
    w, bins = early.shape
    shares = weights[:, :-1].reshape(w, bins, -1, stride)
    behind = shares @ (np.arange(stride) / stride)
    out = shares.sum(axis=-1) - behind
    out[:, :, 1:] += behind[:, :, :-1]
    means = drive.reshape(-1, stride, *drive.shape[1:]).mean(axis=1)
    return means, out.reshape(w, -1), early + behind[:, :, -1]


def _split(state: Array) -> tuple[Array, Array]:
    """Pose (6, p, w) and its rates (6, p, w) of states (12, p, w)."""
    return np.concatenate([state[:3], state[6:9]]), np.concatenate([state[3:6], state[9:]])


def _stepper(lanes: Lanes, lab: Lab, h: float) -> Callable[[Array, Array, Array], None]:
    """Return a function that advances poses (6, p, w) and their rates by h (s) under the drives (p, 4, w)."""
    c = {name: values(lanes.theta)[:, i, None] for name, i in INDEX.items()}
    kx, ky, kz = (c[f"drag_{axis}_per_mass"] for axis in "xyz")
    w2 = c["attitude_frequency"] ** 2
    damp = 2.0 * c["attitude_damping"] * c["attitude_frequency"]
    i1, i3 = 1.0 / c["iyy_per_ixx"], c["izz_per_iyy"]
    damp_roll = damp * np.sqrt(i1)
    yaw_gain, yaw_damping = i3 * c["yaw_gain_per_izz"], i3 * c["yaw_damping_per_izz"]
    coupling = i3 * c["thrust_yaw_coupling_per_izz"]
    hub, ground = c["hub_drag_per_iyy"], c["ground_effect"]
    sideways = hub * lab.iyy_per_mass
    push_x, push_y, push_z = np.moveaxis(lanes.push, -1, 0)
    push_z = push_z - GRAVITY
    wind_x, wind_y = (0.0, 0.0) if lanes.wind is None else np.moveaxis(lanes.wind, -1, 0)
    mast = lab.mast
    d_yaw, d_pitch, d_roll = h * yaw_damping, h * damp, h * damp_roll
    pitch_gain, roll_gain = w2 * c["pitch_gain"], w2 * c["roll_gain"]
    pitch_trim, roll_trim, yaw_trim = c["pitch_trim"], c["roll_trim"], c["yaw_trim"]
    sixteenth = (0.25 * ROTOR_RADIUS_M) ** 2

    def step(pose: Array, rate: Array, u: Array) -> None:
        vx, vy, vz, wy, wp, wr = rate
        # Sine and cosine by the tangent of half the angle: a third of the time.
        half = np.tan(0.5 * pose[3:])
        square = half * half
        scale = 1.0 / (1.0 + square)
        (sy, sp, sr), (cy, cp, cr) = 2.0 * half * scale, (1.0 - square) * scale
        # Near the floor: more thrust, less drag.
        share = ground * sixteenth / np.maximum(pose[2] + LOWER_HUB_M, 0.05) ** 2
        thrust, far = u[:, 2] / (1.0 - share), 1.0 - DAMPING_LOSS * share
        # Velocity against the air, and drag, in the yaw frame.
        rx, ry = vx - wind_x, vy - wind_y
        ax, ay = cy * rx + sy * ry, cy * ry - sy * rx
        fx, fy = far * kx, far * ky
        gx, gy = fx * ax, fy * ay
        # Angular velocity in the body frame.
        pb, qb, rb = wr - wy * sp, wp * cr + wy * cp * sr, wy * cp * cr - wp * sr
        # Velocity of the hubs in the plane of the disc.
        bx = cp * ax - sp * vz
        bz = sp * ax + cp * vz
        by = cr * ay + sr * bz
        mx, my = hub * fy * (by - mast * pb), -hub * fx * (bx + mast * qb)
        nx, ny = -sideways * fx * qb, sideways * fy * pb
        # Rates of the body frame against those of the joints, and the gyroscopic torque.
        dp = -wy * wp * cp
        dq = -wp * wr * sr + wy * (cp * cr * wr - sp * sr * wp)
        dr = -wp * wr * cr - wy * (sp * cr * wp + cp * sr * wr)
        tx = mx - i1 * dp - qb * rb * (i3 - 1.0)
        ty = my - dq - pb * rb * (i1 - i3)
        tz = coupling * thrust - i3 * dr - pb * qb * (1.0 - i1)
        t_yaw = cp * (sr * ty + cr * tz) - sp * tx + yaw_gain * (u[:, 3] - yaw_trim)
        t_yaw -= coupling * GRAVITY + yaw_damping * wy
        t_pitch = cr * ty - sr * tz + pitch_gain * (u[:, 0] - pitch_trim) - w2 * sp * cr - damp * wp
        t_roll = tx - roll_gain * (u[:, 1] - roll_trim) - w2 * cp * sr - damp_roll * wr
        # Solve (M + h D) d = h torque; pitch and roll are coupled through the yaw alone.
        b, cc = cp * sr * cr * (1.0 - i3), -i1 * sp
        e, f = cr * cr + i3 * sr * sr + d_pitch, i1 + d_roll
        a = i1 * sp * sp + cp * cp * (sr * sr + i3 * cr * cr) + d_yaw
        yaw = (t_yaw - b / e * t_pitch - cc / f * t_roll) / (a - b * b / e - cc * cc / f)
        rate[3] += h * yaw
        rate[4] += h * ((t_pitch - b * yaw) / e)
        rate[5] += h * ((t_roll - cc * yaw) / f)
        # The small net force of the couple at the hubs acts along the body's axes; its tilt is neglected.
        gx, gy = gx - nx, gy - ny
        rate[0] += h * (thrust * (cy * sp * cr + sy * sr) - (cy * gx - sy * gy) + push_x)
        rate[1] += h * (thrust * (sy * sp * cr - cy * sr) - (sy * gx + cy * gy) + push_y)
        rate[2] += h * (thrust * cp * cr - kz * vz + push_z)
        pose += h * rate

    return step
