"""The paper's controller: linear time-varying model predictive control, (10)-(26), solved by ProxQP."""

from dataclasses import dataclass, field
from math import hypot
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt, Le, Unit, doc

from controllers.condensed_qp import Cost, Weights, riccati_terminal_weight, sqrt_weight
from controllers.ltv import NO_PUSH, SUBSYSTEMS, Coupling, Discretisation, Linearisation, Ltv
from controllers.model import Model
from controllers.planar import Planar
from controllers.receding import RecedingHorizon, off_reference
from controllers.rotations import rotate_to_body
from controllers.signals import Array, Estimate, Reference

Weight = Annotated[float, Ge(0)]
InputWeight = Annotated[float, Gt(0)]


@dataclass(frozen=True, slots=True)
class LtvMpc:
    """LTV-MPC with the paper's horizon and weights.

    The Riccati terminal weight leaves out integral states that have no gain `k_i` or no weight in Q.

    The defaults are the paper's horizon and weights (30).
    """

    kind: Literal["ltv_mpc"] = "ltv_mpc"
    period: Annotated[float, Ge(0.001), Le(0.2), Unit("s"), doc("control period T_s")] = 0.02
    horizon: Annotated[int, Ge(1), Le(60), doc("p of (26): p + 1 inputs, p + 2 states")] = 18
    coupling: Annotated[Coupling, doc("yaw in the linear model of x and y; removed is what the paper flew")] = "removed"
    discretisation: Annotated[Discretisation, doc("of the linear model (17)")] = "euler"
    terminal: Annotated[Literal["paper", "riccati"], doc("Q_f = Q, or the Riccati cost-to-go")] = "paper"
    k_i: Annotated[float, Ge(0), Unit("1/s"), doc("gain of the integral states in (1)")] = 2.0
    integral_zone: Annotated[
        float, Gt(0), Unit("m"), doc("anti-windup: beyond this horizontal error the integral states rest")
    ] = 0.3
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

    def __post_init__(self) -> None:
        """Refuse a terminal weight that does not exist.

        Raises:
            ValueError: The Riccati equation has no solution in double precision.
        """
        if self.terminal == "riccati":
            try:
                _sqrt_riccati_weight(self)
            except ValueError as error:
                raise ValueError(
                    f"terminal = 'riccati' does not exist for these Q, R and k_i = {self.k_i}: {error};"
                    " choose them nearer to their defaults, or terminal = 'paper'"
                ) from None

    @property
    def steps(self) -> int:
        """Number of inputs in the horizon: the sums of (26) run over k = t .. t + p."""
        return self.horizon + 1

    def start(self) -> "LtvMpcController":
        """Return a controller for one flight."""
        return LtvMpcController(self)


