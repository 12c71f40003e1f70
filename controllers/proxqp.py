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


class Solution(NamedTuple):
    """A minimiser of a condensed QP."""

    u: Array
    """(n,) stacked inputs, inside their box."""
    softened: bool
    """Whether the velocity bounds had to give."""
    slack: float
    """Largest excess over a velocity bound, m/s or rad/s; 0 unless softened."""
    iterations: int
    """Newton iterations, both attempts together."""
    active_bounds: int
    """Multipliers above rounding."""
    objective: float
    """1/2 u'H u + g'u, and the penalty of the softening."""


class ProxQp:
    """Solves one condensed QP a control step: the hard one first, then one whose velocity bounds can give.

    Warm-started by the last solution. An infeasible dense QP can take ProxQP minutes, and a barely feasible one
    is as bad (ProxSuite #291), so that both attempts work under a tight iteration limit. H, g, C and all bounds may
    change every step, since the model is time-varying; only an array that is the very one of the last call is not read
    again.

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
                return hard.solution(qp, False, 0.0, 0)
            iterations = hard.iterations
        self._gave_way = True
        hard.forget()
        soft = self._soften(qp)
        if soft is None:
            return None
        return soft.solution(qp, True, float(soft.x[self._n :].max()), iterations)

    def _soften(self, qp: CondensedQp) -> "_Solver | None":
        """Add one slack s >= 0 per velocity axis: v_low - s <= C u <= v_high + s.

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


ROUNDING = 1e-9
"""What ProxQP leaves of the multiplier of a bound that does not hold with equality."""


class _Solver:
    """One ProxQP object of fixed size."""

    def __init__(self, n: int, m: int, *, eps: float, max_iter: int, max_iter_in: int) -> None:
        self._qp = proxqp.dense.QP(n, 0, m, True)
        self._settings, results = self._qp.settings, self._qp.results
        # Views of what ProxQP overwrites in every solve.
        self.x, self._z, self._info = results.x, results.z, results.info
        self._settings.eps_abs, self._settings.eps_rel = eps, 0.0
        self._settings.max_iter, self._settings.max_iter_in = max_iter, max_iter_in
        self._settings.compute_timings = False
        self.forget()
        self._last: CondensedQp | None = None

    def forget(self) -> None:
        """Start the next solve from nothing: a failed one leaves no useful guess."""
        self._settings.initial_guess = proxqp.NO_INITIAL_GUESS
        self._warm = False

    def solve(self, qp: CondensedQp) -> bool:
        """Solve; True where it converged to a finite point."""
        # init -> update before the first solve segfaults in ProxSuite 0.8.0; init -> solve -> update does not.
        last, self._last = self._last, qp
        if last is None:
            self._qp.init(qp.H, qp.g, None, None, qp.C, *qp[3:])
        elif qp.H is last.H and qp.C is last.C and qp.u_low is last.u_low and qp.u_high is last.u_high:
            self._qp.update(None, qp.g, None, None, None, qp.v_low, qp.v_high)
        else:
            self._qp.update(qp.H, qp.g, None, None, qp.C, *qp[3:])
        self._qp.solve()
        if not self._warm:
            self._settings.initial_guess = proxqp.WARM_START_WITH_PREVIOUS_RESULT
            self._warm = True
        # An objective of finite numbers is one; of any other it is none.
        return self._info.status == proxqp.PROXQP_SOLVED and isfinite(self._info.objValue)

    @property
    def iterations(self) -> int:
        """Newton iterations of the last solve."""
        return self._info.iter

    def solution(self, qp: CondensedQp, softened: bool, slack: float, iterations: int) -> Solution:
        """The last solve as an answer to `qp`; `iterations` were spent on it before."""
        # ProxQP keeps bounds to its tolerance only; the radio would clip the excess anyway.
        u = np.minimum(np.maximum(self.x[: len(qp.g)], qp.u_low), qp.u_high)
        active = int(np.count_nonzero(np.abs(self._z) > ROUNDING))
        return Solution(u, softened, slack, iterations + self._info.iter, active, self._info.objValue)
