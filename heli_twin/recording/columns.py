"""The columns of a log's topics, NumPy arrays with one row a message: `log.truth.position` and its neighbours.

World is north-west-up and fixed to the room; body is x to the nose, y to port, z up.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from controllers.rotations import rotate_to_world
from controllers.signals import Array

Times = NDArray[np.int64]


def in_seconds(time: Times) -> Array:
    """Return times in ns as s."""
    return np.asarray(1e-9 * time, np.float64)


class Truths(NamedTuple):
    """`/truth`: what the helicopter really does.

    Attributes:
        time, stamp: (n,) ns.
        position: (n, 3) centre of gravity, world, m.
        quat_wxyz: (n, 4) attitude of the body in the world, scalar first.
        velocity: (n, 3) world, m/s.
        angular_velocity: (n, 3) body, rad/s.
        yaw, yaw_rate: (n,) heading, unwrapped, rad; rad/s.
        actuators: (n, 4) what servos, rotors and yaw drive have reached, fraction of full stick.
        touching: (n,) whether any part touches the floor.
    """

    time: Times
    stamp: Times
    position: Array
    quat_wxyz: Array
    velocity: Array
    angular_velocity: Array
    yaw: Array
    yaw_rate: Array
    actuators: Array
    touching: NDArray[np.bool_]

    @property
    def seconds(self) -> Array:
        """(n,) log times, s."""
        return in_seconds(self.time)


class Poses(NamedTuple):
    """`/mocap/pose`: what the motion capture says of each frame.

    Attributes:
        time: (n,) when the pose arrived, ns.
        stamp: (n,) when the cameras saw it, ns.
        position: (n, 3) world, m.
        quat_wxyz: (n, 4) attitude of the body in the world, scalar first.
    """

    time: Times
    stamp: Times
    position: Array
    quat_wxyz: Array

    @property
    def seconds(self) -> Array:
        """(n,) log times, s."""
        return in_seconds(self.time)


class Estimates(NamedTuple):
    """`/estimate`: what the estimator believes.

    Attributes:
        time: (n,) ns.
        stamp: (n,) the moment for which the state holds, ns.
        x: (n, 8) states, which `position`, `yaw`, `velocity_body` and `yaw_rate` name.
        disturbance: (n, 4) unexplained acceleration, x y z (world, m/s^2), yaw (rad/s^2).
        variance: (n, 4, 3) of x y z yaw: position, velocity, disturbance; SI units squared.
        pose_stamp: (n,) capture time of the newest pose in it, ns; -1 before the first.
        rejected: (n,) number of poses refused so far.
    """

    time: Times
    stamp: Times
    x: Array
    disturbance: Array
    variance: Array
    pose_stamp: Times
    rejected: NDArray[np.int32]

    @property
    def seconds(self) -> Array:
        """(n,) log times, s."""
        return in_seconds(self.time)

    @property
    def position(self) -> Array:
        """(n, 3) world, m."""
        return self.x[:, :3]

    @property
    def yaw(self) -> Array:
        """(n,) unwrapped, rad."""
        return self.x[:, 3]

    @property
    def velocity(self) -> Array:
        """(n, 3) world, m/s: that of `/truth`."""
        return _in_world(self.x)

    @property
    def velocity_body(self) -> Array:
        """(n, 3) forwards, to port, up, in a frame turned by the yaw alone, m/s."""
        return self.x[:, 4:7]

    @property
    def yaw_rate(self) -> Array:
        """(n,) rad/s."""
        return self.x[:, 7]


class References(NamedTuple):
    """`/reference`: where the helicopter should be.

    Attributes:
        time, stamp: (n,) ns.
        x: (n, 8) states, which `position`, `yaw`, `velocity_body` and `yaw_rate` name.
        u: (n, 4) feed-forward inputs, fraction of full stick.
    """

    time: Times
    stamp: Times
    x: Array
    u: Array

    @property
    def seconds(self) -> Array:
        """(n,) log times, s."""
        return in_seconds(self.time)

    @property
    def position(self) -> Array:
        """(n, 3) world, m."""
        return self.x[:, :3]

    @property
    def yaw(self) -> Array:
        """(n,) unwrapped, rad."""
        return self.x[:, 3]

    @property
    def velocity(self) -> Array:
        """(n, 3) world, m/s: that of `/truth`."""
        return _in_world(self.x)

    @property
    def velocity_body(self) -> Array:
        """(n, 3) forwards, to port, up, in a frame turned by the yaw alone, m/s."""
        return self.x[:, 4:7]

    @property
    def yaw_rate(self) -> Array:
        """(n,) rad/s."""
        return self.x[:, 7]


class Commands(NamedTuple):
    """`/command/sent` and `/command/acting`.

    Attributes:
        time: (n,) ns; a command acts from then on.
        stamp: (n,) when the controller decided it, ns; -1 if it did not.
        u: (n, 4) inputs, which `pitch`, `roll`, `thrust` and `yaw` name, fraction of full stick.
    """

    time: Times
    stamp: Times
    u: Array

    @property
    def seconds(self) -> Array:
        """(n,) log times, s."""
        return in_seconds(self.time)

    @property
    def pitch(self) -> Array:
        """(n,) fraction of full stick, positive forwards."""
        return self.u[:, 0]

    @property
    def roll(self) -> Array:
        """(n,) fraction of full stick, positive to port."""
        return self.u[:, 1]

    @property
    def thrust(self) -> Array:
        """(n,) fraction of full stick."""
        return self.u[:, 2]

    @property
    def yaw(self) -> Array:
        """(n,) fraction of full stick, positive nose to port."""
        return self.u[:, 3]


class Plans(NamedTuple):
    """`/mpc/plan`: the flight that the controller expects, one row of states a period.

    Attributes:
        time: (n,) ns.
        x: (n, N + 1, 10) the states of the estimate and two integral states (m), rounded.
        u: (n, N, 4) planned inputs, fraction of full stick.
        u_nominal: (n, N, 4) inputs along which the model was linearised.
    """

    time: Times
    x: NDArray[np.float32]
    u: Array
    u_nominal: Array

    @property
    def seconds(self) -> Array:
        """(n,) log times, s."""
        return in_seconds(self.time)


class ExtraEstimates(NamedTuple):
    """`/estimate_extra`: the estimator's further states, which `Log.estimate_states` names with their units.

    Attributes:
        time, stamp: (n,) ns.
        x, variance: (n, k).
    """

    time: Times
    stamp: Times
    x: Array
    variance: Array

    @property
    def seconds(self) -> Array:
        """(n,) log times, s."""
        return in_seconds(self.time)


class ExtraPlans(NamedTuple):
    """`/mpc/plan_extra`: the plans' further states, which `Log.plan_states` names with their units.

    Attributes:
        time: (n,) ns.
        x: (n, N + 1, k), rounded.
    """

    time: Times
    x: NDArray[np.float32]

    @property
    def seconds(self) -> Array:
        """(n,) log times, s."""
        return in_seconds(self.time)


class QpReports(NamedTuple):
    """`/mpc/qp`: how each control problem was solved.

    Attributes:
        time: (n,) ns.
        status: (n,) `solved`, `softened`, `shifted_plan` or `safe_hover`: the rung of the ladder that gave the command.
        iterations: (n,) of the solver, all attempts together.
        active_bounds: (n,) input and velocity bounds that hold with equality.
        objective: (n,) cost of the plan less that of the nominal inputs.
        slack: (n,) largest softening of a velocity bound, m/s or rad/s.
    """

    time: Times
    status: NDArray[np.str_]
    iterations: NDArray[np.int32]
    active_bounds: NDArray[np.int32]
    objective: Array
    slack: Array

    @property
    def seconds(self) -> Array:
        """(n,) log times, s."""
        return in_seconds(self.time)


class Airs(NamedTuple):
    """`/disturbance`: what the surroundings do, from each time on.

    Attributes:
        time: (n,) ns.
        wind: (n, 3) velocity of the air, world, m/s.
        acceleration: (n, 3) push that no model explains, world, m/s^2.
        thrust_factor: (n,) thrust as a fraction of nominal.
    """

    time: Times
    wind: Array
    acceleration: Array
    thrust_factor: Array

    @property
    def seconds(self) -> Array:
        """(n,) log times, s."""
        return in_seconds(self.time)


class Moments(NamedTuple):
    """`/disturbance_moment`: no rows where no disturbance gives a moment.

    Attributes:
        time: (n,) ns.
        moment: (n, 3) body, N m.
    """

    time: Times
    moment: Array

    @property
    def seconds(self) -> Array:
        """(n,) log times, s."""
        return in_seconds(self.time)


class Batteries(NamedTuple):
    """`/battery`: no rows where the plant has none.

    Attributes:
        time: (n,) ns.
        voltage: (n,) at its terminals, V.
        current: (n,) A.
        charge: (n,) share of the capacity that is left.
    """

    time: Times
    voltage: Array
    current: Array
    charge: Array

    @property
    def seconds(self) -> Array:
        """(n,) log times, s."""
        return in_seconds(self.time)


class Timings(NamedTuple):
    """`/timing`: measured wall times.

    Attributes:
        time: (n,) ns, simulated.
        control_step_ns: (n,) of the whole control step, ns.
        solve_ns: (n,) of it in the QP solver, ns.
    """

    time: Times
    control_step_ns: Times
    solve_ns: Times

    @property
    def seconds(self) -> Array:
        """(n,) log times, s."""
        return in_seconds(self.time)


def _in_world(x: Array) -> Array:
    """Velocities (n, 3) in the world, m/s, of states (n, 8) whose velocities are in a frame turned by the yaw."""
    return np.column_stack([rotate_to_world(x[:, 4:6], x[:, 3]), x[:, 6]])
