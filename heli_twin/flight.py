"""One flight: the experiment becomes a helicopter, a lab and a ground station, and time runs. Read this first."""

import sys
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from math import cos, isfinite, radians
from operator import itemgetter
from time import perf_counter_ns
from typing import NamedTuple

import numpy as np
from threadpoolctl import ThreadpoolController

from controllers.errors import LawFailed
from controllers.fallback import safe_hover
from controllers.laws import closed_after, flat_derivatives, preview_of
from controllers.markers import by_name
from controllers.reference import BLOCK_SAMPLES, ReferencePreview, with_flat
from controllers.signals import Array, Command, Estimate, Reference, nanoseconds
from controllers.trajectories import Trajectory
from heli_twin.experiment import Experiment, Volume
from heli_twin.lab import disturbances
from heli_twin.lab.chance import Chance, generator, mixed
from heli_twin.lab.disturbances import ALONE, air_of, together
from heli_twin.lab.faults import Faults
from heli_twin.lab.mocap import Arrival
from heli_twin.lab.plant import Air, FeelsMoments, Plant, Truth
from heli_twin.lab.radio import Held
from heli_twin.recording import OutcomeKind
from heli_twin.recording.wires import Wires

INTACT = ("completed", "landed")
"""Outcomes after which the helicopter can fly again."""
INVALID = "invalid"
"""Outcome of a run that says nothing about its controller, since the controller's own process failed."""


class Outcome(NamedTuple):
    """The end of a flight: data, not an exception."""

    kind: OutcomeKind
    time: int
    """When, ns."""
    text: str
    """One sentence."""


@contextmanager
def reproducible() -> Generator[None]:
    """Compute the same on every host while the block runs.

    More threads add numbers in another order. Overflow gives non-finite numbers: the ground station then sends a safe
    hover, and a helicopter whose state is non-finite has diverged.
    """
    with _libraries(len(sys.modules)).limit(limits=1), np.errstate(all="ignore"):
        yield


@lru_cache(1)
def _libraries(modules: int) -> ThreadpoolController:
    """The numerical libraries that are loaded; looked for again when another module is."""
    return ThreadpoolController()


