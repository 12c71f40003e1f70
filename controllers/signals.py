"""The values that cross the ground station's wires.

Time is integer nanoseconds since the start of the flight. Frames: *world* is north-west-up and fixed to the
room, *body* is the paper's frame (x to the nose, y to port, z up) turned by the yaw alone. Yaw is unwrapped.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

NX = 8
"""Physical states: x y z yaw (world, m and rad), vx vy vz (body, m/s), yaw rate (rad/s)."""
NU = 4
"""Inputs: pitch, roll, thrust, yaw; each a fraction of full stick. The paper's (u_x, u_y, u_z, u_psi)."""


class Pose(NamedTuple):
    """What the motion capture says of one frame."""

    stamp: int
    """When the cameras saw it, ns."""
    position: Array
    """(3,) world, m."""
    quat_wxyz: Array
    """(4,) body attitude in world, scalar first."""


class Estimate(NamedTuple):
    """What the estimator believes of the helicopter at `stamp`."""

    stamp: int
    """The moment this state holds for, ns: with roll-forward, when the next command will act."""
    x: Array
    """(8,) physical state."""
    disturbance: Array
    """(4,) acceleration the model does not explain: x y z (world, m/s^2), yaw (rad/s^2)."""
    variance: Array
    """(4, 3) filter variance of position, velocity and disturbance of each axis x y z yaw."""
    pose_stamp: int
    """Capture time of the newest pose in it, ns; -1 before the first."""
    rejected: int
    """Poses refused so far: outside the gate, stale, or not finite."""


class Reference(NamedTuple):
    """The planned flight from `stamp` on, at the control period; the last input is held."""

    stamp: int
    """Time of the first row, ns."""
    x: Array
    """(N + 1, 8) physical states."""
    u: Array
    """(N, 4) feed-forward inputs."""


class Plan(NamedTuple):
    """What the controller expects to happen, from the stamp of its estimate on."""

    x: Array
    """(N + 1, 10) predicted states; the last two are the integral states, m."""
    u: Array
    """(N, 4) planned inputs."""
    u_nominal: Array
    """(N, 4) inputs the model was linearised along."""


class QpReport(NamedTuple):
    """How one control problem was solved."""

    status: str
    """`solved`, `softened`, `shifted_plan` or `safe_hover`: the rung of the fallback ladder that answered."""
    iterations: int
    """Newton iterations of ProxQP, all attempts together."""
    active_bounds: int
    """Input and velocity bounds that hold with equality."""
    objective: float
    """Half the cost (26) of the plan less that of the nominal inputs, and the penalty where it was softened."""
    slack: float
    """Largest softening of a velocity bound, m/s or rad/s; 0 unless `softened`."""


class Command(NamedTuple):
    """What the controller asks for."""

    stamp: int
    """When it was decided, ns."""
    u: Array
    """(4,) inputs."""
    plan: Plan | None = None
    """This and the report are put there after the command is on its way: see `Controller.explain`."""
    qp: QpReport | None = None
    solve_ns: int = 0
    """Measured wall time inside the QP solver, ns; logged, never used."""


def nanoseconds(seconds: float) -> int:
    """A duration as integer nanoseconds."""
    return round(seconds * 1e9)
