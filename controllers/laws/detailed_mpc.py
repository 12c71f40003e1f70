"""LTV-MPC with the detailed model: attitude, servos, lags and gusts are in the plan."""

from dataclasses import dataclass, field
from functools import lru_cache
from math import cos, sin
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt, Le, Unit, doc

from controllers.condensed_qp import Cost, StepByStep, Weights, riccati_terminal_weight, sqrt_weight
from controllers.detailed_flatness import HIGHEST_DERIVATIVE, prepared_reference
from controllers.detailed_ltv import HEIGHT_AND_YAW, PLANE, DetailedLinearisation, Disturbances
from controllers.detailed_model import ESTIMATED_STATES, EXTRA_STATES, N_DETAILED, DetailedModel
from controllers.ltv import Ltv
from controllers.receding import RecedingHorizon, off_reference
from controllers.servo_play import ServoPlay
from controllers.signals import Array, Command, Estimate, NamedState, Reference

Weight = Annotated[float, Ge(0)]
InputWeight = Annotated[float, Gt(0)]


@dataclass(frozen=True, slots=True)
class DetailedMpc:
    """The paper's LTV-MPC with a model of tilt, servos, lags and gusts, which the paper calls for as future work.

    It solves the same (26). Instead of integral states, the estimated push and trim are part of the reference, and the
    estimated gust is part of the prediction. Its terminal weight is the Riccati cost-to-go, gusts included. The states
    that it needs come from `estimator.kind = "detailed_kalman"`.

    The weights of pitch and roll inputs are 0.014 of those of position: smaller ones err less on the nominal helicopter
    and come near a limit cycle when its attitude is faster or slower than believed, from 10 to 18 rad/s.
    """

    kind: Literal["detailed_mpc"] = "detailed_mpc"
    period: Annotated[float, Ge(0.001), Le(0.2), Unit("s"), doc("control period T_s")] = 0.02
    horizon: Annotated[int, Ge(1), Le(60), doc("p of (26): p + 1 inputs, p + 2 states")] = 18
    Q: Annotated[
        tuple[Weight, Weight, Weight, Weight, Weight, Weight, Weight, Weight],
        doc("state weights: x y z yaw, vx vy vz yaw rate"),
    ] = (50.0, 50.0, 5.0, 10.0, 0.0, 0.0, 0.0, 2.0)
    R: Annotated[
        tuple[InputWeight, InputWeight, InputWeight, InputWeight], doc("input weights: pitch, roll, thrust, yaw")
    ] = (0.7, 0.7, 1.0, 2.0)
    model: Annotated[DetailedModel, doc("the helicopter as the controller believes it")] = field(
        default_factory=DetailedModel
    )

    def __post_init__(self) -> None:
        """Refuse weights without a terminal weight.

        Raises:
            ValueError: The Riccati equation has no solution in double precision.
        """
        try:
            _terminal(self)
        except (ValueError, np.linalg.LinAlgError) as error:
            raise ValueError(
                f"there is no terminal weight for these Q and R: {error}; choose them nearer to their defaults"
            ) from None

    @property
    def steps(self) -> int:
        """Number of inputs in the horizon."""
        return self.horizon + 1

    @property
    def flat_derivatives(self) -> int:
        """Highest derivative of the flat outputs that it reads."""
        return HIGHEST_DERIVATIVE

    def prepare(self, flat: Array) -> Array:
        """Return what its control steps need of flat outputs (6, k, 4): (k, 20, 3)."""
        return prepared_reference(self.model).prepare(flat)

    @property
    def estimated_states(self) -> tuple[NamedState, ...]:
        """The further states that it reads from estimates."""
        return ESTIMATED_STATES

    @property
    def extra_states(self) -> tuple[NamedState, ...]:
        """The states of its plan beyond the eight physical ones."""
        return EXTRA_STATES

    def hover(self) -> Ltv:
        """Return the linear model over one horizon in hover."""
        at_rest = Disturbances(np.zeros(2), np.zeros(2), np.zeros(4))
        inputs = np.tile(self.model.u_hover, (self.steps, 1))
        return DetailedLinearisation(self.model, self.period, self.steps)(np.zeros(N_DETAILED), inputs, at_rest)

    def start(self) -> "DetailedMpcController":
        """Return a controller for one flight."""
        return DetailedMpcController(self)


