"""Sequential distributed planning: each in turn plans a few seconds ahead, around the newest plans of all others.

**Never nearer than promised.** Turns are at times that all know, one at a time. A planner commits a new plan only if it
stays at the promised distance, also between the knots, from the plan of every other that it has heard the newest turn
of. Of one whose newest turns it has not heard, the new plan stays clear of wherever new plans of these turns can lead.
So all plans are clear of each other after each turn if they were before it. Each ends at rest: an old plan, flown to
its end, stays clear of all others for ever, and so a planner can always keep it. Messages that are lost or late cost
time, never distance. It needs one clock, and helicopters that fly their plans: the promised distance is that of two
that touch, and twice the error of the flight.

**Nobody waits for ever, where there is room.** Planned around each other, helicopters stand still when each is in the
way of the next. So those that move pass each other on the right. One that has stood for a while where it does not want
to be, or has come no nearer, asks, and heads straight on. Who is near ahead of it, and has not asked before it, steps
aside to the side where it stands, until the other has passed; if it stands itself while it steps aside, it asks in turn
for the other. Of all that ask, the one that asked first (of several, the first by name) never steps aside, so that
those ahead of it do, and those behind them, as far as there is room: it moves on and arrives. Its right lasts until
then, and who asks later comes later, so that each is the first one day. One that has arrived asks no more and gives way
to all; sent away, it asks anew, after all others. There is no proof for a room so full that nobody can step aside.

**Who cannot go on stops on its plan.** Its cameras have lost it, or its supervisor lands it. It commits to a short way
to rest that is clear of all others; there is always one, its old plan. So nobody has to get out of its way, and the
promise stays. Its supervisor stops and lands it along this plan: where a reference jumps, a blind helicopter brakes as
hard as it can, which its model tells badly, and leaves the plan. Unseen, it is still pushed off its plan: by at most
drift t^2 / 2, where t is the age of its newest picture, which it tells, and drift the acceleration of the strongest
gust. So others keep this much further from its plan, up to `berth`, and those that are nearer already move away. It is
on the floor, at the latest, when `berth` has been used up twice.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from time import perf_counter_ns
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt, Le, Unit, doc

from controllers.coordinations import CommittedPlan, Message, Note, Outcome, Ship
from controllers.emergency import STOPS, berth_of, lost_since, strayed
from controllers.escape import Escape, Haste
from controllers.plan_qp import Effort, PlanQp
from controllers.right_of_way import UNHEARD, Manners, RightOfWay, Told
from controllers.scene import NEAR_M, Mask, Scene
from controllers.separation import FINE, bend_of, distances, fine_path, knots_from, reach
from controllers.signals import Array, Estimate, nanoseconds
from controllers.take_off import before_take_off
from controllers.turns import Turns
from controllers.wish_plan import WishPlan

ALLOWANCE = 1.5
"""The wish may need this multiple of the limits on plans: it is flown as it is where it is clear."""
PUSHES = (0.5, 0.15, 0.0)
"""Shares of the acceleration of plans at which to move away from one that cannot go on, tried in this order."""


@dataclass(frozen=True, slots=True)
class Sequential:
    """Each helicopter in turn plans around the newest plans of all others, and flies its own trajectory where clear.

    The promised distance is that of the plans: with `controller.terminal = riccati` the helicopters of the lab then
    keep 0.3 m, and rotors touch at 0.19 m. Speed and acceleration are half of what the helicopter can do.
    """

    kind: Literal["sequential"] = "sequential"
    distance: Annotated[float, Gt(0), Le(10), Unit("m"), doc("promised between any two plans, in the plane")] = 0.4
    period: Annotated[float, Ge(0.02), Le(1), Unit("s"), doc("between two turns of a helicopter")] = 0.1
    hearing: Annotated[
        float, Ge(0), Le(10), Unit("s"), doc("least time between two turns, for messages to arrive; it can slow turns")
    ] = 0.002
    steps: Annotated[int, Ge(12), Le(60), doc("periods that a plan is long")] = 20
    speed: Annotated[float, Gt(0), Le(3), Unit("m/s"), doc("limit of plans, north and west")] = 1.0
    acceleration: Annotated[float, Gt(0), Le(2), Unit("m/s^2"), doc("limit of plans, north and west")] = 1.0
    haste: Annotated[
        float, Ge(1), Le(3), Unit("1"), doc("multiple of this acceleration that one in danger may need")
    ] = 1.4
    stop: Annotated[
        float, Ge(0.5), Le(3), Unit("1"), doc("multiple of this acceleration at which one stops that cannot go on")
    ] = 1.0
    turn: Annotated[float, Ge(0), Le(1), Unit("rad"), doc("how far half-spaces are turned, so that all pass right")] = (
        0.2
    )
    ahead: Annotated[
        float, Ge(0), Le(1), Unit("1"), doc("whose plan leads on less than this share of its next metre turns right")
    ] = 0.25
    patience: Annotated[float, Gt(0), Le(60), Unit("s"), doc("standing this long, others are asked to step aside")] = (
        0.4
    )
    aside: Annotated[float, Ge(0), Le(10), Unit("m"), doc("who is nearer than the distance and this, steps aside")] = (
        0.25
    )
    berth: Annotated[float, Ge(0), Le(10), Unit("m"), doc("further distance from one that lands in an emergency")] = 0.2
    drift: Annotated[
        float, Ge(0), Le(10), Unit("m/s^2"), doc("acceleration of a gust, which moves one that its cameras have lost")
    ] = 0.25
    half_width: Annotated[float, Gt(0), Unit("m"), doc("nobody steps aside further than this, north and west")] = 2.0
    copies: Annotated[int, Ge(1), Le(20), doc("how often each message is sent")] = 3
    gossip: Annotated[Literal["on", "off"], doc("messages pass on the newest plans of others too")] = "on"

    def between_turns(self, ships: int) -> float:
        """Return the time between the turns of two of so many helicopters, s: later messages hold all of them up."""
        return max(self.period / ships, self.hearing)

    def planner_of(self, ship: str, ships: Sequence[Ship]) -> "SequentialPlanner":
        """Return the planner of one helicopter.

        Raises:
            ValueError: Two start nearer to each other than the promised distance.
        """
        return SequentialPlanner(self, ship, ships)


class SequentialPlanner:
    """The planner of one helicopter."""

    def __init__(self, spec: Sequential, ship: str, ships: Sequence[Ship]) -> None:
        self._spec, self._name, self._names = spec, ship, [each.name for each in ships]
        self._index = self._names.index(ship)
        self._step = nanoseconds(spec.period)
        self._turns = Turns(max(self._step, nanoseconds(spec.hearing) * len(ships)), self._step, len(ships))
        self._bend = bend_of(ALLOWANCE * spec.acceleration, spec.period)
        self._plane = PlanQp(spec.steps, spec.period, 2, Effort(spec.speed, spec.acceleration))
        self._height = PlanQp(spec.steps, spec.period, 1, Effort(0.5, 1.0))
        self._heading = PlanQp(spec.steps, spec.period, 1, Effort(2.0, 6.0))
        manners = Manners(spec.period, spec.patience, spec.distance, spec.aside, spec.half_width, spec.ahead)
        self._way = RightOfWay(ship, manners)
        wishes = {each.name: WishPlan(each.wish, spec.period, spec.steps) for each in ships}
        self._own = wishes[ship]
        self._escape = Escape(self._own, Haste(spec.speed, spec.acceleration, spec.haste, spec.stop, spec.turn))
        first = before_take_off(wishes, self._step, spec.distance, self._bend)
        self.committed = first.pop(ship)
        self._heard = {name: Told(-1, plan, (0.0, 0.0), -1, name, False) for name, plan in first.items()}
        self._turn, self.due, self.note = 0, self._turns.time(self._index, 0), Note("kept")

    def receive(self, now: int, message: Message) -> None:
        """Keep what is newer than what was heard before."""
        body: Mapping[str, Told] = message.body
        for name, told in body.items():
            if name in self._heard and told.turn > self._heard[name].turn:
                self._heard[name] = told

    def act(self, now: int, estimate: Estimate | None, is_flying: bool) -> Sequence[Message]:
        """Plan, commit, and tell the others."""
        lost = lost_since(now, estimate)
        told = Told(self._turn, self.committed, (0.0, 0.0), -1, self._name, not is_flying, lost)
        if is_flying and lost == np.inf:
            told = self._fly(told)
        else:
            self._stop(None if is_flying or lost < np.inf else strayed(self.committed, estimate))
        self._turn += 1
        self.due = self._turns.time(self._index, self._turn)
        body = {self._name: told._replace(plan=self.committed)} | (self._heard if self._spec.gossip == "on" else {})
        return [Message(self._name, now, body, sum(each.size for each in body.values()))] * self._spec.copies

    def _commit(self, scene: Scene, knots: Array) -> None:
        self.committed = CommittedPlan((scene.first - 1) * self._step, self._step, knots)

    def _scene(self, push: float) -> Scene:
        spec, L, h = self._spec, self._own.longest, self._spec.period
        g = self._turns.departs(self._index, self._turn)
        names = [name for name in self._names if name != self._name]
        heard = [self._heard[name] for name in names]
        knots = np.array([knots_from(told.plan, g - 1, L + 2)[:, :, :2] for told in heard]).reshape(-1, L + 2, 3, 2)
        paths, old = fine_path(knots, h), knots_from(self.committed, g - 1, L + 2)
        wide = np.full((len(names), paths.shape[1] - 1), spec.distance)
        in_danger, pressed, unheard = np.zeros(len(names), bool), np.zeros(len(names), bool), list[str]()
        # Of each chord, from the start of the grid on, and where plans can be new.
        ends = (g - 1 + np.arange(1, wide.shape[1] + 1) / FINE) * h
        since = np.maximum(ends - (g + 1 / FINE) * h, 0.0)
        for j, (name, told) in enumerate(zip(names, heard, strict=True)):
            further = berth_of(told, ends, spec.berth, spec.drift)
            if further.any():
                kept = distances(fine_path(old, h), paths[j : j + 1], self._bend)[0]
                in_danger[j] = kept.min() < spec.distance
                pressed[j] = not in_danger[j] and bool((kept < wide[j] + further).any())
                if not in_danger[j]:
                    # Who is too near already moves away.
                    wide[j] = np.minimum(wide[j] + further, kept + 0.5 * push * since**2 - 1e-9)
            index = self._names.index(name)
            newest = self._turn if index < self._index else self._turn - 1
            if told.turn < newest:
                unheard.append(name)
                parts, rests = (self._turns.departs(index, turn) for turn in (told.turn + 1, newest))
                wide[j] += reach(ends - h * parts, h * (rests + L - parts), spec.haste * spec.acceleration)
        return Scene(g, h, self._bend, old, names, knots[:, :, 0], paths, wide, in_danger, pressed, push, unheard)

    def _fly(self, told: Told) -> Told:
        """Commit a new plan if there is a clear one; return what to tell: where it wants to be, and whether it asks."""
        turn, began, scene = told.turn, perf_counter_ns(), self._scene(PUSHES[0] * self._spec.acceleration)
        target = self._own.wish.flat(scene.h * (scene.first + np.arange(1, self._spec.steps + 1, dtype=np.float64))).z
        home = target[-1, :2].copy()
        asked = self._way.aside(turn, scene, self._heard)
        if asked:
            target[:, :2] = asked.place
        goal = target[-1, :2].copy()
        is_stuck = self._way.stands(turn, scene, goal, home, self.note.reason)
        if scene.in_danger.any():
            outcome, reason, iterations = self._save(scene)
        else:
            outcome, reason, iterations = self._choose(scene, target.copy(), not asked)
            for push in PUSHES[1:] if scene.pressed.any() else ():
                if outcome != "committed":
                    outcome, reason, more = self._choose(
                        self._scene(push * self._spec.acceleration), target.copy(), not asked
                    )
                    iterations += more
        self.note = Note(outcome, reason, is_stuck, iterations, perf_counter_ns() - began if iterations else 0)
        asks = self._way.asks(turn, scene, goal)
        since, asker = asked.rank if asked else (self._way.since, self._name)
        return told._replace(goal=(float(goal[0]), float(goal[1])), since=since if asks else -1, asker=asker)

    def _stop(self, state: Array | None) -> None:
        """Commit a way to rest: of one that is not on its plan, from its state (3, 4); else one that is clear."""
        scene, spec = self._scene(0.0), self._spec
        if state is not None:
            self._commit(scene, self._own.stop(state, spec.acceleration))
            self.note = Note("committed", "stays where its supervisor has taken it")
            return
        if self.note.reason == STOPS:
            self.note = Note("kept", STOPS)
            return
        knots, iterations = self._escape.to_rest(scene)
        if knots is None:
            self.note = Note("kept", "no room to stop")
            return
        self._commit(scene, knots)
        self.note = Note("committed", STOPS, False, iterations)

    def _choose(self, scene: Scene, target: Array, is_free: bool) -> tuple[Outcome, str, int]:
        """Commit the first candidate that is clear; return the outcome, its reason and ProxQP's iterations."""
        outcome: Outcome = "refused"
        reason, iterations = "", 0
        for what, knots, count in self._candidates(scene, target, is_free):
            iterations += count
            if knots is None:
                reason = "no solution"
                continue
            room = scene.room(knots)
            if (room >= 0.0).all():
                if not np.array_equal(knots, scene.old):
                    self._commit(scene, knots)
                return "committed", what, iterations
            worst = scene.names[int(room.argmin())]
            outcome = "kept" if worst in scene.unheard else "refused"
            reason = f"{UNHEARD} {worst}" if worst in scene.unheard else f"too near {worst}"
        return outcome, reason, iterations

    def _candidates(self, scene: Scene, target: Array, is_free: bool) -> Iterator[tuple[str, Array | None, int]]:
        """Yield what it is, knots from g - 1 on, and iterations: the wish, or a way back to it; and then plans."""
        if is_free:
            what, wished = self._own.towards_the_wish(scene.old[1:], scene.first)
            most = ALLOWANCE * np.array([self._spec.speed, self._spec.acceleration])
            if (np.abs(wished[:, 1:, :2]) <= most[:, None] + 1e-9).all():
                yield what, self._own.whole(scene.old[0], wished), 0
        near = scene.room(scene.old) < NEAR_M
        heading = self._way.heading_for(self._turn, scene, target[-1, :2])
        if not np.array_equal(heading, target[-1, :2]):
            target[:, :2] = heading
        while True:
            knots, iterations = self._planned(scene, target, near)
            yield ("planned" if is_free else "steps aside"), knots, iterations
            if knots is None:
                return
            more = near | (scene.room(knots) < 0.0)
            if (more == near).all():
                return
            near = more

    def _planned(self, scene: Scene, target: Array, near: Mask) -> tuple[Array | None, int]:
        """Solve the QPs of a plan behind half-spaces against those that are near."""
        spec, old = self._spec, scene.old[1 : self._spec.steps + 2]
        sides = scene.half_spaces(near, spec.turn, spec.steps, spec.haste * spec.acceleration)
        plane, iterations = self._plane(old[:, :, :2], target[:, :2], sides), self._plane.iterations
        if plane is None:
            return None, iterations
        knots = old.copy()
        knots[:, :, :2] = plane
        for axis, qp in ((2, self._height), (3, self._heading)):
            if np.abs(old[1:, 0, axis] - target[:, axis]).max() > 1e-9:
                planned = qp(old[:, :, axis : axis + 1], target[:, axis : axis + 1])
                iterations += qp.iterations
                if planned is None:
                    return None, iterations
                knots[:, :, axis : axis + 1] = planned
        return self._own.whole(scene.old[0], knots), iterations

    def _save(self, scene: Scene) -> tuple[Outcome, str, int]:
        """Commit what comes least near to one that has left its plan and lies ahead; return as `_choose` does."""
        knots, iterations = self._escape.away(scene)
        if knots is None:
            return "kept", "in danger", iterations
        self._commit(scene, knots)
        return "committed", "in danger", iterations
