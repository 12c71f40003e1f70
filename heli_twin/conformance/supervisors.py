"""Rules of supervisors: an order at every step, whatever the poses do."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from controllers.model import Model
from controllers.reference import ReferencePreview
from controllers.signals import Array, Command, Estimate, Reference
from controllers.supervisors import PHASES, Order
from controllers.trajectories.hover import Hover
from heli_twin.conformance.rules import require, same

_MODEL = Model()
_PERIOD = 20_000_000


def _flight(spec: Any, seen_until: int, steps: int = 400) -> Iterator[tuple[str, Estimate | None, Reference, Any]]:
    """Phase, estimate, plan and order of each step of a hover whose poses end at a time, ns."""
    supervisor = spec.start(_MODEL, 1e-9 * _PERIOD)
    preview = ReferencePreview(Hover(), _MODEL, _PERIOD, 0)
    x = np.zeros(8)
    x[2] = 1.0
    for k in range(steps):
        now = k * _PERIOD
        stamp = min(now, seen_until)
        estimate = Estimate(now, x, np.zeros(4), np.full((4, 3), 1e-4), stamp, 0) if k and seen_until >= 0 else None
        plan = preview(now, 19)
        supervisor.battery(3.8)
        order = supervisor.order(now, estimate, plan)
        require(isinstance(order, Order), f"order() gives a {type(order).__name__}, not an Order")
        yield supervisor.phase, estimate, plan, order
        command = order.command or Command(now, np.array(_MODEL.u_hover))
        supervisor.sent(order.applied(command))


_CASES = {"poses": 1 << 62, "no poses after 2 s": 2_000_000_000, "no poses at all": -1}


def orders_what_can_be_flown(spec: Any) -> None:
    """With poses, without, and when they end, each order has a reference of the horizon or a command in full stick."""
    for case, seen_until in _CASES.items():
        for phase, estimate, plan, order in _flight(spec, seen_until):
            require(phase in PHASES, f"its phase is {phase!r}: use one of {', '.join(PHASES)}")
            if order.command is not None:
                u = np.asarray(order.command.u)
                whole = u.shape == (4,) and bool(np.isfinite(u).all()) and bool((np.abs(u) <= 1.0).all())
                require(whole, f"{case}: it sends {u.tolist()}, not four inputs in full stick")
            elif estimate is not None:
                require(order.reference is not None, f"{case}: it orders neither a reference nor a command")
            if order.reference is not None:
                _is_whole(order.reference, plan, case)
            if order.event is not None:
                require(order.event.phase in PHASES and order.event.reason, f"{case}: an event has no phase or reason")


def _is_whole(reference: Reference, plan: Reference, case: str) -> None:
    right = reference.x.shape == plan.x.shape and reference.u.shape == plan.u.shape and reference.stamp == plan.stamp
    require(right, f"{case}: its reference has another time or length than the plan")
    finite = bool(np.isfinite(reference.x).all() and np.isfinite(reference.u).all())
    require(finite, f"{case}: its reference is not finite")


def lets_a_good_flight_fly(spec: Any) -> None:
    """As long as poses come and control problems are solved, the plan is flown as it is."""
    for phase, estimate, plan, order in _flight(spec, _CASES["poses"]):
        if estimate is not None:
            require(phase == "flying", f"with all poses there it is {phase}")
            flown = order.reference is not None and np.array_equal(order.reference.x, plan.x) and order.command is None
            require(flown, "with all poses there it orders something else than the plan")


def orders_the_same_again(spec: Any) -> None:
    """Two flights of one value are equal, and do not share a state."""
    first, second = ([*_numbers(spec)] for _ in range(2))
    require(same(first, second), "the same flight got other orders: start() has to make a new supervisor")


def leaves_the_plan_alone(spec: Any) -> None:
    """It does not change the plan and the estimate that it is given."""
    preview = ReferencePreview(Hover(), _MODEL, _PERIOD, 0)
    for _, estimate, plan, _ in _flight(spec, _CASES["no poses after 2 s"]):
        fresh = preview(plan.stamp, 19)
        right = np.array_equal(plan.x, fresh.x) and np.array_equal(plan.u, fresh.u)
        right &= estimate is None or bool(estimate.x[2] == 1.0 and not estimate.x[3:].any())
        require(right, "it changes the plan or the estimate: copy them first")


def _numbers(spec: Any) -> Iterator[Array]:
    for phase, _, _, order in _flight(spec, _CASES["no poses after 2 s"]):
        u = np.full(4, np.nan) if order.command is None else np.asarray(order.command.u, float)
        x = np.zeros(0) if order.reference is None else order.reference.x[:, :8].ravel()
        yield np.concatenate([[PHASES.index(phase) if phase in PHASES else -1.0], u, x])
