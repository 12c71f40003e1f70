"""The supervisor that lands when the flight cannot go on.

ready ──► flying ◄──► coasting ◄──► levelling ──► landing ──► landed
             └──────────────────────────────────────►┘
"""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt, Le, Unit, doc

from controllers.descent import Descent, descend, hold
from controllers.model import Model
from controllers.signals import Array, Command, Estimate, Reference, nanoseconds
from controllers.supervisors import Order, Phase, PhaseChange

LINGERS = "the plan ended on the floor while it hovered just above"
"""The reason of a landing that was planned."""
PRESSING = 0.85
"""Share of hover thrust that takes down a helicopter that should stand already: ground effect adds an eighth."""
UNSOLVED = ("shifted_plan", "safe_hover")
"""Statuses of a control problem that was not solved."""


@dataclass(frozen=True, slots=True)
class Safety:
    """Lets the plan fly while the helicopter is seen and controlled; else levels off and lands.

    Without poses the flight goes on from the estimate (coasting), then the helicopter stops where it is (levelling),
    then it descends (landing). Poses that come back before the descent let the plan fly on. A plan that starts on the
    floor starts with motors at rest; on the floor at the end, the motors are stopped.

    Times and speeds bound the drift: of the way from where levelling began to the touch-down, nearly all is wind that
    nobody sees. Gusts of 0.25 m/s move a blind helicopter by 10 to 15 cm, rarely 45 cm, in the 1.3 s from levelling to
    the floor. The descent is fast for that reason; above 1 m/s, half the induced velocity of its rotors, a real one
    may meet its own wake, which the twin leaves out. With heave damping of 1.5 1/s that is not believed, the way down
    takes 2.8 s; believed and not there, it ends too fast.
    """

    kind: Literal["safety"] = "safety"
    coast_after: Annotated[float, Gt(0), Le(60), Unit("s"), doc("age of the newest pose that is worth an event")] = 0.1
    # Half a second without poses, and the time until the first good one has arrived: who stops for one step, jerks.
    level_after: Annotated[float, Gt(0), Le(60), Unit("s"), doc("age of the newest pose at which to stop")] = 0.55
    land_after: Annotated[float, Gt(0), Le(60), Unit("s"), doc("age of the newest pose at which to descend")] = 0.75
    solver_timeout: Annotated[float, Gt(0), Le(60), Unit("s"), doc("time without a solved problem; then land")] = 0.5
    low_voltage: Annotated[float, Ge(0), Le(20), Unit("V"), doc("of the battery, at which to land")] = 3.3
    half_width: Annotated[float, Gt(0), Unit("m"), doc("distance north and west at which to land")] = 2.2
    height: Annotated[float, Gt(0), Unit("m"), doc("height at which to land")] = 2.3
    sink_speed: Annotated[float, Gt(0), Le(2), Unit("m/s"), doc("speed of a blind descent")] = 1.5
    seen_sink_speed: Annotated[float, Gt(0), Le(2), Unit("m/s"), doc("speed of a descent with poses")] = 0.5
    touch_speed: Annotated[float, Gt(0), Le(1), Unit("m/s"), doc("speed at which it meets the floor")] = 0.4
    slow_below: Annotated[float, Ge(0), Unit("m"), doc("height above the floor of the slow rest of the descent")] = 0.05
    settle: Annotated[float, Gt(0), Le(10), Unit("s"), doc("time on the floor after which the motors stop")] = 0.1
    # Of 1.5 1/s, unknown, a blind helicopter would be 0.4 m high when it should stand.
    heave_damping: Annotated[
        float, Ge(0), Le(10), Unit("1/s"), doc("believed deceleration per vertical speed, for a blind descent")
    ] = 0.0
    press: Annotated[
        float, Ge(0), Le(10), Unit("s"), doc("time to press down, unseen, after the floor should be reached")
    ] = 1.0
    spool: Annotated[float, Gt(0), Le(10), Unit("s"), doc("time in which the motors start and stop")] = 0.5
    # Ground effect carries it: without an integral in z, an MPC hovers 3 cm above the floor.
    linger: Annotated[
        float, Gt(0), Le(36_000), Unit("s"), doc("time above the floor with the plan on it; then descend")
    ] = 0.5
    # The skids reach 0.045 m below the centre of gravity.
    floor: Annotated[float, Gt(0), Unit("m"), doc("height of the centre of gravity when it stands")] = 0.045

    def start(self, model: Model, period: float) -> "SafetySupervisor":
        """Make the supervisor of one flight."""
        return SafetySupervisor(self, model, period)


