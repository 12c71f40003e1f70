"""Sequential distributed planning: each in turn plans a few seconds ahead, around the newest plans of all others.

**Never nearer than promised.** Turns are at times that all know, one at a time. A planner commits a new plan only if it
stays at the promised distance, also between the knots, from the plan of every other that it has heard the newest turn
of. Of one whose newest turns it has not heard, the new plan stays clear of wherever new plans of these turns can lead.
So all plans are clear of each other after each turn if they were before it. Each ends at rest: an old plan, flown to
its end, stays clear of all others for ever, and so a planner can always keep it. Messages that are lost or late cost
time, never distance. It needs one clock, and helicopters that fly their plans: the promised distance is that of two
that touch, and twice the error of the flight.

**Nobody waits for ever, where there is room.** Planned around each other, helicopters stand still when each is in the
way of the next. One that has stood for a while where it does not want to be tells its way to go. Who is ahead of it,
near, and has less way to go, steps aside, to the side where it stands, until the other has passed; if it stands itself
while it steps aside, it asks in turn with the other's way to go instead of its own. Of all that stand, the one with the
longest way (of equal ones, the last by name) never steps aside, so that those ahead of it do, and those behind them, as
far as there is room: it moves on and arrives. A helicopter that has arrived has no way to go and gives way to all, so
the number of those that have not arrived falls. There is no proof for a room so full that nobody can step aside.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from time import perf_counter_ns
from typing import Annotated, Literal, NamedTuple

import numpy as np
from annotated_types import Ge, Gt, Le, Unit, doc

from controllers.coordinations import CommittedPlan, Message, Note, Outcome, Ship
from controllers.pace import paced, smooth_start
from controllers.plan_qp import Effort, HalfSpaces, PlanQp
from controllers.rotations import rotate_to_world
from controllers.separation import FINE, bend_of, distances, fine_path, knots_from, reach
from controllers.signals import Array, Estimate, nanoseconds
from controllers.splines import quintic
from controllers.trajectories import Trajectory

WISH_STEPS = 4
"""Steps of the wish before the stop: the laws look 0.4 s ahead, and must not see a stop that is put off again."""
JOIN_STEPS = 10
"""Steps in which a plan goes over into the wish: in fewer, it needs a jerk that shakes the helicopter."""
JOIN_LONGER = 4
"""Steps by which such a plan is longer than the others: it must stop from the wish too."""
ALLOWANCE = 1.5
"""The wish may need this multiple of the limits on plans: it is flown as it is where it is clear."""
FREE, JOINS = "", "back to its wish"
"""Reasons in the note of a turn in which the wish is clear."""
NEAR_M = 0.1
"""Who is nearer to where it wants to be asks nobody to step aside."""
RIGHT_RAD = 0.7
"""How far to the right of its way who has no way ahead goes: with 1.2 rad some circle for ever."""
AHEAD_M, AHEAD_SHARE = 1.0, 0.5
"""Who comes ahead by less than this share of this length, or of the rest of its way, has no way ahead."""
HASTE = 2.0
"""Who is in danger may need this multiple of the acceleration of plans."""
SEEN_NS = 300_000_000
"""Age of a pose up to which the estimate says where the helicopter is; later, it is where it was planned to be."""
TO_AND_FRO = 5
"""Who has stayed within `NEAR_M` for this multiple of its patience stands too."""
BETWEEN_M = 0.012
"""Added to the promised distance at the knots, for what is between them: half the square of 2 m/s times 0.05 s, by
0.45 m, and the bend of the path."""


@dataclass(frozen=True, slots=True)
class Sequential:
    """Each helicopter in turn plans around the newest plans of all others, and flies its own trajectory where clear.

    The promised distance is that of the plans: with `controller.terminal = riccati` the helicopters of the lab then
    keep 0.3 m, and rotors touch at 0.19 m. Speed and acceleration are half of what the helicopter can do.
    """

    kind: Literal["sequential"] = "sequential"
    distance: Annotated[float, Gt(0), Le(10), Unit("m"), doc("promised between any two plans, in the plane")] = 0.45
    period: Annotated[float, Ge(0.02), Le(1), Unit("s"), doc("between two turns of a helicopter")] = 0.1
    hearing: Annotated[
        float, Ge(0), Le(10), Unit("s"), doc("least time between two turns, for messages to arrive; it can slow turns")
    ] = 0.002
    steps: Annotated[int, Ge(12), Le(60), doc("periods that a plan is long")] = 20
    speed: Annotated[float, Gt(0), Le(3), Unit("m/s"), doc("limit of plans, north and west")] = 1.0
    acceleration: Annotated[float, Gt(0), Le(2), Unit("m/s^2"), doc("limit of plans, north and west")] = 0.7
    turn: Annotated[float, Ge(0), Le(1), Unit("rad"), doc("how far half-spaces are turned, so that all pass right")] = (
        0.35
    )
    patience: Annotated[float, Gt(0), Le(60), Unit("s"), doc("standing this long, others are asked to step aside")] = (
        0.4
    )
    aside: Annotated[float, Ge(0), Le(10), Unit("m"), doc("who is nearer than the distance and this, steps aside")] = (
        0.25
    )
    berth: Annotated[float, Ge(0), Le(10), Unit("m"), doc("further distance from one that lands in an emergency")] = 0.2
    half_width: Annotated[float, Gt(0), Unit("m"), doc("nobody steps aside further than this, north and west")] = 2.0
    copies: Annotated[int, Ge(1), Le(20), doc("how often each message is sent")] = 3
    gossip: Annotated[Literal["on", "off"], doc("messages pass on the newest plans of others too")] = "on"

    def planner_of(self, ship: str, ships: Sequence[Ship]) -> "SequentialPlanner":
        """Return the planner of one helicopter.

        Raises:
            ValueError: Two start nearer to each other than the promised distance.
        """
        return SequentialPlanner(self, ship, ships)


class Told(NamedTuple):
    """What a planner tells of its newest turn."""

    turn: int
    """Its number, from 0; -1 before take-off."""
    plan: CommittedPlan
    goal: tuple[float, float]
    """Where it wants to be, x y, m."""
    way: float
    """Way to go of the one for which it asks others to step aside, m; 0 if it does not ask."""
    asker: str
    """For whom it asks: itself, or the one for which it steps aside."""
    is_down: bool
    """It does not fly its plan: its supervisor has taken over. The plan is to stay where it is."""

    @property
    def size(self) -> int:
        """Bytes of it on a network: knots in single precision, and twelve further numbers."""
        return 4 * self.plan.knots.size + 48


class Scene(NamedTuple):
    """What a planner knows of the others in its turn, on the grid of times."""

    first: int
    """Index g of the knot from which on a plan can be new; plans begin a knot earlier."""
    old: Array
    """(L + 2, 3, 4) knots of the own committed plan from g - 1 on."""
    names: list[str]
    """Of the others."""
    knots: Array
    """(j, L + 2, 2) positions of the others."""
    paths: Array
    """(j, t, 2) positions of the others, `FINE` in each step."""
    wide: Array
    """(j, t - 1) distance to keep from each during each chord, m."""
    in_danger: Array
    """(j,) whether the own plan leads to one that has left its plan to land."""
    unheard: list[str]
    """Those whose newest turns have not been heard."""


class SequentialPlanner:
    """The planner of one helicopter."""

    def __init__(self, spec: Sequential, ship: str, ships: Sequence[Ship]) -> None:
        self._spec, self._names = spec, [each.name for each in ships]
        self._name, self._index = ship, self._names.index(ship)
        self._wish = ships[self._index].wish
        self._step, self._h = nanoseconds(spec.period), spec.period
        self._round = max(self._step, nanoseconds(spec.hearing) * len(ships))
        self._length = spec.steps + JOIN_LONGER
        """Steps of the longest plan, L."""
        self._bend = bend_of(ALLOWANCE * spec.acceleration, spec.period)
        self._plane = PlanQp(spec.steps, spec.period, 2, Effort(spec.speed, spec.acceleration))
        self._escape = PlanQp(spec.steps, spec.period, 2, Effort(spec.speed, HASTE * spec.acceleration, 0.002, 0.0))
        self._height = PlanQp(spec.steps, spec.period, 1, Effort(0.5, 1.0))
        self._heading = PlanQp(spec.steps, spec.period, 1, Effort(2.0, 6.0))
        first = self._before_take_off(ships)
        self.committed = first.pop(ship)
        self._heard = {name: Told(-1, plan, (0.0, 0.0), 0.0, name, False) for name, plan in first.items()}
        self._turn, self.due, self.note = 0, self._time_of(self._index, 0), Note("kept")
        self._places: list[Array] = []
        """Where it was in its last turns."""
        self._asks_until = -1
        """Turn until which it asks others to step aside."""
        self._yields: tuple[Told, float, int] | None = None
        """To whom, on which side, and until which turn."""
        self._goes_round: tuple[str, float] | None = None
        """Whom, and on which side."""

    # --- what all know

    def _time_of(self, index: int, turn: int) -> int:
        """When a turn of the ship with an index is, ns."""
        return (turn * len(self._names) + index) * self._round // len(self._names)

    def _departs(self, index: int, turn: int) -> int:
        """Index of the knot from which on a plan of a turn can be new."""
        return self._time_of(index, turn) // self._step + 1

    def _before_take_off(self, ships: Sequence[Ship]) -> dict[str, CommittedPlan]:
        """The plans that all have committed at time 0: the wish and a stop, or to stay, where wishes are too near."""
        count = self._length + 2
        plans = {s.name: CommittedPlan(0, self._step, self._wished(s.wish, 0, count, WISH_STEPS)) for s in ships}
        waits = True
        while waits and (pairs := self._too_near(plans)):
            waits = False
            for name in {each for pair in pairs for each in pair}:
                knots = plans[name].knots
                if not knots[0, 1:].any() and not np.array_equal(knots[0], knots[-1]):
                    plans[name], waits = plans[name]._replace(knots=np.repeat(knots[:1], count, axis=0)), True
        for one, other in self._too_near(plans):
            apart = float(np.hypot(*(plans[one].knots[0, 0, :2] - plans[other].knots[0, 0, :2])))
            raise ValueError(
                f"{one} and {other} start {apart:.2f} m apart, and fly nearer than distance = {self._spec.distance:g} m"
                ": start them further apart or at rest, or promise less"
            )
        return plans

    def _too_near(self, plans: Mapping[str, CommittedPlan]) -> list[tuple[str, str]]:
        names = [*plans]
        paths = np.stack([fine_path(plans[name].knots, self._h) for name in names])
        pairs: list[tuple[str, str]] = []
        for i, one in enumerate(names):
            near = distances(paths[i], paths[i + 1 :], self._bend).min(axis=1) < self._spec.distance
            pairs += [(one, names[i + 1 + j]) for j in np.flatnonzero(near)]
        return pairs

    def _wished(self, wish: Trajectory, first: int, count: int, steps: int) -> Array:
        """Knots of the wish from a grid index on: it is flown for some steps, and then its clock slows down to rest."""
        since = self._h * (np.arange(count) - steps)
        stop = self._h * (count - 1 - steps)
        left = np.clip(stop - since, 0.0, stop)
        reading, speed, acceleration = smooth_start(left, stop)
        slowed = since > 0.0
        clock = np.where(slowed, 0.5 * stop - reading, since)
        pace = clock, np.where(slowed, speed, 1.0), np.where(slowed, -acceleration, 0.0)
        t = 1e-9 * self._step * (first + steps) + clock
        return np.stack(paced(wish.flat(t), pace), axis=1)

    # --- messages

    def receive(self, now: int, message: Message) -> None:
        """Keep what is newer than what was heard before."""
        body: Mapping[str, Told] = message.body
        for name, told in body.items():
            if name in self._heard and told.turn > self._heard[name].turn:
                self._heard[name] = told

    def _messages(self, now: int, told: Told) -> list[Message]:
        body = {self._name: told} | (self._heard if self._spec.gossip == "on" else {})
        size = sum(each.size for each in body.values())
        return [Message(self._name, now, body, size)] * self._spec.copies

    # --- a turn

    def act(self, now: int, estimate: Estimate | None, is_flying: bool) -> Sequence[Message]:
        """Plan, commit, and tell the others."""
        scene, turn = self._scene(), self._turn
        self._turn += 1
        self.due = self._time_of(self._index, self._turn)
        told = Told(turn, self.committed, (0.0, 0.0), 0.0, self._name, not is_flying)
        if is_flying:
            told = self._fly(scene, told)
        else:
            stop = self._stop(scene.old[1] if _is_blind(now, estimate) else _state(estimate), self._spec.acceleration)
            self.committed = CommittedPlan((scene.first - 1) * self._step, self._step, stop)
            self.note = Note("committed", "stays where its supervisor has taken it")
        return self._messages(now, told._replace(plan=self.committed))

    def _stop(self, state: Array, acceleration: float) -> Array:
        """Return knots (L + 2, 3, 4) of a straight way from a state (3, 4) to rest, at up to 1.5 accelerations."""
        length = max(0.3, float(np.abs(state[1, :3]).max()) / acceleration)
        rest = np.stack([state[0] + 0.5 * length * state[1], np.zeros(4), np.zeros(4)])
        ends = np.stack([state, rest])
        t = self._h * np.arange(self._length + 2)
        return np.stack(quintic(t, np.array([0.0, length]), *np.moveaxis(ends, 1, 0)), axis=1)

    def _scene(self) -> Scene:
        spec, L = self._spec, self._length
        g = self._departs(self._index, self._turn)
        names = [name for name in self._names if name != self._name]
        heard = [self._heard[name] for name in names]
        knots = np.array([knots_from(told.plan, g - 1, L + 2)[:, :, :2] for told in heard]).reshape(-1, L + 2, 3, 2)
        paths = fine_path(knots, self._h)
        old = knots_from(self.committed, g - 1, L + 2)
        wide = np.full((len(names), paths.shape[1] - 1), spec.distance)
        in_danger = np.zeros(len(names), bool)
        for j in np.flatnonzero([told.is_down for told in heard]):
            kept = distances(fine_path(old, self._h), paths[j : j + 1], self._bend)[0]
            in_danger[j] = kept.min() < spec.distance
            if not in_danger[j]:
                # Who is too near already, comes no nearer.
                wide[j] = np.minimum(spec.distance + spec.berth, kept - 1e-9)
        unheard: list[str] = []
        # The end of each chord: there the reach is greater.
        t = (g - 1 + np.arange(1, wide.shape[1] + 1) / FINE) * self._h
        for j, (name, told) in enumerate(zip(names, heard, strict=True)):
            index = self._names.index(name)
            newest = self._turn if index < self._index else self._turn - 1
            if told.turn < newest:
                unheard.append(name)
                parts = self._h * self._departs(index, told.turn + 1)
                rests = self._h * (self._departs(index, newest) + L)
                wide[j] += reach(t - parts, rests - parts, ALLOWANCE * spec.acceleration)
        return Scene(g, old, names, knots[:, :, 0], paths, wide, in_danger, unheard)

    def _fly(self, scene: Scene, told: Told) -> Told:
        """Commit a new plan if there is a clear one; return what to tell: where it wants to be, and whether it asks."""
        spec, turn, N, began = self._spec, told.turn, self._spec.steps, perf_counter_ns()
        here = scene.old[1, 0, :2]
        target = self._wish.flat(self._h * (scene.first + np.arange(1, N + 1))).z
        way = float(np.hypot(*(target[-1, :2] - here)))
        asked = self._aside(scene, turn, way)
        if asked:
            way = asked[1].way
            target[:, :2] = asked[0]
        goal = target[-1, :2].copy()
        is_stuck = self._stands(scene, goal)
        if is_stuck:
            self._asks_until = turn + round(2.0 / spec.period)
        outcome, reason, iterations = self._choose(scene, target, not asked)
        self.note = Note(outcome, reason, is_stuck, iterations, perf_counter_ns() - began if iterations else 0)
        asks = turn <= self._asks_until and np.hypot(*(goal - here)) >= NEAR_M
        asker = asked[1].asker if asked else self._name
        return told._replace(goal=(float(goal[0]), float(goal[1])), way=way if asks else 0.0, asker=asker)

    def _stands(self, scene: Scene, goal: Array) -> bool:
        """Return whether it has stood, or moved to and fro, for a while where it does not want to be."""
        here, patience = scene.old[1, 0, :2], max(1, round(self._spec.patience / self._spec.period))
        if self.note.reason in (FREE, JOINS) or np.hypot(*(goal - here)) < NEAR_M:
            self._places = []
        self._places = [*self._places[-TO_AND_FRO * patience :], here]
        since = np.hypot(*(np.array(self._places) - here).T)
        rests = np.abs(scene.old[1:4, 1, :2]).max() < 0.03
        return bool(
            (rests and len(since) > patience and since[-patience:].max() < 0.03)
            or (len(since) > TO_AND_FRO * patience and since.max() < NEAR_M)
        )

    def _choose(self, scene: Scene, target: Array, is_free: bool) -> tuple[Outcome, str, int]:
        """Commit the first candidate that is clear; return the outcome, its reason and ProxQP's iterations."""
        if scene.in_danger.any():
            return self._save(scene)
        outcome: Outcome = "refused"
        reason, iterations = "", 0
        for what, knots, count in self._candidates(scene, target, is_free):
            iterations += count
            if knots is None:
                reason = "no solution"
                continue
            room = self._room(scene, knots)
            if (room >= 0.0).all():
                if not np.array_equal(knots, scene.old):
                    self.committed = CommittedPlan((scene.first - 1) * self._step, self._step, knots)
                return "committed", what, iterations
            worst = scene.names[int(room.argmin())]
            outcome = "kept" if worst in scene.unheard else "refused"
            reason = f"no current plan of {worst}" if worst in scene.unheard else f"too near {worst}"
        return outcome, reason, iterations

    def _save(self, scene: Scene) -> tuple[Outcome, str, int]:
        """Commit what comes least near to one that has left its plan and lies ahead; return as `_choose` does.

        It is near to no other than before: either it keeps its distance, or it keeps the old plan.
        """
        old = scene.old[1 : self._spec.steps + 2]
        danger = scene.knots[scene.in_danger, 1].mean(axis=0)
        away = old[0, 0, :2] - danger
        target = np.tile(old[0, 0, :2] + 0.5 * away / max(float(np.hypot(*away)), 1e-6), (len(old) - 1, 1))
        near, iterations = self._near(scene, scene.old, 0.4), 0
        best, room = scene.old, self._room(scene, scene.old)[scene.in_danger].min()
        stop = self._stop(scene.old[1], HASTE * self._spec.acceleration)
        candidates = [np.concatenate([scene.old[:1], stop[:-1]])]
        for each in (near, near & ~scene.in_danger):
            plane = self._escape(old[:, :, :2], target, self._half_spaces(scene, each))
            iterations += self._escape.iterations
            if plane is not None:
                candidates.append(self._whole(scene, np.concatenate([plane, old[:, :, 2:]], axis=2)))
        for knots in candidates:
            rooms = self._room(scene, knots)
            if (rooms[~scene.in_danger] >= 0.0).all() and rooms[scene.in_danger].min() > room + 1e-3:
                best, room = knots, rooms[scene.in_danger].min()
        if best is scene.old:
            return "kept", "in danger", iterations
        self.committed = CommittedPlan((scene.first - 1) * self._step, self._step, best)
        return "committed", "in danger", iterations

    def _room(self, scene: Scene, knots: Array) -> Array:
        """(j,) least distance to each other beyond that to keep, m."""
        if not scene.names:
            return np.zeros(0)
        return (distances(fine_path(knots, self._h), scene.paths, self._bend) - scene.wide).min(axis=1)

    def _candidates(self, scene: Scene, target: Array, is_free: bool) -> Iterator[tuple[str, Array | None, int]]:
        """Yield what it is, knots from g - 1 on, and iterations: the wish, a way back to it, and a plan."""
        g = scene.first
        if is_free:
            what, wished = self._towards_the_wish(scene.old, g)
            if self._is_within_limits(wished):
                yield what, self._whole(scene, wished), 0
        near = self._near(scene, scene.old, 0.4)
        target = self._beside(scene, target)
        while True:
            knots, iterations = self._planned(scene, target, near)
            yield ("planned" if is_free else "steps aside"), knots, iterations
            if knots is None:
                return
            more = near | self._near(scene, knots, 0.0)
            if (more == near).all():
                return
            near = more

    def _whole(self, scene: Scene, knots: Array) -> Array:
        """Put the knot before knots (k, 3, 4) from g on, and rest after them: (L + 2, 3, 4)."""
        rest = np.zeros((self._length + 1 - len(knots), 3, 4))
        rest[:, 0] = knots[-1, 0]
        return np.concatenate([scene.old[:1], knots, rest])

    def _is_within_limits(self, knots: Array) -> bool:
        most = ALLOWANCE * np.array([self._spec.speed, self._spec.acceleration])
        return bool((np.abs(knots[:, 1:, :2]) <= most[:, None] + 1e-9).all())

    def _towards_the_wish(self, old: Array, g: int) -> tuple[str, Array]:
        """Return what it is, and knots from g on: the wish and a stop, after what is left of the way to the wish."""
        N, L = self._spec.steps, self._length
        wish = np.stack(self._wish.flat(self._h * (g + np.arange(JOIN_STEPS + 1))), axis=1)
        met = np.abs(wish - old[1 : JOIN_STEPS + 2]).max(axis=(1, 2)) < 1e-9
        if met[0]:
            return FREE, self._wished(self._wish, g, N + 1, WISH_STEPS)
        if met.any():
            steps = max(int(met.argmax()), WISH_STEPS)
            way = old[1 : met.argmax() + 1]
        else:
            steps, t = JOIN_STEPS, self._h * np.arange(JOIN_STEPS)
            ends = np.stack([old[1], wish[JOIN_STEPS]])
            joins = quintic(t, self._h * np.array([0.0, JOIN_STEPS]), *np.moveaxis(ends, 1, 0))
            # The first knot as it is, to the last digit.
            way = np.concatenate([old[1:2], np.stack(joins, axis=1)[1:]])
        wished = self._wished(self._wish, g, min(steps + N - WISH_STEPS, L) + 1, steps)
        return JOINS, np.concatenate([way, wished[len(way) :]])

    def _near(self, scene: Scene, knots: Array, further: float) -> Array:
        """(j,) who comes nearer than the distance to keep and a `further` one."""
        return self._room(scene, knots) < further

    def _planned(self, scene: Scene, target: Array, near: Array) -> tuple[Array | None, int]:
        """Solve the QPs of a plan behind half-spaces against those that are near."""
        old = scene.old[1 : self._spec.steps + 2]
        plane = self._plane(old[:, :, :2], target[:, :2], self._half_spaces(scene, near))
        iterations = self._plane.iterations
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
        return self._whole(scene, knots), iterations

    def _half_spaces(self, scene: Scene, near: Array) -> HalfSpaces | None:
        """Lines between the old plan and the plans of those that are near, turned so that all pass on the right.

        The old plan is behind each: it stays feasible.
        """
        N, k = self._spec.steps, np.arange(1, self._spec.steps + 1)
        sides: list[tuple[Array, Array, Array]] = []
        for j in np.flatnonzero(near):
            there = scene.knots[j, 2 : N + 2]
            away = scene.old[2 : N + 2, 0, :2] - there
            # Of the chord before each knot.
            keep = scene.wide[j, FINE - 1 :: FINE][1 : N + 1] + BETWEEN_M
            if scene.in_danger[j]:
                away = np.tile(scene.old[1, 0, :2] - scene.knots[j, 1], (N, 1))
            apart = np.maximum(np.hypot(*away.T), 1e-6)
            angle = np.minimum(self._spec.turn, 0.9 * np.arccos(np.minimum(keep / apart, 1.0)))
            c, s = np.cos(angle), np.sin(angle)
            normals = np.stack([c * away[:, 0] - s * away[:, 1], s * away[:, 0] + c * away[:, 1]], axis=1)
            normals /= apart[:, None]
            kept = (normals * away).sum(axis=1)
            if scene.in_danger[j]:
                # As hard as it can brake, and then away.
                t, closing = self._h * k, (normals * scene.old[1, 1, :2]).sum(axis=1)
                kept += closing * t + 0.4 * HASTE * self._spec.acceleration * t**2
            keep = np.minimum(keep, kept)
            sides.append((k, normals, (normals * there).sum(axis=1) + keep))
        return HalfSpaces(*map(np.concatenate, zip(*sides, strict=True))) if sides else None

    # --- against deadlock

    def _aside(self, scene: Scene, turn: int, way: float) -> tuple[Array, Told] | None:
        """Return where to step aside to (2,), and who asks; None if nobody does.

        Args:
            scene: The others.
            turn: Number of this turn.
            way: Own way to go, m.
        """
        spec, here = self._spec, scene.old[1, 0, :2]
        mine = (way, self._name) if turn <= self._asks_until else (0.0, "")
        if self._yields and turn > self._yields[2]:
            self._yields = None
        for j, name in enumerate(scene.names):
            told = self._heard[name]
            if not told.way or told.asker == self._name or (told.way, told.asker) <= mine:
                continue
            if self._yields and self._yields[0].way > told.way and self._yields[0].asker != told.asker:
                continue
            ahead, sideways, _ = _seen_from(scene.knots[j, 1], told.goal, here)
            if ahead > 0.0 and np.hypot(ahead, sideways) < spec.distance + spec.aside:
                side = 1.0 if sideways > 0.01 else -1.0
                if self._yields and self._yields[0].asker == told.asker:
                    side = self._yields[1]
                self._yields = told, side, turn + round(1.0 / spec.period)
        if not self._yields:
            return None
        told, side, _ = self._yields
        start = knots_from(told.plan, scene.first, 1)[0, 0, :2]
        for each in (side, -side):
            ahead, sideways, along = _seen_from(start, told.goal, here)
            out = each * max(each * sideways, spec.distance + 0.1)
            place = start + ahead * along + out * np.array([-along[1], along[0]])
            if np.abs(place).max() <= spec.half_width:
                break
        return np.clip(place, -spec.half_width, spec.half_width), told

    def _beside(self, scene: Scene, target: Array) -> Array:
        """Return a target beside the first that stands in the way to the target, or the target where nobody does."""
        here, goal = scene.old[1, 0, :2], target[-1, :2]
        way = goal - here
        length = max(float(np.hypot(*way)), 1e-9)
        first, shortest = None, np.inf
        for j, name in enumerate(scene.names):
            centre, radius = scene.knots[j, 1], float(scene.wide[j, 0]) + 0.05
            stands = np.abs(scene.knots[j, -1] - centre).max() < 0.1
            ahead, sideways, _ = _seen_from(here, (float(goal[0]), float(goal[1])), centre)
            blocks = (
                0.0 < ahead < length and abs(sideways) < radius - 0.02 and np.hypot(*(goal - centre)) > radius - 0.05
            )
            if stands and blocks and ahead < shortest:
                first, shortest = (name, centre, radius, sideways), ahead
        if first is None:
            self._goes_round = None
            return self._to_the_right(scene, target, way, length)
        name, centre, radius, sideways = first
        side = -1.0 if sideways > -0.02 else 1.0
        if self._goes_round and self._goes_round[0] == name:
            side = self._goes_round[1]
        self._goes_round = name, side
        there = centre - here
        apart = float(np.hypot(*there))
        angle = np.arctan2(there[1], there[0]) + side * np.arcsin(min(radius / apart, 1.0))
        beside = here + min(length, apart + 0.3) * np.array([np.cos(angle), np.sin(angle)])
        return np.concatenate([np.tile(beside, (len(target), 1)), target[:, 2:]], axis=1)

    def _to_the_right(self, scene: Scene, target: Array, way: Array, length: float) -> Array:
        """Return a target to the right of the way where those that move leave no way ahead: all go round each other."""
        ahead = float((scene.old[-1, 0, :2] - scene.old[1, 0, :2]) @ way) / length
        if ahead >= AHEAD_SHARE * min(length, AHEAD_M):
            return target
        c, s = np.cos(RIGHT_RAD), np.sin(RIGHT_RAD)
        aside = np.array([c * way[0] + s * way[1], c * way[1] - s * way[0]])
        beside = scene.old[1, 0, :2] + min(1.0, 1.0 / length) * aside
        return np.concatenate([np.tile(beside, (len(target), 1)), target[:, 2:]], axis=1)


def _is_blind(now: int, estimate: Estimate | None) -> bool:
    return estimate is None or now - estimate.pose_stamp > SEEN_NS


def _state(estimate: Estimate | None) -> Array:
    """Position, velocity in the world and no acceleration of an estimate, (3, 4)."""
    state = np.zeros((3, 4))
    if estimate is not None:
        state[0], state[1] = estimate.x[:4], estimate.x[4:8]
        state[1, :2] = rotate_to_world(estimate.x[4:6], estimate.x[3])
    return state


def _seen_from(start: Array, goal: tuple[float, float], here: Array) -> tuple[float, float, Array]:
    """Return how far ahead and to the left of a way a point is, m, and the direction (2,) of the way."""
    along = np.array(goal) - start
    along /= max(float(np.hypot(*along)), 1e-9)
    x, y = here - start
    return float(x * along[0] + y * along[1]), float(y * along[0] - x * along[1]), along
