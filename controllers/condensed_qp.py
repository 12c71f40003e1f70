"""The optimisation (26) as a dense QP in the inputs alone, for one subsystem of the LTV model.

The unknowns are du = u - u_nominal, the change of the inputs from the nominal ones. The states are eliminated by
x = x_nominal + G du: the nominal trajectory starts at the newest state, so the affine terms d_k of (22) are zero.
Minimise 1/2 du'H du + g'du subject to u_low <= du <= u_high and v_low <= C du <= v_high, where C du is the change of
the predicted velocities and, where servos are slow, of the travel of the inputs from one period to the next. The
measured state is not bounded: noise alone could make that infeasible.
"""

from math import prod
from typing import NamedTuple, Protocol, cast

import numpy as np

from controllers.linear_equation import solve
from controllers.ltv import Subsystem
from controllers.signals import Array


class Cost(NamedTuple):
    """The cost of a dense QP in the N m stacked changes du of the inputs, and what they do to the velocities."""

    H: Array
    """(Nm, Nm) Hessian of the cost."""
    g: Array
    """(Nm,) gradient of the cost at du = 0."""
    C: Array
    """(Nm, Nm) change of the predicted velocities per change of the inputs."""


class CondensedQp(NamedTuple):
    """A dense QP in the N m stacked changes du of the inputs, with r rows: velocities, and travel where bounded."""

    H: Array
    """(Nm, Nm) Hessian of the cost."""
    g: Array
    """(Nm,) gradient of the cost at du = 0."""
    C: Array
    """(r, Nm) change of the predicted velocities, then of the travel of the inputs, per change of the inputs."""
    v_low: Array
    """(r,) lower bound of C du."""
    v_high: Array
    """(r,) upper bound of C du."""
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
    travel: Array
    """(m,) limits on the change of each input from one period to the next, full stick; infinite where there is none."""

    @property
    def slow(self) -> bool:
        """True if an input cannot get from one end to the other within one period."""
        return bool((self.travel < self.u_max - self.u_min).any())

    def keep_travel(self, u: Array, before: Array) -> bool:
        """Say whether inputs u (N, m) after `before` (m,) change slowly enough."""
        return bool((np.abs(np.diff(u, axis=0, prepend=before[None])) <= self.travel).all())


class Responses(Protocol):
    """The predicted states of one subsystem as functions of its stacked inputs du (Nm,)."""

    def condense(self, x_nominal: Array, AB: Array | None, sqrt_Qf: Array) -> tuple[Array, Array]:
        """Return H and the velocity rows C along a nominal flight; arguments as of `Condenser`."""
        ...

    def gradient(self, off: Array, sqrt_Qf: Array) -> Array:
        """Return the gradient (Nm,) of the cost where states 1 .. N and inputs are `off` (N, n + m) the reference's."""
        ...

    def states(self, du: Array) -> Array:
        """Return the change (N + 1, n) of the predicted states under changes du (N, m) of the inputs."""
        ...


