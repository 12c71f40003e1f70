"""The door to ProxSuite: dense ProxQP with bounded iterations, first with hard, then with softened velocity bounds."""

import sys
import warnings
from functools import cached_property
from math import isfinite, log2
from types import ModuleType
from typing import NamedTuple

import numpy as np

from controllers.condensed_qp import CondensedQp
from controllers.signals import Array

# ProxSuite comes in three builds and takes the widest vectors that the processor has. The two wide ones sum in an
# order that depends on where malloc, which aligns to 16 bytes, has put their workspace: two flights of one experiment
# in one process differed in their last digits. The plain build does not, on any processor, for 0.02 ms a solve.
# A process can load one build only, so that it is the caller's choice if ProxSuite was imported before.
_cpu = ModuleType("proxsuite.instructionset")
vars(_cpu).update(has_AVX512F=lambda: False, has_AVX2=lambda: False)
sys.modules.setdefault(_cpu.__name__, _cpu)

from proxsuite import proxqp  # noqa: E402

if sys.modules[_cpu.__name__] is _cpu:
    del sys.modules[_cpu.__name__]

BUILD: str = proxqp.__name__.split(".")[1].removeprefix("proxsuite_pywrap").strip("_") or "plain"
"""The build of ProxSuite that runs: `plain`, `avx2` or `avx512`."""
BUILD_TROUBLE = ""
"""One sentence if another build than the plain one runs."""
if BUILD != "plain":
    BUILD_TROUBLE = (
        f"ProxSuite was imported before heli_twin and runs its {BUILD} build, whose last digits depend on memory"
        " addresses: the same experiment can give another flight digest; import heli_twin first"
    )
    warnings.warn(BUILD_TROUBLE, RuntimeWarning, stacklevel=2)

SMALLEST_CURVATURE = 2.0
"""A cost with a smaller curvature, such as one of small input weights, is scaled up to about this one, which is that of
the paper's weights: the tolerances are on the gradient and the cost, and allow errors of the inputs in proportion to
their inverse."""
DUALITY_GAP = 10.0
"""Largest difference between primal and dual cost of a solution, in tolerances. Without this test of complementarity
ProxQP calls some problems solved whose inputs are wrong by a third of full stick."""
ACTIVE_MULTIPLIER = 1e-9
"""Smallest multiplier of an active bound; ProxQP leaves rounding errors below it on inactive ones."""


class Solution(NamedTuple):
    """The minimiser of a condensed QP."""

    du: Array
    """(n,) stacked changes of the inputs, inside their bounds to the solver's tolerance."""
    softened: bool
    """True if the velocity bounds were softened."""
    slack: float
    """Largest excess over a velocity bound, m/s or rad/s; 0 unless softened."""
    iterations: int
    """Newton iterations, both attempts together."""
    objective: float
    """1/2 du'H du + g'du, and the penalty of the softening."""
    multipliers: Array
    """Multipliers of all bounds, of the scaled cost: a view of the solver's memory, valid until its next solve."""

    @property
    def active_bounds(self) -> int:
        """Number of bounds with a multiplier above rounding."""
        return int(np.count_nonzero(np.abs(self.multipliers) > ACTIVE_MULTIPLIER))


