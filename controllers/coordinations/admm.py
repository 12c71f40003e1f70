"""Consensus by ADMM, as in the paper's [18]: all plan at once, exchange their plans several times, and draw together.

Each helicopter i minimises its own cost f_i(x_i), the distance of its plan from its wish, with what all have to agree
on: two plans stay apart, and in a formation all plans leave their wishes by the same shift. In each round

    x_i <- argmin f_i(x_i) + rho / 2 sum_j |x_i - z_ij + u_ij|^2 + a / 2 |x_i - w_i - d + y_i|^2
    z_ij, z_ji <- the nearest two plans to x_i + u_ij and x_j + u_ji that are the distance apart
    d <- mean of x_i - w_i + y_i
    u_ij <- u_ij + x_i - z_ij,   y_i <- y_i + x_i - w_i - d

where x_i is a plan, w_i its wish, z_ij what the pair agrees on, and d the shift of the formation. Plans keep their
distance in the limit of many rounds only, and nothing is promised: a few more rounds are a few more centimetres. The
set of plans that are apart is not convex, so that there is no proof of convergence either.

Source: Summers and Lygeros, Distributed model predictive consensus via the alternating direction method of multipliers,
Allerton 2012, for the costs; the constraint between two is ours.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from time import perf_counter_ns
from typing import Annotated, Literal, NamedTuple

import numpy as np
from annotated_types import Ge, Gt, Le, Unit, doc

from controllers.coordinations import CommittedPlan, Message, Note, Ship
from controllers.emergency import lost_since, strayed
from controllers.plan_qp import Effort, PlanQp
from controllers.separation import knots_from
from controllers.signals import Array, Estimate, nanoseconds
from controllers.wish_plan import WishPlan

ALLOWANCE = 1.5
"""The wish may need this multiple of the limits on plans: it is flown as it is where nobody holds it."""
LEFT_SHARE = 0.5
"""Two pass on the left if they do so by this share of the distance already."""


@dataclass(frozen=True, slots=True)
class Admm:
    """All helicopters plan at once and agree in rounds of messages; nothing is promised.

    For formations, and to compare with `sequential`, which needs one message a turn and promises a distance.
    """

    kind: Literal["admm"] = "admm"
    distance: Annotated[float, Gt(0), Le(10), Unit("m"), doc("that plans keep in the limit of many rounds")] = 0.45
    least: Annotated[
        float, Ge(0), Le(10), Unit("m"), doc("a plan that comes nearer after the last round is refused")
    ] = 0.25
    period: Annotated[float, Ge(0.02), Le(1), Unit("s"), doc("between two plans")] = 0.1
    rounds: Annotated[int, Ge(1), Le(200), doc("exchanges of plans in each period")] = 5
    steps: Annotated[int, Ge(12), Le(60), doc("periods that a plan is long")] = 20
    speed: Annotated[float, Gt(0), Le(3), Unit("m/s"), doc("limit of plans, north and west")] = 1.0
    acceleration: Annotated[float, Gt(0), Le(2), Unit("m/s^2"), doc("limit of plans, north and west")] = 0.7
    penalty: Annotated[float, Gt(0), Le(1000), Unit("1"), doc("rho: of the distance from what pairs agree on")] = 20.0
    together: Annotated[float, Ge(0), Le(1000), Unit("1"), doc("a: all leave their wishes by one shift; 0: no")] = 0.0

    def planner_of(self, ship: str, ships: Sequence[Ship]) -> "AdmmPlanner":
        """Return the planner of one helicopter."""
        return AdmmPlanner(self, ship, ships)


class Iterate(NamedTuple):
    """Broadcast of one planner in one round of ADMM: its plan and its scaled dual shift."""

    period: int
    """Number of the period, from 0."""
    round: int
    x: Array
    """(N, 2) planned positions at the knots after the first, world x y, m."""
    shift: Array
    """(N, 2) plan minus wish plus scaled dual variable, x - w + y, world x y, m."""
    is_down: bool
    """True while the supervisor flies the helicopter in place of its plan."""


class AdmmPlanner:
    """The planner of one helicopter."""

    def __init__(self, spec: Admm, ship: str, ships: Sequence[Ship]) -> None:
        self._spec, self._name = spec, ship
        self._step = nanoseconds(spec.period)
        plans = {each.name: WishPlan(each.wish, spec.period, spec.steps) for each in ships}
        self._own = plans[ship]
        count = self._own.longest + 2
        starts = {name: CommittedPlan(0, self._step, plan.wished(0, count)) for name, plan in plans.items()}
        self.committed = starts.pop(ship)
        zero = np.zeros((spec.steps, 2))
        self._others = {
            name: Iterate(-1, 0, knots_from(plan, 1, spec.steps)[:, 0, :2], zero, False)
            for name, plan in starts.items()
        }
        # Duals of each pair, the own one and the other's, and that of the formation.
        self._u = {name: np.zeros((2, spec.steps, 2)) for name in starts}
        self._y = zero
        self._x = knots_from(self.committed, 1, spec.steps)[:, 0, :2]
        self._wished, self._may_wish = self.committed.knots, False
        """Knots of the way to the wish and a stop, in this period, and whether they may be flown."""
        self._knots: Array | None = None
        """(N + 1, 3, 4) of the newest iterate."""
        self._plane = PlanQp(spec.steps, spec.period, 2, Effort(spec.speed, spec.acceleration))
        self._height = PlanQp(spec.steps, spec.period, 1, Effort(0.5, 1.0))
        self._heading = PlanQp(spec.steps, spec.period, 1, Effort(2.0, 6.0))
        self._period, self._round, self.due, self.note = 0, 0, 0, Note("kept")
        self._iterations, self._took, self._is_down = 0, 0, False

    def receive(self, now: int, message: Message) -> None:
        """Keep what is newer than what was heard before."""
        told: Iterate = message.body
        before = self._others.get(message.sender)
        if before is not None and (told.period, told.round) > (before.period, before.round):
            self._others[message.sender] = told

    def act(self, now: int, estimate: Estimate | None, is_flying: bool) -> Sequence[Message]:
        """Take part in a round, or commit after the last one."""
        spec, first = self._spec, self._period + 1
        old = knots_from(self.committed, first - 1, self._own.longest + 2)
        self._is_down = not is_flying
        if self._round == 0:
            self._shift(first, old)
        if self._round < spec.rounds:
            if is_flying:
                self._iterate(first, old)
            else:
                is_seen = lost_since(now, estimate) == np.inf
                state = strayed(self.committed, estimate) if is_seen else None
                self._knots = self._own.stop(old[1] if state is None else state, spec.acceleration)[: spec.steps + 1]
                self._x = self._knots[1:, 0, :2]
            shift = self._x - self._wish(first)[:, :2] + self._y
            body = Iterate(self._period, self._round, self._x, shift, not is_flying)
            self._next_turn()
            return [Message(self._name, now, body, 4 * 2 * body.x.size + 16)]
        self._commit(first, old)
        self._next_turn()
        return ()

    def _next_turn(self) -> None:
        self._round = (self._round + 1) % (self._spec.rounds + 1)
        self._period += self._round == 0
        self.due = self._period * self._step + self._round * self._step // (self._spec.rounds + 1)

    def _shift(self, first: int, old: Array) -> None:
        """Begin a period: all that was agreed on moves on by a step."""
        self._wished = self._own.towards_the_wish(old[1:], first)[1]
        most = ALLOWANCE * np.array([self._spec.speed, self._spec.acceleration])
        self._may_wish = not self._spec.together and bool((np.abs(self._wished[:, 1:, :2]) <= most[:, None]).all())
        self._u = {name: _moved_on(u, 1) for name, u in self._u.items()}
        self._y, self._x = _moved_on(self._y, 1), _moved_on(self._x, 1)
        self._iterations = self._took = 0

    def _wish(self, first: int) -> Array:
        return self._own.wish.flat(self._own.h * (first + np.arange(1, self._spec.steps + 1, dtype=np.float64))).z

    def _iterate(self, first: int, old: Array) -> None:
        """Update what is agreed on with the newest plans of all, then the own plan."""
        spec, wish = self._spec, self._wish(first)
        weights, pull = np.ones(spec.steps), wish[:, :2].copy()
        shifts = [self._x - wish[:, :2] + self._y]
        for name, other in self._others.items():
            late = self._period - other.period
            there = _moved_on(other.x, late)
            shifts.append(_moved_on(other.shift, late))
            u = self._u[name]
            agreed = apart(self._x + u[0], there + u[1], spec.distance, other.is_down)
            # Where nothing holds them, the two agree on what each plans.
            held = np.abs(agreed[0] - self._x - u[0]).max(axis=1) > 0.0
            self._u[name] = np.where(held[:, None], u + np.stack([self._x, there]) - agreed, 0.0)
            weights += 0.5 * spec.penalty * held
            pull += 0.5 * spec.penalty * held[:, None] * (agreed[0] - self._u[name][0])
        if spec.together:
            mean = np.mean(shifts, axis=0)
            self._y = self._y + self._x - wish[:, :2] - mean
            weights += 0.5 * spec.together
            pull += 0.5 * spec.together * (wish[:, :2] + mean - self._y)
        if self._may_wish and weights.max() == 1.0:
            self._knots, self._x = self._wished, self._wished[1 : spec.steps + 1, 0, :2]
            return
        began = perf_counter_ns()
        knots = old[1 : spec.steps + 2].copy()
        plane = self._plane(knots[:, :, :2], pull / weights[:, None], weights=weights)
        self._iterations += self._plane.iterations
        self._took += perf_counter_ns() - began
        if plane is not None:
            knots[:, :, :2] = plane
            self._knots, self._x = knots, plane[1:, 0]

    def _commit(self, first: int, old: Array) -> None:
        """Commit the newest iterate; keep the old plan if that comes too near."""
        spec, knots = self._spec, self._knots
        others = [_moved_on(each.x, self._period - each.period) for each in self._others.values()]
        least, before = (
            min((float(np.hypot(*(x - other).T).min()) for other in others), default=np.inf)
            for x in (self._x, old[2 : spec.steps + 2, 0, :2])
        )
        if knots is None or (least < min(spec.least, before) and not self._is_down):
            reason = "no solution" if knots is None else f"{least:.2f} m from another"
            self.note = Note("refused", reason, False, self._iterations, self._took)
            return
        if knots is not self._wished and not self._is_down:
            knots = self._with_height(knots, old, self._wish(first))
        whole = self._own.whole(old[0], knots)
        if not np.array_equal(whole, old):
            self.committed = CommittedPlan((first - 1) * self._step, self._step, whole)
        reason = "" if knots is self._wished else "planned"
        self.note = Note("committed", reason, False, self._iterations, self._took)

    def _with_height(self, knots: Array, old: Array, wish: Array) -> Array:
        """Put height and heading of plans that follow the wish into knots (N + 1, 3, 4)."""
        knots, old = knots.copy(), old[1 : self._spec.steps + 2]
        for axis, qp in ((2, self._height), (3, self._heading)):
            planned = qp(old[:, :, axis : axis + 1], wish[:, axis : axis + 1])
            knots[:, :, axis : axis + 1] = old[:, :, axis : axis + 1] if planned is None else planned
        return knots


def apart(one: Array, other: Array, distance: float, is_fixed: bool) -> Array:
    """Return the nearest two paths (2, n, 2) to two paths (n, 2) that pass each other at a distance.

    They are pushed apart across the direction in which they pass, all the way to one side: on the right, unless they
    clearly pass on the left already. Pushed apart straight, two that meet head-on would pass through each other. Two
    that hardly move are pushed apart straight.

    Args:
        one: Own path, m.
        other: The other's, m.
        distance: To keep, m.
        is_fixed: The other does not move: the own path moves all the way.
    """
    there = one - other
    way = there[-1] - there[0]
    length = float(np.hypot(*way))
    if length > 0.5 * distance:
        along = way / length
        right = np.array([along[1], -along[0]])
        ahead, sideways = there @ along, there @ right
        side = 1.0 if sideways[np.abs(ahead).argmin()] > -LEFT_SHARE * distance else -1.0
        needed = np.sqrt(np.maximum(distance**2 - ahead**2, 0.0))
        push = np.maximum(needed - side * sideways, 0.0)[:, None] * side * right
    else:
        apart = np.maximum(np.hypot(*there.T), 1e-9)[:, None]
        push = np.maximum(distance / apart - 1.0, 0.0) * there
    share = 1.0 if is_fixed else 0.5
    return np.stack([one + share * push, other - (1.0 - share) * push])


def _moved_on(values: Array, steps: int) -> Array:
    """Return values (..., n, 2) some steps later; the last one stays."""
    n = values.shape[-2]
    return values.take([min(max(i + steps, 0), n - 1) for i in range(n)], axis=-2)