class StepByStep:
    """The response of any linear model, by its recursion.

    Args:
        steps: N.
        subsystem: Whose states and inputs they are.
        w: Its weights in (26).
        flies: The linear model is the model itself: the nominal states come from the same recursion; see `fly`.
    """

    def __init__(self, steps: int, subsystem: Subsystem, w: Weights, *, flies: bool = False) -> None:
        n, m = len(subsystem.states), len(subsystem.inputs)
        self._velocities, self._R = subsystem.own_velocities, np.tile(w.R, steps)
        # Derivatives with respect to all inputs: of state k, and below them of input k itself, which are constant. If
        # it flies, the nominal states and inputs are a last column, and a last row has 1 for what acts on them.
        derivatives = np.zeros((steps + 1, n + m + flies, m * steps + flies))
        derivatives[:-1, n : n + m, : m * steps] = np.eye(m * steps).reshape(steps, m, m * steps)
        derivatives[:, n + m :, -1] = 1.0
        self._G = derivatives[:, :n, : m * steps]
        self._flown, self._flown_inputs = derivatives[:, :n, -1], derivatives[:-1, n : n + m, -1]
        self._recursion = list(zip(derivatives[:-1], derivatives[1:, :n], strict=True))
        # States before the first and after the last one with a weight have rows in S for the last stage only.
        weighted = np.flatnonzero(w.sqrt_Q)
        self._weighted = slice(weighted[0], weighted[-1] + 1) if weighted.size else slice(0)
        self._root_Q = w.sqrt_Q[self._weighted]
        rows = (steps - 1) * len(self._root_Q)
        self._S, self._error = np.empty((rows + n, m * steps)), np.empty(rows + n)
        self._stages = self._S[:rows].reshape(steps - 1, len(self._root_Q), m * steps)
        self._stage_errors = self._error[:rows].reshape(steps - 1, len(self._root_Q))

    def fly(self, ABf: Array, x0: Array, u: Array) -> Array:
        """Fly x_{k+1} = A_k x_k + B_k u_k + f_k, and compute G on the way.

        Args:
            ABf: (N, n, n + m + 1) the matrices [A_k B_k f_k].
            x0: (n,) first state.
            u: (N, m) inputs.

        Returns:
            (N + 1, n) states: a view, valid until the next call.
        """
        self._flown[0], self._flown_inputs[...] = x0, u
        self._respond(ABf)
        return self._flown

    def _respond(self, matrices: Array) -> None:
        for M, (before, after) in zip(matrices, self._recursion, strict=True):
            np.dot(M, before, out=after)

    def condense(self, x_nominal: Array, AB: Array | None, sqrt_Qf: Array) -> tuple[Array, Array]:
        """Compute G, unless it has just flown, and S = [sqrt_Q G; sqrt_Qf G_N].

        Returns:
            H = S'S + R, and the velocity rows of G.
        """
        G, S, n = self._G, self._S, len(sqrt_Qf)
        if AB is not None:
            unforced = len(self._recursion[0][0]) - AB.shape[2]
            self._respond(np.pad(AB, ((0, 0), (0, 0), (0, 1))) if unforced else AB)
        np.multiply(G[1:-1, self._weighted], self._root_Q[:, None], out=self._stages)
        np.dot(sqrt_Qf, G[-1], out=S[-n:])
        H = S.T @ S
        H.reshape(-1)[:: len(H) + 1] += self._R
        return H, G[1:].take(self._velocities, axis=1).reshape(len(H), len(H))

    def gradient(self, off: Array, sqrt_Qf: Array) -> Array:
        """Return S'e + R d for the weighted errors e of the nominal states, and the errors d of the inputs."""
        n = len(sqrt_Qf)
        np.multiply(off[:-1, self._weighted], self._root_Q, out=self._stage_errors)
        np.dot(sqrt_Qf, off[-1, :n], out=self._error[-n:])
        g = self._error @ self._S
        g += self._R * off[:, n:].ravel()
        return g

    def states(self, du: Array) -> Array:
        """Return the change (N + 1, n) of the predicted states under changes du (N, m) of the inputs."""
        return self._G.dot(du.ravel())


