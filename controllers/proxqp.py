"""The door to ProxSuite: dense ProxQP in a bounded time, with a softened second try."""

import sys
from math import isfinite
from time import perf_counter_ns
from types import ModuleType
from typing import NamedTuple

import numpy as np

from controllers.condensed_qp import CondensedQp
from controllers.signals import Array

# ProxSuite comes in three builds and takes the widest vectors that the processor has. The two wide ones sum in an
# order that depends on where malloc, which aligns to 16 bytes, has put their workspace: two flights of one experiment
# in one process differed in their last digits. The plain build does not, on any processor, for 0.02 ms a solve.
_cpu = ModuleType("proxsuite.instructionset")
vars(_cpu).update(has_AVX512F=lambda: False, has_AVX2=lambda: False)
sys.modules.setdefault(_cpu.__name__, _cpu)

from proxsuite import proxqp  # noqa: E402

ROUNDING = 1e-9
"""What ProxQP leaves of the multiplier of a bound that does not hold with equality."""


class Solution(NamedTuple):
    """A minimiser of a condensed QP."""

    du: Array
    """(n,) stacked departures of the inputs, inside their box to the solver's tolerance."""
    softened: bool
    """Whether the velocity bounds had to give."""
    slack: float
    """Largest excess over a velocity bound, m/s or rad/s; 0 unless softened."""
    iterations: int
    """Newton iterations, both attempts together."""
    objective: float
    """1/2 du'H du + g'du, and the penalty of the softening."""
    multipliers: Array
    """Of all bounds; the solver's own memory, which its next solve overwrites."""

    @property
    def active_bounds(self) -> int:
        """Multipliers above rounding."""
        return int(np.count_nonzero(np.abs(self.multipliers) > ROUNDING))


class ProxQp:
    """Solves one condensed QP a control step: the hard one first, then one whose velocity bounds can give.

    Warm-started by the last solution. An infeasible dense QP can take ProxQP minutes, and a barely feasible one
    is as bad (ProxSuite #291), so that both attempts work under a tight iteration limit. H, g, C and all bounds may
    change every step, since the model is time-varying; only where H and C are the very arrays of the last call are they
    not read again.

    The object keeps warm-start state: make a new one for every flight.

    Args:
        steps: N, the number of inputs in a row.
        inputs: m, how many there are at a time; N m variables.
        penalty: Weight of the slack of each velocity axis, linear and quadratic alike.
    """

    def __init__(self, steps: int, inputs: int, penalty: float = 1e3) -> None:
        n = inputs * steps
        self._n, self._m, self._penalty = n, inputs, penalty
        self._hard = _Solver(n, n, eps=1e-5, max_iter=9, max_iter_in=12)
        self._soft: _Solver | None = None
        self._gave_way = True
        self._axis = np.tile(np.eye(inputs), (steps, 1))
        self.solve_ns = 0
        """Measured wall time of the last call, ns."""

    def __call__(self, qp: CondensedQp) -> Solution | None:
        """Solve, or None where neither attempt converged."""
        began = perf_counter_ns()
        solution = self._solve(qp)
        self.solve_ns = perf_counter_ns() - began
        return solution

    def _solve(self, qp: CondensedQp) -> Solution | None:
        hard, iterations = self._hard, 0
        # A helicopter that is too fast stays so for a while: only the first step of that costs a futile attempt.
        if not (self._gave_way and _out_of_reach(qp, self._m)):
            if hard.solve(qp):
                self._gave_way = False
                return hard.solution(self._n, False, 0.0, 0)
            iterations = hard.iterations
        self._gave_way = True
        hard.forget()
        soft = self._soften(qp)
        if soft is None:
            return None
        return soft.solution(self._n, True, float(soft.x[self._n :].max()), iterations)

    def _soften(self, qp: CondensedQp) -> "_Solver | None":
        """Add one slack s >= 0 per velocity axis: v_low - s <= C du <= v_high + s.

        One slack that moves both bounds to one side would halve the rows, but a turning helicopter that is too
        fast has to pass from one bound to the other.
        """
        n, m, rows = self._n, self._m, len(qp.C)
        if self._soft is None:
            self._soft = _Solver(n + m, 2 * rows, eps=1e-4, max_iter=20, max_iter_in=60)
        H = np.zeros((n + m, n + m))
        H[:n, :n] = qp.H
        H[range(n, n + m), range(n, n + m)] = self._penalty
        soft, far = self._soft, np.full(rows, np.inf)
        softened = CondensedQp(
            H,
            np.concatenate([qp.g, np.full(m, self._penalty)]),
            np.block([[qp.C, self._axis], [qp.C, -self._axis]]),
            np.concatenate([qp.v_low, -far]),
            np.concatenate([far, qp.v_high]),
            np.concatenate([qp.u_low, np.zeros(m)]),
            np.concatenate([qp.u_high, np.full(m, np.inf)]),
        )
        if not soft.solve(softened):
            soft.forget()
            return None
        return soft