class ProxQp:
    """Solves one condensed QP a control step: first with hard velocity bounds, then with softened ones.

    It is for QPs with an active bound: without one, a linear equation gives the minimiser, and ProxQP begins with it by
    default. A solve depends on nothing but its QP. A warm start is worse: it takes twice the iterations, and after a
    bound was relaxed the old solution was accepted without any (ProxSuite #168).

    An infeasible dense QP can take ProxQP minutes, and an almost infeasible one as long (ProxSuite #291): both attempts
    have a limit on their iterations.

    Args:
        sample: A QP of the size and scale of those to solve; ProxQP's scaling of variables and rows comes from it.
        inputs: m, the number of velocity axes, each with its own slack.
        penalty: Weight of each slack, linear and quadratic.
    """

    def __init__(self, sample: CondensedQp, inputs: int, penalty: float = 1e3) -> None:
        self._sample, self._n, self._m, self._penalty = sample, len(sample.g), inputs, penalty
        self._axis = np.zeros((len(sample.C), inputs))
        self._axis[: self._n] = np.tile(np.eye(inputs), (self._n // inputs, 1))
        # Slow servos are at their speed in most periods: of 400 random starts 396 are solved with
        # these limits, in 33 iterations in the mean and 116 at most, and 207 with those of the others.
        most = (30, 40) if len(sample.C) > self._n else (9, 12)
        self._hard = Solver(sample, eps=1e-5, max_iter=most[0], max_iter_in=most[1])

    def __call__(self, qp: CondensedQp) -> Solution | None:
        """Solve, or return None if neither attempt converged."""
        iterations, n = 0, self._n
        if not _out_of_reach(qp, self._m):
            hard = self._hard
            if hard.solve(qp):
                return Solution(hard.x.copy(), False, 0.0, hard.iterations, hard.objective, hard.z)
            iterations = hard.iterations
        soft = self._soft
        if not soft.solve(self._softened(qp)):
            return None
        iterations += soft.iterations
        return Solution(soft.x[:n].copy(), True, float(soft.x[n:].max()), iterations, soft.objective, soft.z)

    @cached_property
    def _soft(self) -> "Solver":
        """Rarely needed and slow to set up."""
        return Solver(self._softened(self._sample), eps=1e-4, max_iter=20, max_iter_in=60)

    def _softened(self, qp: CondensedQp) -> CondensedQp:
        """Add one slack s >= 0 per velocity axis: v_low - s <= C du <= v_high + s. Rows of travel stay hard.

        One slack that shifts both bounds in one direction would halve the rows, but a turning helicopter that is too
        fast can exceed first one bound and then the opposite one within a horizon.
        """
        n, m, far = self._n, self._m, np.full(len(qp.C), np.inf)
        H = np.zeros((n + m, n + m))
        H[:n, :n] = qp.H
        H[range(n, n + m), range(n, n + m)] = self._penalty
        return CondensedQp(
            H,
            np.concatenate([qp.g, np.full(m, self._penalty)]),
            np.block([[qp.C, self._axis], [qp.C, -self._axis]]),
            np.concatenate([qp.v_low, -far]),
            np.concatenate([far, qp.v_high]),
            np.concatenate([qp.u_low, np.zeros(m)]),
            np.concatenate([qp.u_high, np.full(m, np.inf)]),
        )


def _out_of_reach(qp: CondensedQp, m: int) -> bool:
    """Return True if no input in the box brings the m first predicted velocities within their bounds.

    That is the usual reason why a QP is infeasible (the helicopter is too fast), and costs less than a futile attempt.
    """
    v_low, v_high = qp.v_low[:m], qp.v_high[:m]
    if max(v_low.tolist()) <= 0.0 <= min(v_high.tolist()):
        return False
    C, low, high = qp.C[:m, :m], qp.u_low[:m], qp.u_high[:m]
    middle, reach = C @ (0.5 * (low + high)), np.abs(C) @ (0.5 * (high - low))
    return bool((middle - reach > v_high).any() or (middle + reach < v_low).any())


class Solver:
    """One ProxQP object of fixed size and scaling."""

    def __init__(self, sample: CondensedQp, *, eps: float, max_iter: int, max_iter_in: int) -> None:
        self._qp = proxqp.dense.QP(len(sample.g), 0, len(sample.C), True)
        settings, results = self._qp.settings, self._qp.results
        # Views of what ProxQP overwrites in every solve.
        self.x, self.z, self._info = results.x, results.z, results.info
        settings.eps_abs, settings.eps_rel = eps, 0.0
        settings.max_iter, settings.max_iter_in = max_iter, max_iter_in
        settings.check_duality_gap, settings.eps_duality_gap_abs = True, DUALITY_GAP * eps
        settings.compute_timings = False
        settings.initial_guess = proxqp.EQUALITY_CONSTRAINED_INITIAL_GUESS
        self._scale = _scale(sample.H)
        self._largest = eps / np.finfo(float).eps / self._scale
        self._qp.init(self._scaled(sample.H), self._scaled(sample.g), None, None, sample.C, *sample[3:])
        # The matrices that ProxQP has read last; the same arrays again are not read again.
        self._H: Array = np.empty(0)
        self._C: Array = self._H
        self.iterations = 0
        """Newton iterations of the last call."""
        self.objective = 0.0
        """Cost of the last minimiser."""

    def solve(self, qp: CondensedQp) -> bool:
        """Solve; return True if it converged.

        A gradient that is non-finite, or has rounding errors above the tolerance, is refused: ProxQP would use up all
        its iterations, which take up to seconds.
        """
        self.iterations = 0
        H, g, C = qp.H, qp.g, qp.C
        if not (np.abs(g).max() < self._largest and (H is self._H or H.diagonal().max() < self._largest)):
            return False
        self._qp.update(
            None if H is self._H else self._scaled(H), self._scaled(g), None, None, None if C is self._C else C, *qp[3:]
        )
        self._H, self._C = H, C
        self._qp.solve()
        info = self._info
        self.iterations, self.objective = info.iter, info.objValue / self._scale
        return info.status == proxqp.PROXQP_SOLVED and isfinite(self.objective)

    def _scaled(self, cost: Array) -> Array:
        return cost if self._scale == 1.0 else self._scale * cost


def _scale(H: Array) -> float:
    """Return the power of two, 1 at least, that brings the smallest curvature nearest to `SMALLEST_CURVATURE`."""
    curvatures = np.linalg.eigvalsh(H)
    # One below the rounding of the greatest is not known.
    least = max(curvatures[0], np.finfo(float).eps * curvatures[-1])
    return 2.0 ** max(0, round(log2(SMALLEST_CURVATURE / least)))
