"""The motion of a helicopter: its state is read from the joints of its body, and set there at the start.

The engine's own sensors and body frames would be one step old.
"""

from math import atan2, cos, hypot, pi, sin
from typing import Any, NamedTuple, Protocol

import numpy as np

from controllers.signals import Array


class Moving(NamedTuple):
    """Position, attitude and their rates of a body, as `Truth` has them."""

    position: Array
    quat_wxyz: Array
    velocity: Array
    angular_velocity: Array
    yaw: float
    yaw_rate: float


class Motion(Protocol):
    """The joints between the world and the body."""

    position: Array
    """(3,) view of the engine's."""
    velocity: Array
    """(3,) view of the engine's, world."""

    def place(self, x: Array) -> None:
        """Put the body into physical state x (8,), level."""
        ...

    def now(self) -> Moving:
        """Return its state now; the arrays are copies."""
        ...

    def damp_yaw(self, on: bool) -> None:
        """Switch the rate gyro, whose yaw damping is a part of the model."""
        ...


class Gimbal:
    """Slides x, y, z and hinges yaw, pitch, roll, in this order: the heading comes out unwrapped."""

    def __init__(self, model: Any, data: Any, joint: int = 0) -> None:
        """Begin in the state of the data.

        Args:
            model: The engine's model.
            data: The engine's data.
            joint: Number of the slide x.
        """
        place, speed = model.jnt_qposadr[joint], model.jnt_dofadr[joint]
        self._joints, self._speeds = data.qpos[place : place + 6], data.qvel[speed : speed + 6]
        self.position, self._angles = self._joints[:3], self._joints[3:]
        self.velocity, self._rates = self._speeds[:3], self._speeds[3:]
        self._damping = model.dof_damping[speed + 3 : speed + 4]
        self._yaw_damping = float(self._damping[0])

    def place(self, x: Array) -> None:
        """Put the body into physical state x (8,), level."""
        px, py, pz, yaw, vx, vy, vz, yaw_rate = (float(v) for v in x)
        c, s = cos(yaw), sin(yaw)
        self._joints[:] = px, py, pz, yaw, 0.0, 0.0
        self._speeds[:] = c * vx - s * vy, s * vx + c * vy, vz, yaw_rate, 0.0, 0.0

    def now(self) -> Moving:
        """Return its state now; the arrays are copies."""
        yaw, pitch, roll = self._angles.tolist()
        r, pitch_rate, roll_rate = self._rates.tolist()
        st, ct, sr, cr = sin(pitch), cos(pitch), sin(roll), cos(roll)
        # Yaw turns about the world's z, pitch about the turned y, roll about the nose.
        angular_velocity = (roll_rate - r * st, pitch_rate * cr + r * ct * sr, r * ct * cr - pitch_rate * sr)
        return Moving(
            self.position.copy(),
            _quaternion(yaw, pitch, roll),
            self.velocity.copy(),
            np.array(angular_velocity),
            yaw,
            r,
        )

    def damp_yaw(self, on: bool) -> None:
        """Switch the damping of the yaw hinge."""
        self._damping[0] = self._yaw_damping if on else 0.0


class FreeJoint:
    """A free joint. Full turns are counted, so that the heading comes out unwrapped: look at least every half turn."""

    def __init__(self, model: Any, data: Any, gyro: int | None) -> None:
        """Begin in the state of the data.

        Args:
            model: The engine's model.
            data: The engine's data.
            gyro: Number of the actuator that damps the yaw; None if there is none.
        """
        self._model, self._gyro = model, gyro
        self._pose, self._velocities = data.qpos[:7], data.qvel[:6]
        self.position, self.velocity = self._pose[:3], self._velocities[:3]
        self._damping = 0.0 if gyro is None else float(model.actuator_biasprm[gyro, 2])

    def place(self, x: Array) -> None:
        """Put the body into physical state x (8,), level."""
        px, py, pz, yaw, vx, vy, vz, yaw_rate = (float(v) for v in x)
        c, s = cos(yaw), sin(yaw)
        self._pose[:] = px, py, pz, cos(0.5 * yaw), 0.0, 0.0, sin(0.5 * yaw)
        self._velocities[:] = c * vx - s * vy, s * vx + c * vy, vz, 0.0, 0.0, yaw_rate
        self._heading = atan2(s, c)
        self._turns = round((yaw - self._heading) / (2.0 * pi))

    def now(self) -> Moving:
        """Return its state now; the arrays are copies."""
        px, py, pz, w, x, y, z = self._pose.tolist()
        vx, vy, vz, p, q, r = self._velocities.tolist()
        size = hypot(w, x, y, z) or 1.0
        w, x, y, z = w / size, x / size, y / size, z / size
        heading = atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        if abs(heading - self._heading) > pi:
            self._turns += 1 if heading < self._heading else -1
        self._heading = heading
        # The rates of roll and pitch carry no heading: r' = (q sin(roll) + r cos(roll)) / cos(pitch).
        up_y, up_z = 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)
        level = up_y * up_y + up_z * up_z
        return Moving(
            np.array((px, py, pz)),
            np.array((w, x, y, z)),
            np.array((vx, vy, vz)),
            np.array((p, q, r)),
            heading + 2.0 * pi * self._turns,
            (q * up_y + r * up_z) / level if level else 0.0,
        )

    def damp_yaw(self, on: bool) -> None:
        """Switch the actuator that damps the yaw."""
        if self._gyro is not None:
            self._model.actuator_biasprm[self._gyro, 2] = self._damping if on else 0.0


def _quaternion(yaw: float, pitch: float, roll: float) -> Array:
    """Attitude (4,), scalar first: yaw, then pitch, then roll."""
    cy, sy = cos(0.5 * yaw), sin(0.5 * yaw)
    cp, sp = cos(0.5 * pitch), sin(0.5 * pitch)
    cr, sr = cos(0.5 * roll), sin(0.5 * roll)
    return np.array(
        (
            cy * cp * cr + sy * sp * sr,
            cy * cp * sr - sy * sp * cr,
            cy * sp * cr + sy * cp * sr,
            sy * cp * cr - cy * sp * sr,
        )
    )
