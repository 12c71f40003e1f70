"""The paper's controller: linear time-varying model predictive control, (10)-(26), solved by ProxQP."""

from dataclasses import dataclass, field
from math import isfinite, pi
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt, Le, Unit, doc

from controllers.condensed_qp import CondensedQp, Condenser, Limits, Weights, riccati_terminal_weight
from controllers.laws import safe_hover
from controllers.ltv import N_STATES, NO_PUSH, PARTS, Coupling, Discretisation, Linearisation, Ltv, Part, shift
from controllers.model import Model
from controllers.proxqp import ProxQp, Solution
from controllers.signals import Array, Command, Estimate, Plan, QpReport, Reference

Weight = Annotated[float, Ge(0)]
InputWeight = Annotated[float, Gt(0)]


@dataclass(frozen=True, slots=True)
class LtvMpc:
    """LTV-MPC with the paper's horizon and weights (30)."""

    kind: Literal["ltv_mpc"] = "ltv_mpc"
    period: Annotated[float, Ge(0.001), Le(0.2), Unit("s"), doc("control period T_s")] = 0.02
    horizon: Annotated[int, Ge(1), Le(60), doc("p of (26): p + 1 inputs, p + 2 states")] = 18
    coupling: Annotated[Coupling, doc("yaw in the linear model of x and y; removed is what the paper flew")] = "removed"
    discretisation: Annotated[Discretisation, doc("of the linear model (17)")] = "euler"
    terminal: Annotated[Literal["paper", "riccati"], doc("Q_f = Q, or the Riccati cost-to-go")] = "paper"
    k_i: Annotated[float, Ge(0), Unit("1/s"), doc("gain of the integral states in (1)")] = 2.0
    offset_free: Annotated[
        Literal["off", "z", "all"], doc("axes on which the estimated disturbance is predicted and cancelled")
    ] = "off"
    Q: Annotated[
        tuple[Weight, Weight, Weight, Weight, Weight, Weight, Weight, Weight, Weight, Weight],
        doc("state weights: x y z yaw, vx vy vz yaw rate, x_int y_int"),
    ] = (50.0, 50.0, 5.0, 10.0, 3.0, 3.0, 1.0, 2.0, 15.0, 15.0)
    R: Annotated[
        tuple[InputWeight, InputWeight, InputWeight, InputWeight], doc("input weights: pitch, roll, thrust, yaw")
    ] = (2.0, 2.0, 2.0, 2.0)
    model: Annotated[Model, doc("the helicopter as the controller believes it")] = field(default_factory=Model)

    @property
    def steps(self) -> int:
        """Inputs in the horizon: the sums of (26) run over k = t .. t + p."""
        return self.horizon + 1

    def start(self) -> "LtvMpcController":
        """A controller for one flight."""
        return LtvMpcController(self)