class LtvMpcController(RecedingHorizon):
    """The LTV-MPC of one flight, with its last plan and its integral states."""

    integral_states = 2

    def __init__(self, spec: LtvMpc) -> None:
        self._spec = spec
        self._linearise = Linearisation(spec.model, spec.k_i, spec.period, spec.coupling, spec.discretisation)
        Q = np.diag(spec.Q)
        self._weights = Weights(np.sqrt(np.array(spec.Q)), np.array(spec.R), np.sqrt(Q))
        if spec.terminal == "riccati":
            self._weights = self._weights._replace(sqrt_Qf=_sqrt_riccati_weight(spec))
        at_rest, u_hover = np.zeros((spec.steps + 1, len(Q))), np.tile(spec.model.u_hover, (spec.steps, 1))
        hover = self._linearise(at_rest[0], u_hover, at_rest[:, :2])
        parts, plane = SUBSYSTEMS[spec.coupling], None
        self._closed = spec.coupling == "removed" and spec.discretisation == "euler"
        """Height and yaw are constant, and the plane has a closed form: no matrices are needed in flight."""
        if self._closed and hover.parts[0] is not None:
            plane = Planar(hover.parts[0], self._weights.of(parts[0]))
        super().__init__(spec, parts, self._weights, hover, plane)
        self._integral = self._last_error = (0.0, 0.0)
        self._half_step = 0.5 * spec.k_i * spec.period

    def costs(self, estimate: Estimate, reference: Reference) -> tuple[Ltv, list[Cost]]:
        """Linearise along the nominal inputs and condense (26): one cost for each subsystem."""
        spec = self._spec
        (x, y), (x_ref, y_ref) = estimate.x[:2].tolist(), reference.x[0, :2].tolist()
        error_x, error_y = x - x_ref, y - y_ref
        # A helicopter on its way to a distant reference is not pushed away by anything.
        if hypot(error_x, error_y) <= spec.integral_zone:
            (last_x, last_y), (x_int, y_int), half = self._last_error, self._integral, self._half_step
            self._integral = (x_int + half * (error_x + last_x), y_int + half * (error_y + last_y))
        self._last_error = (error_x, error_y)
        push, u_ref = NO_PUSH, reference.u
        if spec.offset_free != "off":
            cancelled = _CANCELLED[spec.offset_free] * estimate.disturbance
            ax, ay, az, a_yaw = cancelled.tolist()
            push, u_ref = (ax, ay, az, a_yaw), u_ref - _as_input(spec.model, cancelled, reference.x[:-1, 3])
        u_nominal = self.nominal(u_ref)
        flight = np.array((*estimate.x.tolist(), *self._integral)), u_nominal, reference.x[:, :2], push
        if self._closed:
            ltv = Ltv(_NO_MATRICES, self._linearise.rollout(*flight), u_nominal)
        else:
            ltv = self._linearise(*flight)
        roots: list[Array | None] = [None] * len(self._problems)
        if spec.terminal == "riccati":
            at_heading = self._weights_at_heading(ltv.x_nominal[-1, 3])
            roots = [at_heading.of(problem.subsystem).sqrt_Qf for problem in self._problems]
        return ltv, self.condensed(ltv, off_reference(ltv, reference.x, u_ref), roots)

    def _weights_at_heading(self, yaw: Array) -> Weights:
        """The Riccati weight was computed for yaw = 0: rotate it to the yaw at the end of the horizon."""
        rotation = np.eye(len(self._weights.sqrt_Qf))
        for i in (0, 8):
            rotation[i : i + 2, i : i + 2] = rotate_to_body(np.eye(2), yaw).T
        return self._weights._replace(sqrt_Qf=self._weights.sqrt_Qf @ rotation)


def _sqrt_riccati_weight(spec: LtvMpc) -> Array:
    """Symmetric root (10, 10) of the Riccati terminal weight at yaw = 0.

    With k_i = 0 the integral states are constant and no input reaches them: they are left out, as if their weights were
    0. States that no weight sees, such as integral states with weight 0, have a terminal weight of 0.
    """
    model = Linearisation(spec.model, spec.k_i, spec.period, "removed", spec.discretisation)
    A, B = np.split(model.discretise(model.jacobians(np.zeros((1, len(spec.Q)))))[0], [len(spec.Q)], axis=1)
    Q = np.array(spec.Q)
    Q[8:] *= spec.k_i > 0.0
    return sqrt_weight(riccati_terminal_weight(A, B, np.diag(Q), np.diag(spec.R)))


_NO_MATRICES = (None, None)
_CANCELLED = {"z": np.array([0.0, 0.0, 1.0, 0.0]), "all": np.ones(4)}
"""Factors on the estimated disturbances x y z yaw for each value of `offset_free`."""


def _as_input(model: Model, push: Array, yaw: Array) -> Array:
    """The inputs (n, 4) that give the acceleration push (4,), x y z (world) and yaw, at the headings yaw (n,)."""
    u = np.tile(push, (len(yaw), 1))
    u[:, :2] = rotate_to_body(push[:2], yaw)
    return u / np.array([model.b_x, model.b_y, model.b_z, model.b_yaw])
