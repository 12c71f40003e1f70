"""One step of a receding-horizon controller: solve (26), send the first input, keep the plan.

It is the same for every believed model; a law gives the linear model along the last plan, the weights and the errors.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import cached_property
from math import isfinite, pi
from time import perf_counter_ns
from typing import Protocol

import numpy as np

from controllers.condensed_qp import CondensedQp, Condenser, Cost, Limits, Responses, Weights
from controllers.fallback import safe_hover
from controllers.ltv import Ltv, Subsystem, shift
from controllers.model import Model
from controllers.proxqp import ProxQp, Solution
from controllers.signals import NX, VELOCITIES, Array, Command, Estimate, Plan, QpReport, Reference


class RecedingSpec(Protocol):
    """The fields of a law that its receding-horizon steps need."""

    @property
    def model(self) -> Model:
        """The believed helicopter."""
        ...

    @property
    def period(self) -> float:
        """T_s, s."""
        ...

    @property
    def steps(self) -> int:
        """N, the number of inputs in the horizon."""
        ...


class RecedingHorizon(ABC):
    """A receding-horizon controller during one flight, with its last plan.

    Args:
        spec: Limits and horizon.
        subsystems: Parts of the linear model that do not act on one another.
        weights: Of the whole model.
        hover: The linear model in hover, for the sizes and the constant parts.
        plane: What replaces the recursion of the first subsystem, if it has a closed form.
    """

    integral_states = 0
    """Number of states after the eight physical ones that a `Plan` counts among its own."""

    def __init__(
        self,
        spec: RecedingSpec,
        subsystems: Sequence[Subsystem],
        weights: Weights,
        hover: Ltv,
        plane: Responses | None = None,
    ) -> None:
        model = spec.model
        self._model, self._steps = model, spec.steps
        travel = np.array(model.u_slew) * spec.period
        self._limits = Limits(np.array(model.u_min), np.array(model.u_max), np.array(model.v_max), travel)
        self._slow = self._limits.slow
        self.before = np.array(model.u_hover)
        """(4,) the planned inputs of the period before."""
        self._problems = [
            _Problem(part, self._limits, weights, hover, place, plane if place == 0 else None)
            for place, part in enumerate(subsystems)
        ]
        # All of them at once: NumPy takes twice as long where it has to repeat a row.
        low, high = np.array([self._limits.u_min, -self._limits.v_max]), np.array([*self._limits[1:3]])
        self._low, self._high = (bound[:, None].repeat(spec.steps, axis=1) for bound in (low, high))
        self._free, self._changes = np.empty((2, 2, spec.steps, len(model.u_min)))
        """The inputs, and the velocities that they drive, of least cost; and their changes from the nominal ones."""
        self._state_order = np.argsort(np.concatenate([part.states for part in subsystems]))
        self._u_nominal: Array | None = None
        self._planned: tuple[Ltv, Array, QpReport] | None = None
        self._unsolved = 0

    @abstractmethod
    def costs(self, estimate: Estimate, reference: Reference) -> tuple[Ltv, list[Cost]]:
        """Linearise along the nominal inputs and condense (26): one cost for each subsystem."""

    def problem(self, estimate: Estimate, reference: Reference) -> tuple[Ltv, list[CondensedQp]]:
        """Linearise along the nominal inputs and condense (26): one QP for each subsystem."""
        ltv, costs = self.costs(estimate, reference)
        return ltv, self._bounded(ltv, costs)

    def step(self, now: int, estimate: Estimate, reference: Reference) -> Command:
        """Solve (26) from the estimate and send the first input of the plan.

        If it has no solution, the last plan is continued, and after its end a level hover is commanded.
        """
        self._planned = None
        if not all(map(isfinite, estimate.x.tolist())):
            return self._level(now)
        ltv, costs = self.costs(estimate, reference)
        began = perf_counter_ns()
        solved = self._solved(ltv, costs)
        solve_ns = perf_counter_ns() - began
        self._unsolved = 0 if solved else self._unsolved + 1
        if self._unsolved > self._steps:
            return self._level(now)._replace(solve_ns=solve_ns)
        u, report = solved or (ltv.u_nominal, QpReport("shifted_plan", 0, 0, 0.0, 0.0))
        self._u_nominal, self._planned, self.before = shift(u), (ltv, u, report), u[0]
        return Command(now, u[0], solve_ns=solve_ns)

    def _level(self, now: int) -> Command:
        command = safe_hover(self._model, now)
        self.before = command.u
        return command

    def explain(self, command: Command) -> Command:
        """Add the states that the LTV model reaches under the planned inputs, and how the QPs were solved."""
        if self._planned is None:
            return command
        ltv, u, report = self._planned
        du = u - ltv.u_nominal
        dx = [problem.condenser.response(du.take(problem.subsystem.inputs, axis=1)) for problem in self._problems]
        x = ltv.x_nominal + np.concatenate(dx, axis=1).take(self._state_order, axis=1)
        own = NX + self.integral_states
        extra = x[:, own:] if x.shape[1] > own else None
        return Command(command.stamp, command.u, Plan(x[:, :own], u, ltv.u_nominal, extra), report, command.solve_ns)

    def _solved(self, ltv: Ltv, costs: Sequence[Cost]) -> tuple[Array, QpReport] | None:
        """Return the inputs (N, 4) of least cost within all bounds, and how they were found; None if they were not.

        The cost is strictly convex: where its minimiser without bounds keeps them all, it is the answer. Elsewhere
        ProxQP is asked, which softens the velocity bounds if it has to.
        """
        free, (u, speeds), (du, dv), objective = self._free, self._free, self._changes, 0.0
        for problem, cost in zip(self._problems, costs, strict=True):
            part, shape, columns = problem.condenser.minimiser(cost), problem.shape, problem.subsystem.input_columns
            du[:, columns], dv[:, columns] = part.reshape(shape), (cost.C @ part).reshape(shape)
            objective += 0.5 * float(cost.g @ part)
        np.add(ltv.u_nominal, du, u)
        np.add(ltv.x_nominal[1:, VELOCITIES], dv, speeds)
        # To look for a 0 among the bytes takes a third of the time of `all`; NaN is not within.
        kept = 0 not in (free >= self._low).tobytes() and 0 not in (free <= self._high).tobytes()
        if kept and (not self._slow or self._limits.keep_travel(u, self.before)):
            return u.copy(), QpReport("solved", 0, 0, objective, 0.0)
        qps = zip(self._problems, self._bounded(ltv, costs), strict=True)
        solutions = [solution for problem, qp in qps if (solution := problem.solver(qp))]
        if len(solutions) < len(costs):
            return None
        # ProxQP keeps bounds to its tolerance only; the radio would clip the excess anyway.
        parts = [solution.du.reshape(self._steps, -1) for solution in solutions]
        found = ltv.u_nominal + np.concatenate(parts, axis=1)
        return np.clip(found, self._low[0], self._high[0]), _report(solutions)

    def _bounded(self, ltv: Ltv, costs: Sequence[Cost]) -> list[CondensedQp]:
        """Return one QP for each subsystem: its cost, and the bounds about the nominal flight."""
        x, u = ltv.x_nominal, ltv.u_nominal
        before = self.before
        return [
            problem.condenser.bounded(cost, x, u, before) for problem, cost in zip(self._problems, costs, strict=True)
        ]

    def linearise_along(self, u_nominal: Array) -> None:
        """Use these nominal inputs (N, 4), for example of a log, in the next step instead of the shifted last plan."""
        self._u_nominal = u_nominal

    def nominal(self, u_ref: Array) -> Array:
        """The nominal inputs (N, 4): the shifted last plan, at first the reference's inputs u_ref (N, 4)."""
        return np.clip(u_ref, self._limits.u_min, self._limits.u_max) if self._u_nominal is None else self._u_nominal

    def condensed(self, ltv: Ltv, off: Array, sqrt_Qf: Sequence[Array | None]) -> list[Cost]:
        """Condense the cost of each subsystem; arguments as `Condenser.cost` takes them, roots one a subsystem."""
        return [
            problem.condenser.cost(AB, ltv.x_nominal, off, root)
            for problem, AB, root in zip(self._problems, ltv.parts, sqrt_Qf, strict=True)
        ]


