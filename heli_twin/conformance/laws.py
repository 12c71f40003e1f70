"""Rules of control laws: finite inputs in time, the same again, plans that a log can hold; and of excitations."""

from typing import Any

import numpy as np

from controllers.flatness import state
from controllers.laws import StateReader, closed_after, extra_states, preview_of
from controllers.model import Model
from controllers.reference import ReferencePreview
from controllers.signals import NO_STATES, Array, Command, Estimate, Plan, Reference, nanoseconds
from controllers.trajectories.hover import Hover
from heli_twin.conformance.rules import require, same
from heli_twin.lab.plant import Air
from heli_twin.lab.plant.ideal import Ideal

MODEL = Model()


def _hover_steps(law: Any, count: int = 40) -> tuple[list[Array], list[tuple[Estimate, Reference]]]:
    """The commands of a law in a hover that it is pushed out of, and what it was given."""
    with closed_after(law.start()) as controller:
        return _steps_of(controller, law, count)


def _steps_of(controller: Any, law: Any, count: int) -> tuple[list[Array], list[tuple[Estimate, Reference]]]:
    period = nanoseconds(law.period)
    preview = preview_of(law, Hover(), period, 0)
    plant = Ideal(step=law.period).start(state(Hover().flat(np.zeros(1)))[0])
    # What the law reads beyond the physical states is at rest.
    reader: object = law
    further = np.zeros(len(reader.estimated_states)) if isinstance(reader, StateReader) else NO_STATES
    sent, given = [], []
    for k in range(count):
        now = k * period
        truth = plant.truth()
        c, s = np.cos(truth.yaw), np.sin(truth.yaw)
        vx, vy, vz = truth.velocity
        x = np.array([*truth.position, truth.yaw, c * vx + s * vy, c * vy - s * vx, vz, truth.yaw_rate])
        estimate = Estimate(now, x, np.zeros(4), np.full((4, 3), 1e-4), now, 0, further, 0.0 * further)
        reference = preview(now, law.steps)
        command = controller.explain(controller.step(now, estimate, reference))
        _is_a_plan_of(law, command.plan)
        sent.append(np.array(command.u))
        given.append((estimate, reference))
        plant.advance(now + period, np.clip(command.u, -1, 1), Air(np.zeros(3), np.array([0.3, -0.2, 0.1])))
    return sent, given


def _is_a_plan_of(law: Any, plan: Plan | None) -> None:
    """Refuse a plan that no log can hold."""
    if plan is None:
        return
    rows, width = plan.x.shape
    right = width in (8, 10) and plan.u.shape == plan.u_nominal.shape == (rows - 1, 4)
    require(right, f"a plan has states {plan.x.shape} and inputs {plan.u.shape}, not (N + 1, 8 or 10) and (N, 4)")
    found = 0 if plan.extra is None else plan.extra.shape[1]
    require(
        found == len(extra_states(law)), f"a plan has {found} further states, extra_states {len(extra_states(law))}"
    )


def says_its_period_and_model(law: Any) -> None:
    """It has a positive period, a whole number of steps, and a believed model."""
    require(0.0 < law.period <= 1.0, f"period = {law.period} s: it has to be above 0 and at most 1 s")
    require(
        isinstance(law.steps, int) and law.steps >= 1, f"steps = {law.steps}: it has to be a whole number from 1 on"
    )
    require(isinstance(law.model, Model), "model has to be a controllers.model.Model")


def sends_finite_inputs(law: Any) -> None:
    """Every command is four finite inputs within full stick, decided at the control time."""
    for u in _hover_steps(law)[0]:
        require(u.shape == (4,), f"a command has shape {u.shape}, not (4,)")
        require(np.isfinite(u).all(), f"a command is {u.tolist()}")
        require((np.abs(u) <= 1.0).all(), f"a command is {u.tolist()}: full stick is 1")


def is_deterministic(law: Any) -> None:
    """Two flights of one value are equal, and do not share a state."""
    first, second = _hover_steps(law)[0], _hover_steps(law)[0]
    require(same(first, second), "the same flight gave other commands: start() has to make a new controller")


def leaves_its_inputs_alone(law: Any) -> None:
    """It does not change the estimate and the reference that it is given."""
    period = nanoseconds(law.period)
    preview = ReferencePreview(Hover(), law.model, period, 0)
    for estimate, reference in _hover_steps(law, 3)[1]:
        fresh = preview(estimate.stamp, law.steps)
        require(
            np.array_equal(reference.x, fresh.x) and np.array_equal(reference.u, fresh.u), "the reference was changed"
        )


def excites_within_the_limits(spec: Any) -> None:
    """It adds the same finite inputs every time it is asked, and the sum keeps the limits of the inputs."""
    for k in range(200):
        command = Command(k * 20_000_000, np.array(MODEL.u_max))
        u, again = (np.asarray(spec.excited(command.stamp, command, MODEL).u) for _ in range(2))
        require(same([u], [again]), "the same moment gave another input")
        require(u.shape == (4,) and np.isfinite(u).all(), f"an input is {u.tolist()}")
        require((u >= MODEL.u_min).all() and (u <= MODEL.u_max).all(), f"an input is {u.tolist()}, beyond its limits")
