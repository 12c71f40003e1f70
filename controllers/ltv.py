"""The linear time-varying model (10)-(25): simulate the nominal inputs, linearise along them, discretise.

The ten states are those of (1): the eight physical ones and the integral states x_int, y_int.
"""

from functools import lru_cache
from struct import Struct
from typing import Literal, NamedTuple

import numpy as np

from controllers.model import Model, Push, simulator
from controllers.signals import Array

Coupling = Literal["removed", "full"]
Discretisation = Literal["euler", "exact"]

N_STATES, N_INPUTS = 10, 4
NO_PUSH: Push = (0.0, 0.0, 0.0, 0.0)


class Ltv(NamedTuple):
    """x_{k+1} = x_nominal_{k+1} + A_k (x_k - x_nominal_k) + B_k (u_k - u_nominal_k), (21), part by part."""

    parts: tuple[Array | None, ...]
    """[A_k B_k] (N, n, n + m) of each subsystem, whose n states and m inputs are those of its `Subsystem`; None where
    a closed form needs no matrices."""
    x_nominal: Array
    """(N + 1, n) nominal states (12) of the whole model; the paper's has n = 10 states."""
    u_nominal: Array
    """(N, 4) nominal inputs (13)."""


class Subsystem:
    """Some states and inputs of the LTV model, which no other state or input acts on.

    Args:
        states: Indices of the n states among those of the model.
        inputs: Indices of the m inputs among the four, one after the other.
        constant: True if the matrices are the same along every nominal trajectory.
    """

    def __init__(self, states: tuple[int, ...], inputs: tuple[int, ...], *, constant: bool = False) -> None:
        self.states, self.inputs, self.constant = np.array(states), np.array(inputs), constant
        self.input_columns = slice(inputs[0], inputs[-1] + 1)
        self.velocities = 4 + self.inputs
        """(m,) indices, in the model, of the states that the inputs drive: vx vy vz (m/s) or yaw rate (rad/s)."""
        self.velocity_columns = slice(4 + inputs[0], 5 + inputs[-1])
        self.own_velocities = np.searchsorted(self.states, self.velocities)
        """(m,) indices of the same states among the subsystem's own."""


WHOLE = Subsystem(tuple(range(N_STATES)), tuple(range(N_INPUTS)))
"""The whole model of (1)."""
SUBSYSTEMS: dict[Coupling, tuple[Subsystem, ...]] = {
    "removed": (Subsystem((0, 1, 4, 5, 8, 9), (0, 1)), Subsystem((2, 3, 6, 7), (2, 3), constant=True)),
    "full": (WHOLE,),
}
"""Subsystems that do not act on one another: (26) splits into one optimisation for each.

With the coupling removed they are the horizontal motion, whose matrices change with the nominal yaw, and height and
yaw, whose matrices never change. Their inputs, one subsystem after the other, are the four inputs in order.
"""


@lru_cache(8)
def _rows(steps: int) -> Struct:
    """Rows of ten numbers, the first eight of which are packed."""
    return Struct("8d16x" * steps)


def shift(u: Array) -> Array:
    """Return the next nominal inputs (N, 4), (25): the last plan without its first input, the last input repeated."""
    shifted = np.empty_like(u)
    shifted[:-1], shifted[-1] = u[1:], u[-1]
    return shifted