class Condenser:
    """Builds the QPs of one subsystem, all of the same horizon and with the same weights of the stages.

    A subsystem with constant matrices gets the same H and C arrays in every QP.

    Args:
        steps: N, the number of control periods with an input.
        limits: Bounds on the inputs and predicted velocities of the whole model.
        subsystem: The states and inputs of the LTV model to condense.
        w: The subsystem's weights in (26).
        responses: How the predicted states follow the inputs; step by step if not given.
    """

    def __init__(
        self, steps: int, limits: Limits, subsystem: Subsystem, w: Weights, responses: Responses | None = None
    ) -> None:
        self._subsystem, self._w = subsystem, w
        own = Limits(*(bound[subsystem.inputs] for bound in limits))
        u_min, u_max, v_max, self._travel = own
        self._bounds, self._shape = np.array([[-v_max, v_max], [u_min, u_max]])[:, :, None], (steps, len(v_max))
        self._columns = np.concatenate([subsystem.states, subsystem.inputs - 4])
        """Its states and inputs among those of the whole model, the inputs counted from the end."""
        self._responses = responses or StepByStep(steps, subsystem, w)
        self._constant: tuple[Array, Array, Array, Array] | None = None
        """H and C of a constant subsystem, its gradient for each error of the states and inputs, and its states for
        each input."""
        self._inverse: Array | None = None
        """Of the H of a constant subsystem."""
        self._changes: Array | None = None
        """Travel from one period to the next per input, where it is bounded."""
        if own.slow:
            self._changes = np.eye(steps * len(v_max)) - np.eye(steps * len(v_max), k=-len(v_max))

    def _all(self, x_nominal: Array, AB: Array | None, root: Array) -> tuple[Array, Array, Array, Array]:
        H, C = self._responses.condense(x_nominal, AB, root)
        gradients = [self._responses.gradient(off, root) for off in _units(self._shape[0], len(self._columns))]
        states = [self._responses.states(du).ravel() for du in _units(*self._shape)]
        return H, C, np.stack(gradients), np.stack(states)

    def response(self, du: Array) -> Array:
        """Return the change (N + 1, n) of the predicted states under changes du (N, m) of the inputs.

        It is that of the LTV model condensed last.
        """
        if self._constant is None:
            return self._responses.states(du)
        return (du.ravel() @ self._constant[3]).reshape(len(du) + 1, -1)

    def __call__(
        self, AB: Array | None, x_nominal: Array, u_nominal: Array, off: Array, sqrt_Qf: Array | None = None
    ) -> CondensedQp:
        """Condense one horizon: its cost and its bounds; arguments as of `cost` and `bounded`."""
        return self.bounded(self.cost(AB, x_nominal, off, sqrt_Qf), x_nominal, u_nominal, u_nominal[0])

    def cost(self, AB: Array | None, x_nominal: Array, off: Array, sqrt_Qf: Array | None = None) -> Cost:
        """Condense the cost of one horizon.

        Args:
            AB: (N, n, n + m) linear model of the subsystem; not needed for responses in closed form.
            x_nominal: (N + 1, nx) nominal states of the whole model.
            off: (N, nx + 4) states 1 .. N and inputs 0 .. N - 1 of the whole model minus those of the reference.
            sqrt_Qf: (n, n) root of this horizon's terminal weight if it differs; not with constant matrices.
        """
        root = self._w.sqrt_Qf if sqrt_Qf is None else sqrt_Qf
        own = off.take(self._columns, axis=1)
        if not self._subsystem.constant:
            H, C = self._responses.condense(x_nominal, AB, root)
            return Cost(H, self._responses.gradient(own, root), C)
        if self._constant is None:
            self._constant = self._all(x_nominal, AB, root)
            self._inverse = cast(Array, np.linalg.inv(self._constant[0]))
        H, C, gradients, _ = self._constant
        return Cost(H, own.ravel() @ gradients, C)

    def minimiser(self, cost: Cost) -> Array:
        """Return the changes (Nm,) of the inputs of least cost, whatever the bounds; NaN without curvature."""
        if self._inverse is not None:
            return self._inverse @ -cost.g
        return solve(cost.H, -cost.g)

    def bounded(self, cost: Cost, x_nominal: Array, u_nominal: Array, before: Array) -> CondensedQp:
        """Return the QP with this cost and its bounds.

        Args:
            cost: Of the nominal flight.
            x_nominal: (N + 1, nx) nominal states of the whole model.
            u_nominal: (N, 4) its nominal inputs.
            before: (4,) the inputs of the period before.
        """
        subsystem, nominal = self._subsystem, np.empty((2, 1, *self._shape))
        nominal[0, 0], nominal[1, 0] = x_nominal[1:, subsystem.velocity_columns], u_nominal[:, subsystem.input_columns]
        bounds = (self._bounds - nominal).reshape(4, -1)
        if self._changes is None:
            return CondensedQp(*cost, *bounds)
        v_low, v_high, *of_inputs = bounds
        changes = np.diff(nominal[1, 0], axis=0, prepend=before[None, subsystem.input_columns])
        v_low = np.append(v_low, (-self._travel - changes).ravel())
        v_high = np.append(v_high, (self._travel - changes).ravel())
        return CondensedQp(cost.H, cost.g, np.vstack([cost.C, self._changes]), v_low, v_high, *of_inputs)


def _units(*shape: int) -> Array:
    """Return all arrays of a shape in which one number is 1 and the others are 0."""
    count = prod(shape)
    return np.eye(count).reshape(count, *shape)


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
