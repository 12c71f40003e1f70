"""Members that use the wide contracts: derivatives, named states, every wire, a moment, other helicopters."""

from dataclasses import dataclass, field, replace
from typing import Annotated, Literal

import numpy as np
from annotated_types import Gt, Unit, doc

from controllers.estimators import Estimator
from controllers.estimators.kalman import Kalman
from controllers.laws.pid import Pid
from controllers.model import Model
from controllers.signals import Command, Estimate, NamedState, Plan, Pose, Reference
from heli_twin.lab.faults import Hooks
from heli_twin.lab.plant import Air, Battery, Truth
from heli_twin.lab.radio import Held


class Reader:
    """A PID that plans the tilt which the reference asks for."""

    def __init__(self, law: "DerivativeLaw") -> None:
        self.pid, self.plan = replace(Pid(), period=law.period).start(), None

    def step(self, now: int, estimate: Estimate, reference: Reference) -> Command:
        """The PID's command; the plan is the reference, its tilt and its tilt rate."""
        assert reference.flat is not None
        tilt = np.concatenate([reference.flat[2, :, :2], reference.flat[3, :, :2]], axis=1) / 9.81
        self.plan = Plan(reference.x, reference.u, reference.u, tilt)
        return self.pid.step(now, estimate, reference)

    def explain(self, command: Command) -> Command:
        """Add the plan."""
        return command._replace(plan=self.plan)


@dataclass(frozen=True, slots=True)
class DerivativeLaw:
    """A law that reads derivatives up to the fourth."""

    kind: Literal["derivative_law"] = "derivative_law"
    period: Annotated[float, Gt(0), Unit("s"), doc("control period")] = 0.02
    model: Annotated[Model, doc("the helicopter as the law believes it to be")] = field(default_factory=Model)
    flat_derivatives = 4
    extra_states = (("tilt_x", "rad"), ("tilt_y", "rad"), ("rate_x", "rad/s"), ("rate_y", "rad/s"))

    @property
    def steps(self) -> int:
        """How far it looks ahead."""
        return 5

    def start(self) -> Reader:
        """For one flight."""
        return Reader(self)


class TiltFilter:
    """The Kalman filter, and the tilt of the newest pose."""

    def __init__(self, inner: Estimator) -> None:
        self.inner, self.tilt = inner, np.zeros(2)

    def receive(self, now: int, pose: Pose) -> None:
        """Use a pose."""
        _, x, y, _ = pose.quat_wxyz
        self.tilt = np.array([2.0 * x, 2.0 * y])
        self.inner.receive(now, pose)

    def command_sent(self, now: int, u: np.ndarray) -> None:
        """Take note of the command."""
        self.inner.command_sent(now, u)

    def estimate(self, now: int) -> Estimate | None:
        """The estimate with its further states."""
        estimate = self.inner.estimate(now)
        return estimate._replace(extra=self.tilt, extra_variance=np.full(2, 1e-4)) if estimate else None


@dataclass(frozen=True, slots=True)
class Tilted:
    """An estimator with two further states."""

    kind: Literal["tilted"] = "tilted"
    extra_states = (NamedState("roll", "rad"), NamedState("pitch", "rad"))

    @property
    def lead(self) -> float:
        """That of the Kalman filter."""
        return Kalman().lead

    def start(self, model: Model) -> TiltFilter:
        """For one flight."""
        return TiltFilter(Kalman().start(model))


@dataclass(frozen=True, slots=True)
class Everywhere:
    """A fault on the wires that no fault of heli_twin hooks."""

    kind: Literal["everywhere"] = "everywhere"

    def hooks(self, rng: np.random.Generator) -> Hooks:
        """An estimate 1 cm too high, a receiver that turns commands down, and a battery that tells 1 V less."""

        def estimate(t: int, estimate: Estimate) -> Estimate:
            return estimate._replace(x=estimate.x + np.array([0, 0, 0.01, 0, 0, 0, 0, 0]))

        def received(t: int, held: Held) -> Held | None:
            return None if t > 1_500_000_000 else held._replace(u=0.99 * held.u)

        def battery(t: int, battery: Battery) -> Battery:
            return battery._replace(voltage=battery.voltage - 1.0)

        return Hooks(estimate=estimate, received=received, battery=battery)


@dataclass(frozen=True, slots=True)
class Whirl:
    """A yaw moment, and the downwash of other helicopters."""

    kind: Literal["whirl"] = "whirl"
    moment: Annotated[float, Unit("N m"), doc("about the mast")] = 1e-5

    def start(self, rng: np.random.Generator) -> "Whirl":
        """It needs no chance."""
        return self

    def air(self, truth: Truth, others: np.ndarray) -> Air:
        """Air that sinks below others."""
        above = (others[:, 2] > truth.position[2]) & (np.abs(others[:, :2] - truth.position[:2]).max(axis=1) < 0.3)
        return Air(np.array([0.0, 0.0, -0.5 * above.sum()]), np.zeros(3), 1.0, np.array([0.0, 0.0, self.moment]))
