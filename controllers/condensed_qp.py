"""The optimisation (26) as a dense QP in the inputs alone.

With the states eliminated, x = x_nominal + G (u - u_nominal): the nominal trajectory starts at the newest state,
so the affine terms d_k of (22) need no bookkeeping of their own. Minimise 1/2 u'H u + g'u subject to
u_low <= u <= u_high and v_low <= C u <= v_high, where C picks the velocities of the predicted states. The
measured state is not bounded: noise alone could make that infeasible.
"""

from typing import NamedTuple

import numpy as np

from controllers.ltv import N_INPUTS, N_STATES, Ltv
from controllers.signals import Array

VELOCITIES = slice(4, 8)


class CondensedQp(NamedTuple):
    """A dense QP of n = 4 N variables (the stacked inputs) and m = 4 N velocity rows."""

    H: Array
    """(n, n)"""
    g: Array
    """(n,)"""
    C: Array
    """(m, n)"""
    v_low: Array
    """(m,) lower bound of C u."""
    v_high: Array
    """(m,) upper bound of C u."""
    u_low: Array
    """(n,)"""
    u_high: Array
    """(n,)"""


class Weights(NamedTuple):
    """The stage and terminal weights of (26)."""

    sqrt_Q: Array
    """(10,) roots of the diagonal of Q."""
    R: Array
    """(4,) diagonal of R."""
    sqrt_Qf: Array
    """(10, 10) S with S'S = Q_f."""


class Limits(NamedTuple):
    """The bounds of (26)."""

    u_min: Array
    """(4,)"""
    u_max: Array
    """(4,)"""
    v_max: Array
    """(4,) on the magnitudes of the predicted vx vy vz (m/s) and yaw rate (rad/s)."""


class Condenser:
    """Builds the QP of one horizon length again and again in the same memory; results are overwritten by the next.

    Args:
        steps: N, the number of inputs.
        limits: Bounds on inputs and predicted velocities.
    """

    def __init__(self, steps: int, limits: Limits) -> None:
        n = N_INPUTS * steps
        self._steps, self._split = steps, steps // 2
        self._u_low, self._u_high = np.tile(limits.u_min, steps), np.tile(limits.u_max, steps)
        self._v_max = np.tile(limits.v_max, steps)
        # G[k] holds the derivative of state k by all inputs; those from k on stay zero.
        self._G = np.zeros((steps + 1, N_STATES, n))
        self._S = np.empty((steps, N_STATES, n))
        self._error = np.empty((steps, N_STATES))
        reached = [self._G[k, :, : N_INPUTS * k] for k in range(steps)]
        carried = [self._G[k + 1, :, : N_INPUTS * k] for k in range(steps)]
        self._recursion = list(zip(reached, carried, strict=True))[1:]
        blocks = self._G[1:].reshape(steps, N_STATES, steps, N_INPUTS)
        self._newest = np.einsum("kskj->ksj", blocks)

    def predict(self, ltv: Ltv, u: Array) -> Array:
        """The states (N + 1, 10) that the LTV model last condensed reaches under the inputs u (N, 4)."""
        du = (u - ltv.u_nominal).ravel()
        return ltv.x_nominal + (self._G.reshape(-1, len(du)) @ du).reshape(-1, N_STATES)

    def __call__(self, ltv: Ltv, w: Weights, x_ref: Array, u_ref: Array) -> CondensedQp:
        """Condense one horizon.

        Args:
            ltv: N steps of the linear model.
            w: Weights of (26).
            x_ref: (N + 1, 10) reference states.
            u_ref: (N, 4) reference inputs.
        """
        n, G, S, error = self._steps, self._G, self._S, self._error
        self._newest[...] = ltv.B
        for A, (reached, carried) in zip(ltv.A[1:], self._recursion, strict=True):
            np.matmul(A, reached, out=carried)
        np.multiply(G[1:n], w.sqrt_Q[:, None], out=S[:-1])
        np.matmul(w.sqrt_Qf, G[n], out=S[-1])
        off = ltv.x_nominal[1:] - x_ref[1:]
        np.multiply(off[:-1], w.sqrt_Q, out=error[:-1])
        np.matmul(w.sqrt_Qf, off[-1], out=error[-1])
        H = self._hessian()
        u_nominal = ltv.u_nominal.ravel()
        g = error.ravel() @ S.reshape(-1, N_INPUTS * n) - H @ u_nominal - (w.R * u_ref).ravel()
        diagonal = H.reshape(-1)[:: N_INPUTS * n + 1].reshape(n, N_INPUTS)
        diagonal += w.R
        C = G[1:, VELOCITIES].reshape(-1, N_INPUTS * n)
        offset = ltv.x_nominal[1:, VELOCITIES].ravel() - C @ u_nominal
        return CondensedQp(H, g, C, -self._v_max - offset, self._v_max - offset, self._u_low, self._u_high)

    def _hessian(self) -> Array:
        """S'S without the half of the rows' zeros: early states do not depend on late inputs."""
        early, late = self._S[: self._split], self._S[self._split :]
        stacked = late.reshape(-1, late.shape[2])
        H = stacked.T @ stacked
        width = N_INPUTS * self._split
        stacked = early[:, :, :width].reshape(N_STATES * self._split, width)
        H[:width, :width] += stacked.T @ stacked
        return H


def riccati_terminal_weight(A: Array, B: Array, Q: Array, R: Array) -> Array:
    """The infinite-horizon cost-to-go P (10, 10) of a constant pair, a terminal weight with a stability argument.

    Solves the discrete algebraic Riccati equation by the structured doubling algorithm, quadratically convergent.

    Args:
        A: (10, 10) discrete state matrix.
        B: (10, 4) discrete input matrix.
        Q: (10, 10) state weight.
        R: (4, 4) input weight.

    Source: Mayne et al., Automatica 2000 (the paper's [15]); Chu, Fan, Lin, Wang, SIAM J. Matrix Anal. 2004.
    """
    eye = np.eye(len(A))
    G, P = B @ np.linalg.solve(R, B.T), Q
    for _ in range(60):
        W = np.linalg.inv(eye + G @ P)
        P_next = P + A.T @ P @ W @ A
        G, A = G + A @ W @ G @ A.T, A @ W @ A
        if np.abs(P_next - P).max() <= 1e-12 * np.abs(P_next).max():
            return 0.5 * (P_next + P_next.T)
        P = P_next
    raise ValueError("the Riccati equation has no stabilising solution for this model")