class Flight:
    """The lab and the ground station of one experiment, wired together; it flies once.

    Everything random draws from a generator of its own, time is integer nanoseconds, and between two events the
    plant flies on by whole physics steps: neither the host nor its speed changes a flight.

    Args:
        experiment: What to fly.
        plant: The helicopter, at the start of the trajectory.
        recorder: Takes what crosses the wires.
        progress: Told the simulated time, s, at every control step.
        chance: Source of every random number in place of the experiment's; it is then a flight of no experiment.
    """

    def __init__(
        self,
        experiment: Experiment,
        plant: Plant,
        recorder: Wires,
        progress: Callable[[float], None] = lambda t: None,
        chance: Chance | None = None,
    ) -> None:
        e = experiment
        chance = chance or (mixed(e.noise) if e.noise else generator)
        self.experiment, self.plant, self.recorder, self.progress = e, plant, recorder, progress
        self.step, self.period = nanoseconds(e.plant.step), nanoseconds(e.controller.period)
        self.end = self.on_grid(nanoseconds(e.duration))
        self.mocap = e.mocap.start(chance(e.seed, "mocap"))
        self.radio = e.radio.start(chance(e.seed, "radio"))
        self.surroundings = [
            air_of(d.start(chance(e.seed, name if name == d.kind else f"disturbances.{name}")))
            for name, d in by_name(e.disturbances).items()
        ]
        faults = by_name(e.faults).items()
        self.faults = Faults(fault.hooks(chance(e.seed, f"faults.{name}")) for name, fault in faults)
        self.compute_chance = chance(e.seed, "compute")
        self.estimator, self.controller = e.estimator.start(e.controller.model), e.controller.start()
        self.supervisor = e.supervisor.start(e.controller.model, e.controller.period)
        self.lead = nanoseconds(e.estimator.lead)
        self.model, self.derivatives = e.controller.model, flat_derivatives(e.controller)
        self.follow(e.trajectory)
        self.now = self.control_due = self.air_due = 0
        self.held, self.air_now = Held(-1, plant.truth().actuators), together([])
        self.estimate: Estimate | None = None
        """The newest."""
        self.others: Array = ALONE
        """(n, 3) positions of other helicopters in the room, world, m."""
        self.neighbours: Sequence[Truth] = ()
        """Their states when all were at the same time last: 20 ms ago at most."""
        self.poses_under_way: list[Arrival] = []
        self.last_status, self.last_rejected, self.told_of_moments = "", 0, False
        self.reason, self.landed_at, self.last_sink, self.in_the_air = "", 0, 0.0, False
        recorder.acting(self.now, self.held.u, self.held.stamp)

    def run(self) -> Outcome:
        """Fly to the end of the experiment, or until the flight is over."""
        with reproducible(), closed_after(self.controller):
            try:
                outcome = self.advance(self.end + 1)
            except LawFailed as error:
                return Outcome(INVALID, error.time, str(error))
        assert outcome is not None
        return outcome

    def follow(self, trajectory: Trajectory, samples: int = BLOCK_SAMPLES) -> None:
        """Fly by a plan from the next control step on.

        Args:
            trajectory: The plan.
            samples: How many are made at once.
        """
        self.trajectory = trajectory
        self.preview = preview_of(self.experiment.controller, trajectory, self.period, self.lead, samples)
        self.planned = ReferencePreview(trajectory, self.model, self.period, 0, samples=samples)

    def advance(self, until: int) -> Outcome | None:
        """Fly on to a physics step `until`, ns; what is due then is left to the next call.

        Returns:
            How the flight ended, None if it goes on. It ends at `end` at the latest.
        """
        while self.now < until:
            outcome = self.tick(self.now)
            if outcome is not None:
                return outcome
            self.coast(until)
        return None

    def tick(self, t: int) -> Outcome | None:
        """Do all that is due at time t, ns; return the outcome if the flight is over."""
        plant, radio, faults = self.plant, self.radio, self.faults
        if t >= self.air_due:
            self.air_now = self.air(t, plant.truth())
            if battery := faults.battery(t, plant.battery()):
                self.recorder.battery(t, battery)
                self.supervisor.battery(battery.voltage)
            self.air_due += disturbances.PERIOD_NS
        if t >= self.mocap.due:
            self.look(t, plant.truth())
        if t >= self.control_due or t == self.end:
            outcome = self.judge(t, plant.truth())
            if outcome is not None:
                return outcome
            command = self.control(t)
            latency = self.experiment.compute.latency_ns(self.compute_chance)
            for at, sent in faults.commands(t, latency, command):
                radio.send(at, sent)
            self.control_due += self.period
            self.progress(1e-9 * t)
        if t >= radio.due and (received := faults.received(t, radio.receive(t))):
            self.held = received
            self.recorder.acting(t, received.u, received.stamp)
        return None

    def coast(self, until: int) -> None:
        """Fly on by whole physics steps until something is due, but not beyond `until`, ns."""
        u = self.faults.input(self.now, self.held.u, self.plant)
        due = min(self.control_due, self.air_due, self.mocap.due, self.radio.due, self.end)
        self.now = self.on_grid(min(due, until))
        self.plant.advance(self.now, u, self.air_now)

    def air(self, t: int, truth: Truth) -> Air:
        """Return what the surroundings do until the next update."""
        air = together([of(truth, self.others) for of in self.surroundings])
        self.recorder.disturbance(t, air)
        if air.moment is not None and not self.told_of_moments and not isinstance(self.plant, FeelsMoments):
            self.told_of_moments = True
            self.recorder.event(
                t, "warning", "moment", "a disturbance gives a moment, which does not act on this plant"
            )
        return air

    def look(self, t: int, truth: Truth) -> None:
        """Let the cameras look; the pose is on its way unless the frame or a fault loses it."""
        arrival = self.faults.pose(self.mocap.capture(t, self.faults.seen(t, truth, self.neighbours)))
        if arrival:
            self.poses_under_way.append(arrival)

    def control(self, t: int) -> Command:
        """Run one step of the ground station: feed it the poses that have arrived and return its command."""
        arrived = [a for a in self.poses_under_way if a.at <= t]
        if arrived:
            self.poses_under_way = [a for a in self.poses_under_way if a.at > t]
            arrived.sort(key=_AT)
        for at, pose in arrived:
            self.recorder.pose(at, pose)
            self.estimator.receive(at, pose)
        estimate = self.estimate = self.faults.estimate(t, self.estimator.estimate(t))
        plan = self.preview(estimate.stamp if estimate else t + self.lead, self.experiment.controller.steps)
        order, took = self.supervisor.order(t, estimate, plan), 0
        if order.event:
            self.recorder.event(t, order.event.severity, order.event.phase, order.event.reason)
            if order.event.phase == "landing" or not self.reason:
                self.reason = order.event.reason
        if order.command:
            command = order.command
        elif estimate and order.reference:
            began = perf_counter_ns()
            command = self.controller.step(t, estimate, with_flat(order.reference, self.model, self.derivatives))
            took = perf_counter_ns() - began
            command = order.applied(self.controller.explain(command))
            if self.supervisor.phase == "flying":
                command = self.experiment.excitation.excited(t, command, self.experiment.controller.model)
        else:
            command = safe_hover(self.experiment.controller.model, t)
        self.estimator.command_sent(t, command.u)
        self.supervisor.sent(command)
        self.record(t, estimate, command, took)
        return command

    def record(self, t: int, estimate: Estimate | None, command: Command, took_ns: int) -> None:
        """Record everything that crossed the wires of the ground station in this step."""
        recorder = self.recorder
        if estimate is not None:
            recorder.estimate(t, estimate)
            if estimate.rejected != self.last_rejected:
                self.last_rejected = estimate.rejected
                recorder.event(t, "warning", "pose_rejected", f"{estimate.rejected} poses refused so far")
        recorder.sent(t, command)
        if command.plan is not None:
            recorder.plan(t, command.plan)
        if command.qp is not None:
            recorder.qp(t, command.qp)
            if command.qp.status != self.last_status:
                self.last_status = command.qp.status
                severity = "info" if command.qp.status == "solved" else "warning"
                recorder.event(t, severity, "qp", f"control problems are now {command.qp.status}")
        recorder.timing(t, took_ns, command.solve_ns)

    def judge(self, t: int, truth: Truth) -> Outcome | None:
        """Record where the helicopter is and where it should be; return the outcome if the flight is over."""
        planned = self.show(t, truth)
        may_touch = self.supervisor.phase in ("ready", "landing", "landed")
        outcome = verdict(t, truth, 0.0 if may_touch else float(planned.x[0, 2]), self.experiment.volume)
        outcome = outcome or self.landed(t, truth)
        if outcome is None and t == self.end:
            outcome = Outcome("completed", t, f"flew the whole {1e-9 * t:g} s")
        # Of a landing, the supervisor has told already.
        if outcome is not None and outcome.kind != "landed":
            severity = "info" if outcome.kind == "completed" else "error"
            self.recorder.event(t, severity, outcome.kind, outcome.text)
        return outcome

    def show(self, t: int, truth: Truth) -> Reference:
        """Record where the helicopter is and where it should be."""
        of_now = self.planned
        if t % self.period:
            # A flight may end between two control steps.
            of_now = ReferencePreview(self.trajectory, self.model, self.period, t, samples=0)
        planned = of_now(t, 1)
        self.recorder.reference(t, planned)
        self.recorder.truth(t, truth)
        return planned

    def landed(self, t: int, truth: Truth) -> Outcome | None:
        """Record a touch-down; the flight is over when it was too hard, and when the motors have stopped."""
        speed, self.last_sink = self.last_sink, max(0.0, -float(truth.velocity[2]))
        was_in_the_air, self.in_the_air = self.in_the_air, not truth.touching
        phase = self.supervisor.phase
        if phase in ("landing", "landed") and was_in_the_air and truth.touching:
            self.recorder.event(t, "info", "touch_down", f"touched the floor at {speed:.2f} m/s")
            if speed > HARD_LANDING_M_S:
                return Outcome("crashed", t, f"hit the floor at {1e-9 * t:.2f} s, at {speed:.2f} m/s")
        if phase != "landed":
            self.landed_at = t
        elif t == self.end or t - self.landed_at >= REST_NS:
            return Outcome("landed", t, f"landed at {1e-9 * self.landed_at:.2f} s: {self.reason}")
        return None

    def on_grid(self, time: int) -> int:
        """The first physics step at or after `time` (ns)."""
        return -(-time // self.step) * self.step


def verdict(t: int, truth: Truth, planned_height: float, volume: Volume) -> Outcome | None:
    """Return how a flight has gone wrong; None if it has not.

    Args:
        t: ns.
        truth: The helicopter.
        planned_height: Where it should be above the floor, m.
        volume: Where the flight may go.
    """
    seconds = 1e-9 * t
    x, y, z = truth.position.tolist()
    qw, qx, qy, qz = truth.quat_wxyz.tolist()
    if not all(map(isfinite, (x, y, z, qw, qx, qy, qz, *truth.velocity.tolist()))):
        return Outcome("diverged", t, f"the simulated state became non-finite at {seconds:.2f} s")
    if truth.touching and planned_height > FLOOR_MARGIN_M:
        return Outcome("crashed", t, f"hit the floor at {seconds:.2f} s, {planned_height:.2f} m below its plan")
    if max(abs(x), abs(y)) > volume.half_width or z > volume.height:
        return Outcome("left_volume", t, f"left the volume at {seconds:.2f} s, at x {x:.2f}, y {y:.2f}, z {z:.2f} m")
    if 1.0 - 2.0 * (qx * qx + qy * qy) < TIPPED_COS:
        where = "on the floor" if truth.touching else "in the air"
        return Outcome("crashed" if truth.touching else "diverged", t, f"tipped over {where} at {seconds:.2f} s")
    return None


_AT = itemgetter(0)
TIPPED_COS = cos(radians(45.0))
"""Cosine of the tilt at which a flight is over: full stick tilts by 12 degrees; on its side it lies at 56 degrees."""
HARD_LANDING_M_S = 1.0
"""Speed of a touch-down that breaks something: a fall from 5 cm."""
REST_NS = 1_000_000_000
"""Duration of the record after the landing."""
FLOOR_MARGIN_M = 0.15
"""A plan below this height may touch the floor; the skids hang about 5 cm below the centre of gravity."""