def _out_of_reach(qp: CondensedQp, m: int) -> bool:
    """Whether no input in the box brings the first predicted velocities inside their bounds.

    That is how a QP becomes infeasible in practice (the helicopter is too fast), and it is seen at once.
    """
    C, low, high = qp.C[:m, :m], qp.u_low[:m], qp.u_high[:m]
    middle, reach = C @ (0.5 * (low + high)), np.abs(C) @ (0.5 * (high - low))
    return bool((middle - reach > qp.v_high[:m]).any() or (middle + reach < qp.v_low[:m]).any())


class _Solver:
    """One ProxQP object of fixed size."""

    def __init__(self, n: int, m: int, *, eps: float, max_iter: int, max_iter_in: int) -> None:
        self._qp = proxqp.dense.QP(n, 0, m, True)
        self._settings, results = self._qp.settings, self._qp.results
        # Views of what ProxQP overwrites in every solve.
        self.x, self._z, self._info = results.x, results.z, results.info
        self._settings.eps_abs, self._settings.eps_rel = eps, 0.0
        # What is right is off by eps at most, what is wrong by far more.
        self._doubt = 10.0 * eps
        self._settings.max_iter, self._settings.max_iter_in = max_iter, max_iter_in
        self._settings.compute_timings = False
        self.forget()
        self._last: CondensedQp | None = None
        self.iterations = 0
        """Newton iterations of the last call."""

    def forget(self) -> None:
        """Start the next solve from nothing: a failed one leaves no useful guess."""
        self._settings.initial_guess = proxqp.NO_INITIAL_GUESS
        self._warm = False

    def solve(self, qp: CondensedQp) -> bool:
        """Solve; True where it converged to the minimiser.

        ProxQP 0.8 measures how well bounds are kept and gradients balanced, not whether multipliers have the signs of
        their bounds. Started from the last solution, it calls one problem in ten with active bounds solved that is not,
        up to a hundredth of full stick off. Started from nothing, it does not.
        """
        self.iterations, warm = 0, self._warm
        solved = self._attempt(qp)
        if solved and warm and self._contradictory(qp):
            self.forget()
            solved = self._attempt(qp)
        return solved

    def _attempt(self, qp: CondensedQp) -> bool:
        # init -> update before the first solve segfaults in ProxSuite 0.8.0; init -> solve -> update does not.
        last, self._last = self._last, qp
        if last is None:
            self._qp.init(qp.H, qp.g, None, None, qp.C, *qp[3:])
        elif qp.H is last.H and qp.C is last.C:
            self._qp.update(None, qp.g, None, None, None, *qp[3:])
        else:
            self._qp.update(qp.H, qp.g, None, None, qp.C, *qp[3:])
        self._qp.solve()
        self.iterations += self._info.iter
        if not self._warm:
            self._settings.initial_guess = proxqp.WARM_START_WITH_PREVIOUS_RESULT
            self._warm = True
        # An objective of finite numbers is one; of any other it is none.
        return self._info.status == proxqp.PROXQP_SOLVED and isfinite(self._info.objValue)

    def _contradictory(self, qp: CondensedQp) -> bool:
        """Whether a multiplier is not zero although its bound holds with room, or has the sign of the other bound."""
        x, z, rows = self.x, self._z, len(qp.C)
        if z.dot(z) < ROUNDING**2:
            return False
        for value, multiplier, low, high in (
            (qp.C.dot(x), z[:rows], qp.v_low, qp.v_high),
            (x, z[rows:], qp.u_low, qp.u_high),
        ):
            clipped = np.minimum(np.maximum(value + multiplier, low), high)
            if np.abs(value - clipped).max() > self._doubt:
                return True
        return False

    def solution(self, n: int, softened: bool, slack: float, iterations: int) -> Solution:
        """The last solve as an answer in `n` unknowns; `iterations` were spent on it before."""
        iterations += self.iterations
        return Solution(self.x[:n].copy(), softened, slack, iterations, self._info.objValue, self._z)