def off_reference(ltv: Ltv, x_ref: Array, u_ref: Array) -> Array:
    """Return states 1 .. N and inputs 0 .. N - 1 of the nominal flight minus those of the reference, (N, n + 4).

    Whole turns are no error: the estimate and the plan each count them from their own start.

    Args:
        ltv: The nominal flight.
        x_ref: (N + 1, k) reference of the k first states; that of the others is 0.
        u_ref: (N, 4) reference inputs.
    """
    x, k = ltv.x_nominal, x_ref.shape[1]
    steps, n = len(u_ref), x.shape[1]
    off = np.empty((steps, n + u_ref.shape[1]))
    np.subtract(x[1:, :k], x_ref[1:], off[:, :k])
    off[:, k:n] = x[1:, k:]
    np.subtract(ltv.u_nominal, u_ref, off[:, n:])
    turns = round((float(x[0, 3]) - float(x_ref[0, 3])) / (2.0 * pi))
    if turns:
        off[:, 3] -= 2.0 * pi * turns
    return off


class _Problem:
    """The optimisation (26) of one subsystem: its condenser and solver."""

    def __init__(
        self,
        subsystem: Subsystem,
        limits: Limits,
        weights: Weights,
        hover: Ltv,
        place: int,
        responses: Responses | None,
    ) -> None:
        AB, x, u = hover.parts[place], hover.x_nominal, hover.u_nominal
        self.subsystem, self.weights = subsystem, weights.of(subsystem)
        self.condenser = Condenser(len(u), limits, subsystem, self.weights, responses)
        self.shape = len(u), len(subsystem.inputs)
        self._sample = self.condenser(AB, x, u, np.zeros((len(u), x.shape[1] + u.shape[1])))

    @cached_property
    def solver(self) -> ProxQp:
        """Rarely needed and slow to set up."""
        return ProxQp(self._sample, len(self.subsystem.inputs))


def _report(solutions: list[Solution]) -> QpReport:
    """Sum up the subsystems' solutions."""
    return QpReport(
        "softened" if any(s.softened for s in solutions) else "solved",
        sum(s.iterations for s in solutions),
        sum(s.active_bounds for s in solutions),
        sum(s.objective for s in solutions),
        max(s.slack for s in solutions),
    )
