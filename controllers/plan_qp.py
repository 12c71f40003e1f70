"""The QP of a plan that ends at rest: it follows a target, within limits, behind half-spaces; solved by ProxQP.

The acceleration of each axis is linear between the knots k = 0 .. N, h apart, so that the plan is a cubic there:

    v_{k+1} = v_k + h (a_k + a_{k+1}) / 2,   p_{k+1} = p_k + h v_k + h^2 (2 a_k + a_{k+1}) / 6

The state at knot 0 is given, and a_N = 0; a_1 .. a_{N-1} are unknown. Minimise the sum of |p_k - target_k|^2,
w_a |a_k|^2 and w_j |(a_{k+1} - a_k) / h|^2 subject to limits on |a_k| and |v_k| of each axis, v_N = 0, and
n_i . p_{k(i)} >= b_i for each half-space i.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from controllers.condensed_qp import CondensedQp
from controllers.proxqp import Solver
from controllers.signals import Array

ROWS = 40
"""Half-spaces are padded to a multiple of this number: a solver has a fixed size, and a new one takes milliseconds."""
MOST_ROWS = 400
"""More are not solved."""


class HalfSpaces(NamedTuple):
    """Sides of lines on which knots have to be."""

    knots: NDArray[np.int64]
    """(r,) indices k of the knots, 1 .. N."""
    normals: Array
    """(r, m) unit normals, to the allowed side."""
    offsets: Array
    """(r,) b: normal . position >= b, m."""


class Effort(NamedTuple):
    """Limits of each axis, and weights against the squared distance from the target."""

    speed: float
    """m/s or rad/s."""
    acceleration: float
    """m/s^2 or rad/s^2."""
    w_a: float = 0.02
    """Weight of an acceleration."""
    w_j: float = 0.01
    """Weight of a jerk."""


class PlanQp:
    """Plans m axes of N steps.

    Args:
        steps: N.
        h: Duration of a step, s.
        axes: m.
        effort: Limits and weights.
    """

    def __init__(self, steps: int, h: float, axes: int, effort: Effort) -> None:
        self._steps, self._h, self._axes, self._effort = steps, h, axes, effort
        # Velocities and positions of knots 1 .. N per acceleration of knots 0 .. N, by the recursion.
        every = np.eye(steps + 1)
        speeds, places = np.zeros((2, steps + 1, steps + 1))
        for k in range(steps):
            speeds[k + 1] = speeds[k] + 0.5 * h * (every[k] + every[k + 1])
            places[k + 1] = places[k] + h * speeds[k] + h * h / 6.0 * (2.0 * every[k] + every[k + 1])
        self._speeds, self._places = speeds, places
        self._jerks = np.diff(every, axis=0) / h
        P, J = places[1:, 1:-1], self._jerks[:, 1:-1]
        self._n = (steps - 1) * axes
        self._efforts = effort.w_a * np.eye(steps - 1) + effort.w_j * J.T @ J
        self._H: Array = np.kron(2.0 * (P.T @ P + self._efforts), np.eye(axes)).astype(np.float64)
        self._C: Array = np.kron(speeds[1:, 1:-1], np.eye(axes)).astype(np.float64)
        self._solvers: dict[int, Solver] = {}
        self.iterations = 0
        """Newton iterations of the last call."""

    def __call__(
        self, old: Array, target: Array, behind: HalfSpaces | None = None, weights: Array | None = None
    ) -> Array | None:
        """Return the knots (N + 1, 3, m) of the best plan; None if ProxQP finds none.

        Args:
            old: (N + 1, 3, m) knots of a plan that is within the limits or, where it is not, moves them: the new one
                starts at its first knot, and the old one itself stays feasible.
            target: (N, m) where to be at knots 1 .. N.
            behind: Half-spaces.
            weights: (N,) of the squared distance from the target at knots 1 .. N; 1 if not given.
        """
        e, h, N, m = self._effort, self._h, self._steps, self._axes
        p0, v0, a0 = old[0]
        # What the knots do without the unknowns.
        speeds = v0 + self._speeds[1:, :1] * a0
        places = p0 + h * np.arange(1, N + 1)[:, None] * v0 + self._places[1:, :1] * a0
        H, P, off = self._H, self._places[1:, 1:-1], places - target
        if weights is not None:
            H = np.kron(2.0 * (P.T @ (weights[:, None] * P) + self._efforts), np.eye(m)).astype(np.float64)
            off = weights[:, None] * off
        gradient = 2.0 * P.T @ off
        gradient += 2.0 * e.w_j * self._jerks[:, 1:-1].T @ (self._jerks[:, :1] * a0)
        limit = np.maximum(e.speed, np.abs(old[1:, 1]))
        limit[-1] = 0.0
        push = np.maximum(e.acceleration, np.abs(old[1:-1, 2])).ravel()
        C, low, high = self._C, (-limit - speeds).ravel(), (limit - speeds).ravel()
        if behind is not None:
            rows = -(-len(behind.offsets) // ROWS) * ROWS
            if rows > MOST_ROWS:
                return None
            sides = np.zeros((rows, N - 1, m))
            free = np.full(rows, -np.inf)
            here = behind.knots - 1
            responses = self._places[1:, 1:-1][here]
            sides[: len(here)] = responses[:, :, None] * behind.normals[:, None, :]
            free[: len(here)] = behind.offsets - (behind.normals * places[here]).sum(axis=1)
            C = np.concatenate([C, sides.reshape(rows, -1)])
            low, high = np.concatenate([low, free]), np.concatenate([high, np.full(rows, np.inf)])
        qp = CondensedQp(H, gradient.ravel(), C, low, high, -push, push)
        solver = self._solvers.get(len(C))
        if solver is None:
            solver = self._solvers[len(C)] = Solver(self._sample(len(C)), eps=1e-5, max_iter=30, max_iter_in=50)
        solved = solver.solve(qp)
        self.iterations = solver.iterations
        return self._knots(old[0], solver.x.reshape(N - 1, m)) if solved else None

    def _sample(self, rows: int) -> CondensedQp:
        """A QP of the usual scale: at rest, with half-spaces of the last knot."""
        n, wall = self._n, np.tile(self._places[-1, 1:-1].repeat(self._axes), (rows - len(self._C), 1))
        C, far = np.concatenate([self._C, wall]), np.ones(rows)
        return CondensedQp(self._H, np.zeros(n), C, -far, far, -np.ones(n), np.ones(n))

    def _knots(self, first: Array, unknown: Array) -> Array:
        """Fly the accelerations (N - 1, m) of knots 1 .. N - 1."""
        N, m = self._steps, self._axes
        knots = np.zeros((N + 1, 3, m))
        knots[0], knots[1:-1, 2] = first, unknown
        a = knots[:, 2]
        knots[:, 1] = first[1] + self._speeds @ a
        knots[:, 0] = first[0] + self._h * np.arange(N + 1)[:, None] * first[1] + self._places @ a
        # The solver's tolerance.
        knots[-1, 1] = 0.0
        return knots