class SafetySupervisor:
    """One flight's phase, and the way down."""

    def __init__(self, spec: Safety, model: Model, period: float) -> None:
        self._spec, self._model, self._period = spec, model, period
        bottom = spec.floor - 0.05
        # Half of gravity: the thrust stays within its limits, and there is no time to lose.
        self._descent = Descent(
            spec.sink_speed, spec.touch_speed, spec.slow_below, 5.0, bottom, spec.floor, spec.heave_damping
        )
        self._seen_descent = self._descent._replace(sink_speed=spec.seen_sink_speed)
        self.phase: Phase = "ready"
        self.lands_on_plan = False
        """Whether it stops and lands along the plan, which a planner brings to rest; else where it is."""
        self._has_begun = False
        self._place = np.zeros(4)
        self._speed = 0.0
        self._voltage, self._optimises = float("inf"), False
        self._solved_at, self._has_solver = 0, True
        self._standing_since: int | None = None
        self._planned_down_since: int | None = None
        self._thrust, self._fell_blind = 0.0, False

    def order(self, now: int, estimate: Estimate | None, plan: Reference) -> Order:
        """Decide on the phase, and what to fly in it."""
        before = self.phase
        reason = self._next(now, estimate, plan)
        is_calm = self.phase in ("ready", "flying", "landed") or reason == LINGERS
        severity = "info" if is_calm else "warning"
        event = PhaseChange(severity, self.phase, reason) if self.phase != before or reason else None
        match self.phase:
            case "ready" | "landed":
                return Order(command=self._on_the_floor(now), event=event)
            case "flying" | "coasting":
                return Order(plan if estimate else None, event=event)
            case "levelling" | "landing":
                return self._way_down(now, estimate, plan)._replace(event=event)

    def battery(self, voltage: float) -> None:
        """Take note of the voltage, V."""
        self._voltage = voltage

    def sent(self, command: Command) -> None:
        """Take note of the thrust, and of how the control problem was solved; a law without a QP solves all."""
        self._thrust = float(command.u[2])
        self._optimises |= command.qp is not None and command.qp.status not in UNSOLVED
        if command.qp is None or command.qp.status not in UNSOLVED:
            self._solved_at = command.stamp

    def _next(self, now: int, estimate: Estimate | None, plan: Reference) -> str:
        """Move to the phase of this step; return the reason, empty where nothing changes."""
        spec = self._spec
        unseen = 1e-9 * (now - estimate.pose_stamp) if estimate else 1e-9 * now
        match self.phase:
            case "ready":
                return self._start(unseen, plan)
            case "flying" | "coasting" | "levelling":
                if trouble := self._trouble(now, unseen, estimate):
                    if self.phase != "levelling":
                        self._stop_at(estimate.x if estimate else plan.x[0])
                    self.phase = "landing"
                    return trouble
                if self._has_landed_as_planned(now, estimate, plan):
                    self.phase = "landed"
                    return "the plan has come down"
                if self._lingers(now) and estimate:
                    self._stop_at(estimate.x)
                    self.phase = "landing"
                    return LINGERS
                return self._watch(unseen, estimate.x if estimate else plan.x[0])
            case "landing":
                if self._stands(now, estimate, unseen > spec.coast_after):
                    self.phase = "landed"
                    return "on the floor, motors off"
                return ""
            case "landed":
                return ""

    def _start(self, unseen: float, plan: Reference) -> str:
        spec = self._spec
        if float(plan.x[0, 2]) <= spec.floor + 0.002 and float(plan.x[0, 6]) < 0.01:
            first, self._has_begun = not self._has_begun, True
            return "on the floor, motors off" if first else ""
        if self._has_begun and unseen > spec.coast_after:
            self.phase = "landed"
            return f"no start: no pose for {unseen:.2f} s"
        self.phase = "flying"
        return "off the floor" if self._has_begun else "in the air from the start"

    def _trouble(self, now: int, unseen: float, estimate: Estimate | None) -> str:
        """Return the reason to land, empty for none."""
        spec = self._spec
        if unseen > spec.land_after:
            return f"no pose for {unseen:.2f} s"
        unsolved = 1e-9 * (now - self._solved_at)
        if unsolved > spec.solver_timeout:
            self._has_solver = False
            return f"no control problem solved for {unsolved:.2f} s"
        if self._voltage < spec.low_voltage:
            return f"the battery has {self._voltage:.2f} V left"
        if estimate is None:
            return ""
        x, y, z = estimate.x[:3].tolist()
        if max(abs(x), abs(y)) > spec.half_width or z > spec.height:
            return f"at x {x:.2f}, y {y:.2f}, z {z:.2f} m: the edge of the room is near"
        return ""

    def _watch(self, unseen: float, x: Array) -> str:
        """Flying, coasting or levelling, by the age of the newest pose."""
        spec, before = self._spec, self.phase
        self.phase = "levelling" if unseen > spec.level_after else "coasting" if unseen > spec.coast_after else "flying"
        if self.phase == before:
            return ""
        if self.phase == "levelling":
            self._stop_at(x)
            self._speed = 0.0
        return "the poses are back" if self.phase == "flying" else f"no pose for {unseen:.2f} s"

    def _stop_at(self, x: Array) -> None:
        """Remember the place of a state (8,), and its vertical speed."""
        self._place, self._speed = x[:4].copy(), float(x[6])

    def _has_landed_as_planned(self, now: int, estimate: Estimate | None, plan: Reference) -> bool:
        on_floor = self._spec.floor + 0.002
        # The first row tells nearly always; all of them take a hundredth of a flight.
        is_planned = float(plan.x[0, 2]) <= on_floor and bool((plan.x[:, 2] <= on_floor).all())
        if not is_planned:
            self._standing_since = self._planned_down_since = None
        elif self._planned_down_since is None:
            self._planned_down_since = now
        return is_planned and self._stands(now, estimate, False)

    def _lingers(self, now: int) -> bool:
        """Return whether the plan has come down a while ago; the helicopter has not, or it would be landed."""
        since = self._planned_down_since
        return since is not None and now - since >= nanoseconds(self._spec.linger)

    def _stands(self, now: int, estimate: Estimate | None, is_blind: bool) -> bool:
        """Return whether it has been on the floor for a while or, without poses, whether the descent has ended."""
        spec = self._spec
        stands = is_blind and float(self._place[2]) <= self._descent.bottom
        if estimate is not None and not is_blind:
            stands = float(estimate.x[2]) < spec.floor + 0.02 and abs(float(estimate.x[6])) < 0.15
        if not stands:
            self._standing_since = None
        elif self._standing_since is None:
            self._standing_since = now
        wait = nanoseconds(spec.press if is_blind else spec.settle)
        return self._standing_since is not None and now - self._standing_since >= wait

    def _way_down(self, now: int, estimate: Estimate | None, plan: Reference) -> Order:
        """Hover where it stopped or, landing, descend from there; without a solver or an estimate, level.

        A law that does not optimise looks at the present only and would hit the floor: here its thrust is decided. So
        is that of every law in a blind descent, for the estimated height is that of a model without heave damping.
        """
        is_blind = estimate is None or 1e-9 * (now - estimate.pose_stamp) > self._spec.coast_after
        # To the floor: the first poses after a blind fall leave its speed uncertain, and there is no time to find it.
        self._fell_blind |= is_blind and self.phase == "landing"
        is_blind |= self._fell_blind
        reference = self._held(plan)
        if self.phase == "landing":
            descent = self._descent if is_blind else self._seen_descent
            reference = descend(reference, self._model, descent, self._speed, self._period)
            self._place[2], self._speed = reference.x[1, 2], float(reference.x[1, 6])
        self._has_solver &= 1e-9 * (now - self._solved_at) <= self._spec.solver_timeout
        law_decides = self.phase == "levelling" or (self._optimises and not is_blind)
        if estimate is not None and self._has_solver and law_decides:
            return Order(reference)
        u = np.array(self._model.u_hover)
        is_down = reference.x[0, 2] <= self._spec.floor
        u[2] = PRESSING * u[2] if is_blind and is_down else reference.u[0, 2]
        if is_blind and estimate is not None:
            u[2] -= float(estimate.disturbance[2]) / self._model.b_z
        elif estimate is not None:
            # Critically damped at 3 rad/s.
            z, speed = reference.x[0, 2] - estimate.x[2], reference.x[0, 6] - estimate.x[6]
            u[2] += float(9.0 * z + 6.0 * speed) / self._model.b_z
        u = np.clip(u, self._model.u_min, self._model.u_max)
        if estimate is not None and self._has_solver:
            return Order(reference, thrust=float(u[2]))
        return Order(command=Command(now, u))

    def _held(self, plan: Reference) -> Reference:
        """Return the place in the plane where it stops, or the plan there, at the height that it has come down to."""
        if not self.lands_on_plan:
            return hold(self._model, plan.stamp, len(plan.u), self._place)
        x, u = plan.x.copy(), plan.u.copy()
        x[:, 2], x[:, 6], u[:, 2] = self._place[2], 0.0, self._model.u_hover[2]
        return Reference(plan.stamp, x, u)

    def _on_the_floor(self, now: int) -> Command:
        """Start the motors, or stop them.

        On the floor four fifths of hover thrust do not lift it: ground effect adds an eighth.
        """
        lifts = self._model.u_hover[2]
        step = self._period / self._spec.spool * lifts
        is_ready = self.phase == "ready"
        thrust = min(self._thrust + step, 0.8 * lifts) if is_ready else max(self._thrust - step, 0.0)
        return Command(now, np.array([0.0, 0.0, thrust, 0.0]))