class DetailedMpcController(RecedingHorizon):
    """The MPC of one flight, with its last plan."""

    def __init__(self, spec: DetailedMpc) -> None:
        self._reference = prepared_reference(spec.model)
        self._play = ServoPlay(spec.model.servo_play) if spec.model.servo_play else None
        self._linearise = DetailedLinearisation(spec.model, spec.period, spec.steps)
        hover = spec.hover()
        Qf, self._gust_target = _terminal(spec)
        sqrt_Q = np.zeros(N_DETAILED)
        sqrt_Q[:8] = np.sqrt(spec.Q)
        weights = Weights(sqrt_Q, np.array(spec.R), Qf)
        self._plane = StepByStep(spec.steps, PLANE, weights.of(PLANE), flies=True)
        super().__init__(spec, (PLANE, HEIGHT_AND_YAW), weights, hover, self._plane)
        self._decay = self._linearise.gust_decay**spec.steps

    def step(self, now: int, estimate: Estimate, reference: Reference) -> Command:
        """Send the first input of the plan, ahead of it where the swashplate's play has to be crossed."""
        command = super().step(now, estimate, reference)
        if self._play is None:
            return command
        sent = self._play.ahead(command.u)
        return command._replace(u=np.minimum(np.maximum(sent, self._limits.u_min), self._limits.u_max))

    def _samples(self, reference: Reference) -> Array:
        if reference.prepared is not None:
            return reference.prepared
        assert reference.flat is not None
        return self._reference.prepare(reference.flat)

    def costs(self, estimate: Estimate, reference: Reference) -> tuple[Ltv, list[Cost]]:
        """Linearise along the nominal inputs and condense (26): one cost for each subsystem."""
        extra = estimate.extra
        gust = extra[8:10]
        push = estimate.disturbance.copy()
        push[:2] -= gust
        acting = Disturbances(gust, extra[10:12], push)
        x_ref, u_ref = self._reference.against(self._samples(reference), acting)
        u_nominal = self.nominal(u_ref)
        ltv = self._linearise(np.concatenate([estimate.x, extra[:8]]), u_nominal, acting, self._plane.fly)
        off, yaw = off_reference(ltv, x_ref, u_ref), float(ltv.x_nominal[-1, 3])
        # The terminal weight holds at yaw = 0: positions are turned into the body frame at the end of the horizon.
        c, s = cos(yaw), sin(yaw)
        turned = np.array([[c, s], [-s, c]])
        of_gust = self._gust_target @ (turned @ (self._decay * gust))
        of_gust[:2] = of_gust[:2] @ turned
        off[-1, PLANE.states] += of_gust
        root = self._problems[0].weights.sqrt_Qf.copy()
        root[:, :2] = root[:, :2] @ turned
        return ltv, self.condensed(ltv, off, (root, None))


@lru_cache(8)
def _terminal(spec: DetailedMpc) -> tuple[Array, Array]:
    """Root of the terminal weight (16, 16) at yaw = 0, and the error (10, 2) of the plane that a gust amounts to.

    Cached: a law is checked with it before every flight. The cost-to-go of the plane with gusts g is
    x'Px + 2 x'Pg g + ...: the same as of an error x + inv(P) Pg g.
    """
    root, Q, hover = np.zeros((N_DETAILED, N_DETAILED)), np.zeros(N_DETAILED), spec.hover()
    Q[:8] = spec.Q
    linearise = DetailedLinearisation(spec.model, spec.period, spec.steps)
    A, B = _with_gust(hover, linearise)
    weight = np.zeros((12, 12))
    weight[:10, :10] = np.diag(Q[PLANE.states])
    P = riccati_terminal_weight(A, B, weight, np.diag(spec.R[:2]))
    root[np.ix_(PLANE.states, PLANE.states)] = sqrt_weight(P[:10, :10])
    _, low_AB = hover.parts
    assert low_AB is not None
    AB, n = low_AB[0], len(HEIGHT_AND_YAW.states)
    low = riccati_terminal_weight(AB[:, :n], AB[:, n:], np.diag(Q[HEIGHT_AND_YAW.states]), np.diag(spec.R[2:]))
    root[np.ix_(HEIGHT_AND_YAW.states, HEIGHT_AND_YAW.states)] = sqrt_weight(low)
    of_gust = np.asarray(np.linalg.solve(P[:10, :10], P[:10, 10:]), np.float64)
    for shared in (root, of_gust):
        shared.setflags(write=False)
    return root, of_gust


def _with_gust(hover: Ltv, linearise: DetailedLinearisation) -> tuple[Array, Array]:
    """The plane's matrices (12, 12) and (12, 2) at yaw = 0 with the gust x y as two more states."""
    plane, _ = hover.parts
    assert plane is not None
    AB = plane[0]
    A, B = np.zeros((12, 12)), np.zeros((12, 2))
    A[:10, :10], B[:10] = AB[:, :10], AB[:, 10:]
    A[:10, 10:] = linearise.gust_response
    A[10, 10] = A[11, 11] = linearise.gust_decay
    return A, B