class Linearisation:
    """Simulate the nonlinear model under nominal inputs and linearise it along that trajectory: (10)-(23).

    Args:
        model: Believed parameters.
        k_i: Gain of the integral states in (1), 1/s.
        period: Sampling period, s.
        coupling: `removed` is the variant that the paper flew: in the linear model, horizontal position and body
            velocity do not depend on yaw and yaw rate; only the rotation by the nominal yaw stays.
        discretisation: `euler`, the paper's, or `exact`, the matrix exponential.
    """

    def __init__(
        self, model: Model, k_i: float, period: float, coupling: Coupling, discretisation: Discretisation
    ) -> None:
        self._period, self._coupling, self._discretisation = period, coupling, discretisation
        self._simulate, self._k_i = simulator(model, period), k_i
        constant = np.zeros((N_STATES, N_STATES + N_INPUTS))
        A, B = constant[:, :N_STATES], constant[:, N_STATES:]
        A[2, 6] = A[3, 7] = 1.0
        A[4, 4], A[5, 5], A[7, 7] = model.k_x, model.k_y, model.k_yaw
        A[8, 0] = A[9, 1] = k_i
        B[4, 0], B[5, 1], B[6, 2], B[7, 3] = model.b_x, model.b_y, model.b_z, model.b_yaw
        self._constant = {
            part: constant[np.ix_(part.states, [*part.states, *(N_STATES + part.inputs)])]
            for part in (WHOLE, *SUBSYSTEMS[coupling])
        }
        """[A B] of (15) without what depends on heading and speed."""
        self._held = {part: np.eye(*AB.shape) + period * AB for part, AB in self._constant.items()}
        """The same of (17), by Euler's rule."""
        self._own = SUBSYSTEMS[coupling]
        self._trapezoids = lru_cache(4)(self._trapezoidal_rule)
        self._kept: dict[int, Array] = {}
        """The matrices of the constant part for each number of steps."""

    def __call__(self, x0: Array, u_nominal: Array, xy_ref: Array, push: Push = NO_PUSH) -> Ltv:
        """Return the LTV model along the nominal inputs from the newest state; arguments as in `rollout`."""
        x_nominal = self.rollout(x0, u_nominal, xy_ref, push)
        return Ltv(tuple(self.matrices(x_nominal[:-1], part) for part in self._own), x_nominal, u_nominal)

    def matrices(self, x: Array, part: Subsystem) -> Array:
        """Return [A B] (N, n, n + m) of a part, discrete, at the states x (N, 10)."""
        if part.constant:
            kept = self._kept.get(len(x))
            if kept is None:
                kept = self._kept[len(x)] = self.discretise(self.jacobians(x, part))
            return kept
        if self._discretisation == "euler":
            return self._filled(x, part, self._held[part], self._period)
        return self.discretise(self.jacobians(x, part))

    def rollout(self, x0: Array, u_nominal: Array, xy_ref: Array, push: Push = NO_PUSH) -> Array:
        """Simulate the nonlinear model under the nominal inputs, (10)-(13).

        The integral states use the trapezoidal rule, as the controller's own integrals do.

        Args:
            x0: (10,) newest state.
            u_nominal: (N, 4) nominal inputs.
            xy_ref: (N + 1, 2) reference position, world, m.
            push: Constant acceleration added to the model's: x y z (world, m/s^2), yaw (rad/s^2).

        Returns:
            (N + 1, 10) nominal states.
        """
        px, py, pz, yaw, vx, vy, vz, r, *_ = x0.tolist()
        out = np.empty((len(u_nominal) + 1, N_STATES))
        out[0] = x0
        states = self._simulate((px, py, pz, yaw, vx, vy, vz, r), u_nominal.tolist(), push)
        flat: list[float] = []
        for state in states:
            flat += state
        # NumPy itself takes four times as long to read Python floats.
        _rows(len(states)).pack_into(out.data, out.strides[0], *flat)
        np.add(self._trapezoids(len(states)).dot(out[:, :2] - xy_ref), x0[8:], out=out[1:, 8:])
        return out

    def _trapezoidal_rule(self, steps: int) -> Array:
        """(N, N + 1) integrals after each step over the errors of the positions."""
        whole = np.tril(np.ones((steps, steps + 1)), 1)
        whole[:, 0] = 0.5
        whole[range(steps), range(1, steps + 1)] = 0.5
        return self._k_i * self._period * whole

    def jacobians(self, x: Array, part: Subsystem = WHOLE) -> Array:
        """Return the continuous-time Jacobians [A B] (k, n, n + m) of (1) for a part at the states x (k, 10), (15)."""
        return self._filled(x, part, self._constant[part], 1.0)

    def _filled(self, x: Array, part: Subsystem, constant: Array, dt: float) -> Array:
        """Matrices [A B] (k, n, n + m): a constant (n, n + m), and what depends on the states x (k, 10), times dt."""
        AB = np.empty((len(x), *constant.shape))
        AB[...] = constant
        if part.states[0] == 0:
            vx, vy = part.own_velocities[:2].tolist()
            yaw = x[:, 3]
            c, s = dt * np.cos(yaw), dt * np.sin(yaw)
            AB[:, 0, vx] = AB[:, 1, vy] = c
            AB[:, 0, vy] = -s
            AB[:, 1, vx] = s
            if self._coupling == "full":
                u, v, r = x[:, 4], x[:, 5], dt * x[:, 7]
                AB[:, 0, 3] = -s * u - c * v
                AB[:, 1, 3] = c * u - s * v
                AB[:, 4, 5], AB[:, 4, 7] = r, dt * v
                AB[:, 5, 4], AB[:, 5, 7] = -r, -dt * u
        return AB

    def discretise(self, AB: Array) -> Array:
        """Return the discrete matrices (17) of continuous ones, with the input held over the period.

        Args:
            AB: (k, n, n + m) continuous [A B].

        Returns:
            [A B] (k, n, n + m), discrete.
        """
        n, step = AB.shape[1], self._period * AB
        eye = np.eye(n, AB.shape[2])
        if self._discretisation == "euler":
            step += eye
            return step
        # exp(M) and its integral by Horner's rule: at a 20 ms period the norm of M stays below 1 within the speed
        # limits, where 16 terms leave less than 1e-14.
        M, eye = step[..., :n], np.eye(n)
        integral = np.broadcast_to(eye, M.shape)
        for term in range(16, 1, -1):
            integral = eye + M @ integral / term
        return np.concatenate([eye + M @ integral, integral @ step[..., n:]], axis=2)