class LtvMpcController:
    """One flight's LTV-MPC: the last plan, the integral states and the warm-started solvers."""

    def __init__(self, spec: LtvMpc) -> None:
        self._spec = spec
        model = spec.model
        self._limits = Limits(np.array(model.u_min), np.array(model.u_max), np.array(model.v_max))
        self._linearise = Linearisation(model, spec.k_i, spec.period, spec.coupling, spec.discretisation)
        Q = np.diag(spec.Q)
        self._weights = Weights(np.sqrt(np.array(spec.Q)), np.array(spec.R), np.sqrt(Q))
        if spec.terminal == "riccati":
            level = Linearisation(model, spec.k_i, spec.period, "removed", spec.discretisation)
            A, B = level.discretise(*level.jacobians(np.zeros((1, N_STATES))))
            P = riccati_terminal_weight(A[0], B[0], Q, np.diag(spec.R))
            self._weights = self._weights._replace(sqrt_Qf=np.linalg.cholesky(P).T)
        parts = PARTS[spec.coupling]
        self._shares = [_Share(part, spec.steps, self._limits, self._weights) for part in parts]
        self._solved: list[Solution] = []
        self._state_order = np.argsort(np.concatenate([part.states for part in parts]))
        self._u_nominal: Array | None = None
        self._flown: tuple[Ltv, Array] | None = None
        self._integral, self._last_error = np.zeros(2), np.zeros(2)
        self._half_step = 0.5 * spec.k_i * spec.period
        self._unsolved = 0

    def step(self, now: int, estimate: Estimate, reference: Reference) -> Command:
        """Solve (26) from the estimate and send the first input of the plan.

        Where the QP is infeasible or does not converge in time, its velocity bounds are softened; where that
        fails too, the last plan is flown on, and after its end a level hover is commanded.
        """
        self._flown = None
        if not all(map(isfinite, estimate.x.tolist())):
            return safe_hover(self._spec.model, now)
        ltv, qps = self.problem(estimate, reference)
        solutions = [share.solver(qp) for share, qp in zip(self._shares, qps, strict=True)]
        solve_ns = sum(share.solver.solve_ns for share in self._shares)
        solved, u = [solution for solution in solutions if solution], ltv.u_nominal
        if len(solved) == len(solutions):
            self._unsolved, steps = 0, self._spec.steps
            u = u + np.concatenate([solution.du.reshape(steps, -1) for solution in solved], axis=1)
            # ProxQP keeps bounds to its tolerance only; the radio would clip the excess anyway.
            u = np.minimum(np.maximum(u, self._limits.u_min), self._limits.u_max)
        else:
            self._unsolved += 1
            if self._unsolved > self._spec.steps:
                return safe_hover(self._spec.model, now)._replace(solve_ns=solve_ns)
            solved = []
        self._u_nominal, self._flown, self._solved = shift(u), (ltv, u), solved
        return Command(now, u[0], solve_ns=solve_ns)

    def explain(self, command: Command) -> Command:
        """Add the states that the LTV model reaches under the planned inputs, and how the QPs were solved."""
        if self._flown is None:
            return command
        ltv, u = self._flown
        du = u - ltv.u_nominal
        moved = [share.condenser.response(du.take(share.part.inputs, axis=1)) for share in self._shares]
        x = ltv.x_nominal + np.concatenate(moved, axis=1).take(self._state_order, axis=1)
        return command._replace(plan=Plan(x, u, ltv.u_nominal), qp=_report(self._solved))

    def linearise_along(self, u_nominal: Array) -> None:
        """Take these nominal inputs (N, 4) in the next step, not the shifted last plan: those of a log, for one."""
        self._u_nominal = u_nominal

    def problem(self, estimate: Estimate, reference: Reference) -> tuple[Ltv, list[CondensedQp]]:
        """Linearise along the nominal inputs and condense (26): one QP for each part of the model."""
        spec = self._spec
        error = estimate.x[:2] - reference.x[0, :2]
        self._integral += self._half_step * (error + self._last_error)
        self._last_error = error
        push, u_ref = NO_PUSH, reference.u
        if spec.offset_free != "off":
            cancelled = _CANCELLED[spec.offset_free] * estimate.disturbance
            ax, ay, az, a_yaw = cancelled.tolist()
            push, u_ref = (ax, ay, az, a_yaw), u_ref - _as_input(spec.model, cancelled, reference.x[:-1, 3])
        u_nominal = self._u_nominal
        if u_nominal is None:
            u_nominal = np.clip(u_ref, self._limits.u_min, self._limits.u_max)
        ltv = self._linearise(np.concatenate([estimate.x, self._integral]), u_nominal, reference.x[:, :2], push)
        x_off, u_off = ltv.x_nominal.copy(), u_nominal - u_ref
        x_off[:, :8] -= reference.x
        # The estimate counts turns from the first pose it saw, the plan from its own start.
        turns = round(float(x_off[0, 3]) / (2.0 * pi))
        if turns:
            x_off[:, 3] -= 2.0 * pi * turns
        weights = [share.weights for share in self._shares]
        if spec.terminal == "riccati":
            turned = self._turned_weights(ltv)
            weights = [turned.of(share.part) for share in self._shares]
        return ltv, [share.condenser(ltv, w, x_off, u_off) for share, w in zip(self._shares, weights, strict=True)]

    def _turned_weights(self, ltv: Ltv) -> Weights:
        """The Riccati weight belongs to a helicopter that looks north: turn it to the heading at the horizon's end."""
        yaw = ltv.x_nominal[-1, 3]
        turn = np.eye(N_STATES)
        for i in (0, 8):
            turn[i : i + 2, i : i + 2] = [[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]]
        return self._weights._replace(sqrt_Qf=self._weights.sqrt_Qf @ turn)


class _Share:
    """What one part of the model has in (26), with its own condenser and solver."""

    def __init__(self, part: Part, steps: int, limits: Limits, weights: Weights) -> None:
        self.part, self.weights = part, weights.of(part)
        self.condenser = Condenser(steps, limits, part)
        self.solver = ProxQp(steps, len(part.inputs))


_CANCELLED = {"z": np.array([0.0, 0.0, 1.0, 0.0]), "all": np.ones(4)}
"""Share of the disturbances x y z yaw that `offset_free` takes into account."""


def _as_input(model: Model, push: Array, yaw: Array) -> Array:
    """The inputs (n, 4) that accelerate as a push x y z (world), yaw (4,) does, at the headings yaw (n,)."""
    c, s = np.cos(yaw), np.sin(yaw)
    ahead, port = c * push[0] + s * push[1], c * push[1] - s * push[0]
    up, turn = np.full_like(yaw, push[2]), np.full_like(yaw, push[3])
    return np.stack([ahead / model.b_x, port / model.b_y, up / model.b_z, turn / model.b_yaw], axis=-1)


def _report(solutions: list[Solution]) -> QpReport:
    """All parts' solutions together; nothing solved is a plan flown on."""
    if not solutions:
        return QpReport("shifted_plan", 0, 0, 0.0, 0.0)
    return QpReport(
        "softened" if any(s.softened for s in solutions) else "solved",
        sum(s.iterations for s in solutions),
        sum(s.active_bounds for s in solutions),
        sum(s.objective for s in solutions),
        max(s.slack for s in solutions),
    )
