"""The optimisation (26) as a dense QP in the inputs alone, for one subsystem of the LTV model.

The unknowns are du = u - u_nominal, the change of the inputs from the nominal ones. The states are eliminated by
x = x_nominal + G du: the nominal trajectory starts at the newest state, so the affine terms d_k of (22) are zero.
Minimise 1/2 du'H du + g'du subject to u_low <= du <= u_high and v_low <= C du <= v_high, where C du is the change of
the predicted velocities. The measured state is not bounded: noise alone could make that infeasible.
"""

from typing import NamedTuple

import numpy as np

from controllers.ltv import Ltv, Subsystem
from controllers.signals import Array


class CondensedQp(NamedTuple):
    """A dense QP in the N m stacked changes du of the inputs, with as many velocity rows."""

    H: Array
    """(Nm, Nm) Hessian of the cost."""
    g: Array
    """(Nm,) gradient of the cost at du = 0."""
    C: Array
    """(Nm, Nm) change of the predicted velocities per change of the inputs."""
    v_low: Array
    """(Nm,) lower bound of C du."""
    v_high: Array
    """(Nm,) upper bound of C du."""
    u_low: Array
    """(Nm,) lower bound of du."""
    u_high: Array
    """(Nm,) upper bound of du."""


class Weights(NamedTuple):
    """The stage and terminal weights of (26)."""

    sqrt_Q: Array
    """(n,) square roots of the diagonal of Q."""
    R: Array
    """(m,) diagonal of R."""
    sqrt_Qf: Array
    """(n, n) S with S'S = Q_f."""

    def of(self, subsystem: Subsystem) -> "Weights":
        """Return the weights of one subsystem; these are of the whole model."""
        states = subsystem.states
        return Weights(self.sqrt_Q[states], self.R[subsystem.inputs], self.sqrt_Qf[np.ix_(states, states)])


class Limits(NamedTuple):
    """The bounds of (26) for each of m inputs."""

    u_min: Array
    """(m,) lower input limits, full stick."""
    u_max: Array
    """(m,) upper input limits, full stick."""
    v_max: Array
    """(m,) limits on the magnitude of the velocity that each input drives: vx vy vz (m/s) or yaw rate (rad/s)."""


class Condenser:
    """Builds the QPs of one subsystem, all of the same horizon.

    A subsystem with constant matrices gets the same H and C arrays in every QP.

    Args:
        steps: N, the number of control periods with an input.
        limits: Bounds on the inputs and predicted velocities of the whole model.
        subsystem: The states and inputs of the LTV model to condense.
    """

    def __init__(self, steps: int, limits: Limits, subsystem: Subsystem) -> None:
        n, m = len(subsystem.states), len(subsystem.inputs)
        self._steps, self._m, self._subsystem = steps, m, subsystem
        self._u_min, self._u_max, self._v_max = (bound[subsystem.inputs] for bound in limits)
        # Derivatives with respect to all inputs: of state k, and below them of input k itself, which are constant.
        derivatives = np.zeros((steps + 1, n + m, m * steps))
        derivatives[:-1, n:] = np.eye(m * steps).reshape(steps, m, m * steps)
        self._G = G = derivatives[:, :n]
        self._S = np.empty((steps, n, m * steps))
        self._error = np.empty((steps, n))
        self._recursion = list(zip(derivatives[:-1], G[1:], strict=True))
        self._H: Array | None = None
        self._C = np.empty((0, 0))

    def response(self, du: Array) -> Array:
        """Return the change (N + 1, n) of the predicted states under changes du (N, m) of the inputs.

        It is that of the LTV model condensed last.
        """
        return self._G.dot(du.ravel())

    def __call__(self, ltv: Ltv, w: Weights, x_off: Array, u_off: Array) -> CondensedQp:
        """Condense one horizon; all arguments but the weights are of the whole model.

        Args:
            ltv: N steps of the linear model.
            w: The subsystem's weights in (26); with constant matrices, the weights must be constant too.
            x_off: (N + 1, n) nominal states minus reference states.
            u_off: (N, 4) nominal inputs minus reference inputs.
        """
        subsystem, H = self._subsystem, self._H
        if H is None or not subsystem.constant:
            H = self._condense(ltv, w)
        off, error = x_off[1:].take(subsystem.states, axis=1), self._error
        np.multiply(off[:-1], w.sqrt_Q, out=error[:-1])
        np.dot(w.sqrt_Qf, off[-1], out=error[-1])
        g = error.ravel().dot(self._S.reshape(-1, len(H)))
        g += (w.R * u_off.take(subsystem.inputs, axis=1)).ravel()
        v = ltv.x_nominal[1:].take(subsystem.velocities, axis=1)
        u = ltv.u_nominal.take(subsystem.inputs, axis=1)
        low, high = -self._v_max - v, self._v_max - v
        return CondensedQp(
            H, g, self._C, low.ravel(), high.ravel(), (self._u_min - u).ravel(), (self._u_max - u).ravel()
        )

    def _condense(self, ltv: Ltv, w: Weights) -> Array:
        """Compute G, S = [sqrt_Q G; sqrt_Qf G_N], the velocity rows C of G, and return H = S'S + R."""
        n, G, S = self._steps, self._G, self._S
        for AB, (before, after) in zip(self._subsystem.matrices(ltv), self._recursion, strict=True):
            np.dot(AB, before, out=after)
        np.multiply(G[1:n], w.sqrt_Q[:, None], out=S[:-1])
        np.matmul(w.sqrt_Qf, G[n], out=S[-1])
        stacked = S.reshape(-1, S.shape[2])
        self._H = H = stacked.T @ stacked
        diagonal = H.reshape(-1)[:: len(H) + 1].reshape(n, self._m)
        diagonal += w.R
        self._C = G[1:].take(self._subsystem.own_velocities, axis=1).reshape(len(H), len(H))
        return H


@np.errstate(all="ignore")
def riccati_terminal_weight(A: Array, B: Array, Q: Array, R: Array) -> Array:
    """Return the infinite-horizon cost-to-go P (n, n) of a constant model: a terminal weight that ensures stability.

    Solves the discrete algebraic Riccati equation by the structured doubling algorithm, quadratically convergent.

    Args:
        A: (n, n) discrete state matrix.
        B: (n, m) discrete input matrix.
        Q: (n, n) state weight.
        R: (m, m) input weight.

    Raises:
        ValueError: There is no stabilising solution, or it overflows.

    Source: Mayne et al., Automatica 2000 (the paper's [15]); Chu, Fan, Lin, Wang, SIAM J. Matrix Anal. 2004.
    """
    eye = np.eye(len(A))
    G, P = B @ np.linalg.solve(R, B.T), Q
    for _ in range(60):
        W = np.linalg.inv(eye + G @ P)
        P_next = P + A.T @ P @ W @ A
        G, A = G + A @ W @ G @ A.T, A @ W @ A
        if np.abs(P_next - P).max() <= 1e-12 * np.abs(P_next).max() < np.inf:
            return 0.5 * (P_next + P_next.T)
        P = P_next
    raise ValueError("the Riccati equation has no stabilising solution")


def sqrt_weight(P: Array) -> Array:
    """Return the symmetric root (n, n) of a positive semidefinite weight (n, n)."""
    values, vectors = np.linalg.eigh(P)
    return vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T
