"""The linear time-varying model (10)-(25): simulate the nominal inputs, linearise along them, discretise.

The ten states are those of (1): the eight physical ones and the integral states x_int, y_int.
"""

from typing import Literal, NamedTuple

import numpy as np

from controllers.model import Model, Push, simulator
from controllers.signals import Array

Coupling = Literal["removed", "full"]
Discretisation = Literal["euler", "exact"]

N_STATES, N_INPUTS = 10, 4
NO_PUSH: Push = (0.0, 0.0, 0.0, 0.0)


class Ltv(NamedTuple):
    """x_{k+1} = x_nominal_{k+1} + A_k (x_k - x_nominal_k) + B_k (u_k - u_nominal_k), (21)."""

    A: Array
    """(N, n, n) discrete state matrices; the paper's model has n = 10 states."""
    B: Array
    """(N, n, 4) discrete input matrices."""
    x_nominal: Array
    """(N + 1, n) nominal states (12)."""
    u_nominal: Array
    """(N, 4) nominal inputs (13)."""


class Subsystem:
    """Some states and inputs of the LTV model, which no other state or input acts on.

    Args:
        states: Indices of the n states among those of the model.
        inputs: Indices of the m inputs among the four.
        constant: True if the matrices are the same along every nominal trajectory.
        of: Number of states of the model.
    """

    def __init__(
        self, states: tuple[int, ...], inputs: tuple[int, ...], *, constant: bool = False, of: int = N_STATES
    ) -> None:
        self.states, self.inputs, self.constant = np.array(states), np.array(inputs), constant
        self.velocities = 4 + self.inputs
        """(m,) indices, in the model, of the states that the inputs drive: vx vy vz (m/s) or yaw rate (rad/s)."""
        self.own_velocities = np.searchsorted(self.states, self.velocities)
        """(m,) indices of the same states among the subsystem's own."""
        self._A = (of * self.states[:, None] + self.states).ravel()
        self._B = (N_INPUTS * self.states[:, None] + self.inputs).ravel()

    def matrices(self, ltv: Ltv) -> Array:
        """Return [A_k B_k] (N, n, n + m) of the subsystem: the rows and columns of its states and inputs."""
        n, m, steps = len(self.states), len(self.inputs), len(ltv.A)
        AB = np.empty((steps, n, n + m))
        AB[..., :n] = ltv.A.reshape(steps, -1).take(self._A, axis=1).reshape(steps, n, n)
        AB[..., n:] = ltv.B.reshape(steps, -1).take(self._B, axis=1).reshape(steps, n, m)
        return AB


SUBSYSTEMS: dict[Coupling, tuple[Subsystem, ...]] = {
    "removed": (Subsystem((0, 1, 4, 5, 8, 9), (0, 1)), Subsystem((2, 3, 6, 7), (2, 3), constant=True)),
    "full": (Subsystem(tuple(range(N_STATES)), tuple(range(N_INPUTS))),),
}
"""Subsystems that do not act on one another: (26) splits into one optimisation for each.

With the coupling removed they are the horizontal motion, whose matrices change with the nominal yaw, and height and
yaw, whose matrices never change. Their inputs, one subsystem after the other, are the four inputs in order.
"""


def shift(u: Array) -> Array:
    """Return the next nominal inputs (N, 4), (25): the last plan without its first input, the last input repeated."""
    return np.concatenate([u[1:], u[-1:]])


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
        self._simulate, self._half_step = simulator(model, period), 0.5 * k_i * period
        self._constant = A = np.zeros((N_STATES, N_STATES))
        A[2, 6] = A[3, 7] = 1.0
        A[4, 4], A[5, 5], A[7, 7] = model.k_x, model.k_y, model.k_yaw
        A[8, 0] = A[9, 1] = k_i
        self._B = B = np.zeros((N_STATES, N_INPUTS))
        B[4, 0], B[5, 1], B[6, 2], B[7, 3] = model.b_x, model.b_y, model.b_z, model.b_yaw

    def __call__(self, x0: Array, u_nominal: Array, xy_ref: Array, push: Push = NO_PUSH) -> Ltv:
        """Return the LTV model along the nominal inputs from the newest state; arguments as in `rollout`."""
        x_nominal = self.rollout(x0, u_nominal, xy_ref, push)
        A, B = self.discretise(*self.jacobians(x_nominal[:-1]))
        return Ltv(A, B, x_nominal, u_nominal)

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
        out[1:, :8] = self._simulate((px, py, pz, yaw, vx, vy, vz, r), u_nominal.tolist(), push)
        area = (out[:, :2] - xy_ref) * self._half_step
        integral = out[:, 8:]
        np.add(area[1:], area[:-1], out=integral[1:])
        np.add.accumulate(integral, axis=0, out=integral)
        return out

    def jacobians(self, x: Array) -> tuple[Array, Array]:
        """Return the continuous-time Jacobians of (1) at the states x (n, 10), (15).

        Returns:
            A (n, 10, 10) and B (10, 4), which is the same at every state.
        """
        A = np.empty((len(x), N_STATES, N_STATES))
        A[...] = self._constant
        yaw = x[:, 3]
        c, s = np.cos(yaw), np.sin(yaw)
        A[:, 0, 4] = A[:, 1, 5] = c
        A[:, 0, 5] = -s
        A[:, 1, 4] = s
        if self._coupling == "full":
            vx, vy, r = x[:, 4], x[:, 5], x[:, 7]
            A[:, 0, 3] = -s * vx - c * vy
            A[:, 1, 3] = c * vx - s * vy
            A[:, 4, 5], A[:, 4, 7] = r, vy
            A[:, 5, 4], A[:, 5, 7] = -r, -vx
        return A, self._B

    def discretise(self, A: Array, B: Array) -> tuple[Array, Array]:
        """Return the discrete matrices (17) of continuous ones, with the input held over the period.

        Args:
            A: (n, 10, 10) continuous state matrices.
            B: (10, 4) continuous input matrix.

        Returns:
            A (n, 10, 10) and B (n, 10, 4), discrete.
        """
        step = self._period * A
        if self._discretisation == "euler":
            held = np.empty((len(A), *B.shape))
            held[...] = self._period * B
            step += _EYE
            return step, held
        # exp(M) and its integral by Horner's rule: at a 20 ms period the norm of M stays below 1 within the speed
        # limits, where 16 terms leave less than 1e-14.
        integral = np.broadcast_to(_EYE, A.shape)
        for term in range(16, 1, -1):
            integral = _EYE + step @ integral / term
        return _EYE + step @ integral, integral @ (self._period * B)


_EYE = np.eye(N_STATES)
