"""Response of the paper's model in the plane to its inputs, in closed form.

With the coupling removed and Euler's rule, each body velocity answers its own input the same way along every nominal
flight. Only the turn of the velocities into the world changes with the heading. Positions are sums of turned velocities
and integral states are sums of positions, so that a few products of matrices replace the recursion over the horizon.
"""

import numpy as np

from controllers.condensed_qp import Weights, sqrt_weight
from controllers.signals import Array

_X, _VX, _INTEGRAL = slice(0, 2), slice(2, 4), slice(4, 6)
"""States of the horizontal motion: x y, vx vy, x_int y_int; the inputs come after them."""
_U = slice(6, 8)


class Planar:
    """The response of the horizontal motion; see `controllers.condensed_qp.Responses`.

    Args:
        AB: (N, 6, 8) its linear model in level flight at yaw = 0, discretised with Euler's rule.
        w: Its weights in (26).
    """

    def __init__(self, AB: Array, w: Weights) -> None:
        n = len(AB)
        decay, gain = AB[0, _VX, _VX].diagonal(), AB[0, _VX, _U].diagonal()
        # Velocities (N + 1, 2) over inputs (N, 2).
        V = np.zeros((n + 1, 2, n, 2))
        for k in range(n):
            V[k + 1] = decay[:, None, None] * V[k]
            V[k + 1, [0, 1], k, [0, 1]] += gain
        self._C = V[1:].reshape(2 * n, 2 * n)
        self._V = V.reshape(2 * n + 2, 2 * n)
        ahead, to_port = (AB[0, 0, 2] * V[:-1, axis, :, axis] for axis in (0, 1))
        self._own = ahead, to_port, -to_port
        """For vx and vy, the way ahead and to port in each period (N, N) over the own inputs; and to starboard."""
        # Positions 1 .. N are sums of the displacements of each period, integral states are sums of positions.
        position = np.tril(np.ones((n, n)))
        integral = AB[0, 4, 0] * np.tril(np.ones((n, n)), -1) @ position
        self._sums = np.concatenate([position, integral])
        Q = w.sqrt_Q**2
        self._roots = np.empty((2, n + 1, n))
        # Over the errors of states 1 .. N, the last one weighted already, and of the inputs.
        pull = np.zeros((4, n, n, 8))
        for axis in (0, 1):
            costs = [Q[axis + 4 * i] * sums[:-1].T @ sums[:-1] for i, sums in enumerate((position, integral))]
            self._roots[axis] = [*sqrt_weight(costs[0] + costs[1])[:-1], position[-1], integral[-1]]
            pull[axis, :, :, axis] = np.append(np.full(n - 1, Q[axis]), 1.0) * position.T
            pull[axis, :, :, 4 + axis] = np.append(np.full(n - 1, Q[4 + axis]), 1.0) * integral.T
        speeds = V[1:-1].reshape(n - 1, 2, 2 * n)
        braked = (speeds * Q[_VX, None]).reshape(2 * n - 2, 2 * n)
        self._constant = braked.T @ speeds.reshape(2 * n - 2, 2 * n) + np.diag(np.tile(w.R, n))
        of_inputs = pull[2:].reshape(2 * n, n, 8)
        of_inputs[:, :-1, _VX], of_inputs[:, -1, _VX] = braked.T.reshape(2 * n, n - 1, 2), V[-1].reshape(2, 2 * n).T
        of_inputs[:, :, _U] = np.diag(np.tile(w.R, n)).reshape(2 * n, n, 2)
        self._pulled = pull.reshape(4 * n, 8 * n)
        self._S, self._last = np.empty((2 * n + 4, 2 * n)), np.empty((6, 2 * n))
        self._last[_VX] = V[-1].reshape(2, 2 * n)
        moved = np.empty((2, n, n, 2))
        self._moved = moved.reshape(2 * n, 2 * n)
        """Displacement in x, then in y, in each period over the inputs (N, 2)."""
        # Views of what is written in every condensing: to make one takes as long as to multiply.
        self._turned = (moved[0, :, :, 0], moved[1, :, :, 0], moved[0, :, :, 1], moved[1, :, :, 1])
        self._ways = moved.reshape(2, n, 2 * n)
        self._stages, self._end = self._S[:-6].reshape(2, n - 1, 2 * n), self._S[-6:]

    def condense(self, x_nominal: Array, AB: Array | None, sqrt_Qf: Array) -> tuple[Array, Array]:
        """Return H and the velocity rows C, which never change."""
        S, (ahead, to_port, to_starboard) = self._S, self._own
        yaw = x_nominal[:-1, 3:4]
        c, s = np.cos(yaw), np.sin(yaw)
        x_ahead, y_ahead, x_port, y_port = self._turned
        np.multiply(c, ahead, x_ahead)
        np.multiply(s, ahead, y_ahead)
        np.multiply(s, to_starboard, x_port)
        np.multiply(c, to_port, y_port)
        weighted = self._roots @ self._ways
        self._stages[...] = weighted[:, :-2]
        self._last[_X], self._last[_INTEGRAL] = weighted[:, -2], weighted[:, -1]
        np.dot(sqrt_Qf, self._last, self._end)
        H = S.T @ S
        H += self._constant
        return H, self._C

    def gradient(self, off: Array, sqrt_Qf: Array) -> Array:
        """Return the gradient (2N,) of the cost where states 1 .. N and inputs are `off` (N, 8) from the reference."""
        n, last = len(self._moved), off[-1, :6]
        off = off.copy()
        off[-1, :6] = (sqrt_Qf @ last) @ sqrt_Qf
        pull = self._pulled @ off.ravel()
        g = pull[:n] @ self._moved
        g += pull[n:]
        return g

    def states(self, du: Array) -> Array:
        """Return the change (N + 1, 6) of the predicted states under changes du (N, 2) of the inputs."""
        n, du = len(du), du.ravel()
        x = np.zeros((n + 1, 6))
        x[:, _VX] = (self._V @ du).reshape(-1, 2)
        moved = self._sums @ (self._moved @ du).reshape(2, n).T
        x[1:, _X], x[1:, _INTEGRAL] = moved[:n], moved[n:]
        return x
