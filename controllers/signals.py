"""The values that the ground station receives and sends.

Time is integer nanoseconds since the start of the flight. Frames: *world* is north-west-up and fixed to the
room, *body* is the paper's frame (x to the nose, y to port, z up) turned by the yaw alone. Yaw is unwrapped.
"""

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

NX = 8
"""Physical states: x y z yaw (world, m and rad), vx vy vz (body, m/s), yaw rate (rad/s)."""
VELOCITIES = slice(4, NX)
"""Their columns of velocities."""
NU = 4
"""Inputs: pitch, roll, thrust, yaw; each a fraction of full stick. The paper's (u_x, u_y, u_z, u_psi)."""


class NamedState(NamedTuple):
    """Name and unit of a state beyond the eight physical ones."""

    name: str
    """A short name in lower case, such as `tilt_x`."""
    unit: str
    """Such as `rad`; `1` for a number without a unit."""


NO_STATES: Array = np.zeros(0)
"""The further states of an estimator that has none."""
NO_STATES.setflags(write=False)


class Pose(NamedTuple):
    """The pose that motion capture measured in one frame."""

    stamp: int
    """Capture time, ns."""
    position: Array
    """(3,) world, m."""
    quat_wxyz: Array
    """(4,) body attitude in world, scalar first."""


class Estimate(NamedTuple):
    """The estimated state of the helicopter at `stamp`."""

    stamp: int
    """Time of this state, ns: with roll-forward, the time when the next command will act."""
    x: Array
    """(8,) physical state."""
    disturbance: Array
    """(4,) acceleration that the model does not explain: x y z (world, m/s^2), yaw (rad/s^2)."""
    variance: Array
    """(4, 3) filter variance of position, velocity and disturbance of each axis x y z yaw."""
    pose_stamp: int
    """Capture time of the newest pose used, ns; -1 before the first."""
    rejected: int
    """Number of poses refused so far: outside the gate, too old, or non-finite."""
    extra: Array = NO_STATES
    """(k,) further states, as `extra_states` of the estimator's value names them."""
    extra_variance: Array = NO_STATES
    """(k,) filter variance of each further state."""


class Reference(NamedTuple):
    """The planned flight from `stamp` on, sampled at the control period."""

    stamp: int
    """Time of the first row, ns."""
    x: Array
    """(N + 1, 8) physical states."""
    u: Array
    """(N, 4) feed-forward inputs, each held over one period."""
    flat: Array | None = None
    """(n + 1, N + 1, 4) flat outputs x y z (world, m), yaw (rad) and their time derivatives up to the n-th, for a law
    that asks for them with `flat_derivatives`."""
    prepared: Array | None = None
    """(N + 1, ...) what the law's own `prepare` has made of the flat outputs, if it has one; not in references that a
    supervisor has made."""


class Plan(NamedTuple):
    """The flight that the controller predicts, from the stamp of its estimate on."""

    x: Array
    """(N + 1, 10) predicted states; the last two are the integral states, m. (N + 1, 8) of a law without them."""
    u: Array
    """(N, 4) planned inputs."""
    u_nominal: Array
    """(N, 4) inputs along which the model was linearised."""
    extra: Array | None = None
    """(N + 1, k) further predicted states, as `extra_states` of the law's value names them."""


QpStatus = Literal["solved", "softened", "shifted_plan", "safe_hover"]
"""The rung of the fallback ladder that gave the command."""


class QpReport(NamedTuple):
    """Outcome of the optimisation in one control step."""

    status: QpStatus
    iterations: int
    """Newton iterations of ProxQP, all attempts together."""
    active_bounds: int
    """Input and velocity bounds that hold with equality."""
    objective: float
    """Half the cost (26) of the plan minus that of the nominal inputs, plus the penalty if `softened`."""
    slack: float
    """Largest softening of a velocity bound, m/s or rad/s; 0 unless `softened`."""


class Command(NamedTuple):
    """The inputs that the controller sends, and what they are based on."""

    stamp: int
    """Control time at which it was decided, ns."""
    u: Array
    """(4,) inputs, fractions of full stick."""
    plan: Plan | None = None
    """Plan and report are added after the command was sent: see `Controller.explain`."""
    qp: QpReport | None = None
    solve_ns: int = 0
    """Measured wall time of the QP solver, ns; only logged."""


def nanoseconds(seconds: float) -> int:
    """Return a duration in s as integer nanoseconds."""
    return round(seconds * 1e9)
