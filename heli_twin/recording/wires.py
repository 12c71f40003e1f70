"""The wires of one helicopter: a method for each topic, whose values become messages at every flush."""

from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from controllers.signals import NX, Array, Command, Estimate, Plan, Pose, QpReport, Reference
from heli_twin.lab.plant import Air, Battery, Truth
from heli_twin.lab.plant.shape import Primitive
from heli_twin.recording.derived_topics import Timed, Viewers, timestamp
from heli_twin.recording.foxglove import LogMessage
from heli_twin.recording.packing import Layout
from heli_twin.recording.schema import (
    LAYOUTS,
    PLAN_STATES,
    QP_STATUS,
    SEVERITIES,
    TIMING,
    LogError,
    Severity,
    code,
    extra_estimate_layout,
    extra_plan_layout,
    plan_layout,
)
from heli_twin.whole_file import uninterrupted

FLUSH_PERIOD_NS = 500_000_000
"""Simulated time between two writes to the file: a crash loses no more than this."""


class Sink(NamedTuple):
    """Where the messages of a helicopter go."""

    write: Callable[[Sequence[Timed]], bytes]
    """Takes messages and returns their bytes in the file."""
    digest: Callable[[bytes], None]
    """Takes the bytes that belong to the digest of the flight."""
    flush: Callable[[], None]
    """Writes out what was taken."""


class Wires:
    """Records the signals of one helicopter; the first argument of each method is the simulated time in ns.

    Arrays that are handed over must not change afterwards: they are packed at the next flush, which takes half the time
    of packing them between two control steps, where the processor's caches hold other data.
    """

    def __init__(self, sink: Sink, shape: Sequence[Primitive] = (), name: str = "") -> None:
        """Begin with the description of the helicopter.

        Args:
            sink: Takes the messages.
            shape: The drawn shape of the helicopter; empty for the mCX2.
            name: Of the helicopter, if it is one of several.
        """
        self._to = sink
        self.time = 0
        """Of the newest signal, ns."""
        self._flush_due = FLUSH_PERIOD_NS
        self._waiting: list[tuple[str, int, Iterable[Any] | bytes]] = []
        """Not packed yet: topic, time, and values or the whole message."""
        self._measured: list[tuple[int, tuple[int, int]]] = []
        """Not packed yet, of the topic that is not hashed: time and values."""
        self._layouts = dict(LAYOUTS)
        self._viewers = Viewers(shape, name)
        sink.digest(sink.write([self._viewers.description()]))

    def truth(self, t: int, truth: Truth) -> None:
        """Record the true state of the helicopter."""
        self._put("/truth", t, truth)

    def pose(self, t: int, pose: Pose) -> None:
        """Record a pose of the motion capture, at its arrival."""
        self._put("/mocap/pose", t, pose)

    def estimate(self, t: int, estimate: Estimate) -> None:
        """Record the estimate."""
        self._put("/estimate", t, estimate[:6])
        count = len(estimate.extra)
        if count:
            variance = estimate.extra_variance if len(estimate.extra_variance) else np.full(count, np.nan)
            self._lay_out("/estimate_extra", extra_estimate_layout(count))
            self._put("/estimate_extra", t, (estimate.stamp, estimate.extra, variance))

    def reference(self, t: int, reference: Reference) -> None:
        """Record the first row of the planned flight."""
        self._put("/reference", t, (reference.stamp, reference.x[0], reference.u[0]))

    def reference_path(self, t: int, points: Array) -> None:
        """Record the whole reference path, (n, 3) world, m, for viewers; again when it changes."""
        self._put(*self._viewers.reference_path(t, points))

    def sent(self, t: int, command: Command) -> None:
        """Record the input that the controller sends; its plan and report have their own topics."""
        self._put("/command/sent", t, command[:2])

    def acting(self, t: int, u: Array, stamp: int = -1) -> None:
        """Record the input (4,) in force at the helicopter from now on; `stamp` is -1 if no controller decided it."""
        self._put("/command/acting", t, (stamp, u))

    def plan(self, t: int, plan: Plan) -> None:
        """Record the controller's plan; the horizon stays the same within a flight."""
        if self._viewers.plan is None:
            self._viewers.plan = self._layouts["/mpc/plan"] = plan_layout(len(plan.u))
        x = plan.x
        if x.shape[1] == NX:
            x = np.column_stack([x, np.zeros((len(x), PLAN_STATES - NX))])
        self._put("/mpc/plan", t, (x, plan.u, plan.u_nominal))
        if plan.extra is not None and plan.extra.size:
            self._lay_out("/mpc/plan_extra", extra_plan_layout(*plan.extra.shape))
            self._put("/mpc/plan_extra", t, (plan.extra,))

    def qp(self, t: int, report: QpReport) -> None:
        """Record how the control problem was solved."""
        self._put("/mpc/qp", t, (code(QP_STATUS, report.status, "QP status"), *report[1:]))

    def disturbance(self, t: int, air: Air) -> None:
        """Record the wind and other disturbances from now on."""
        self._put("/disturbance", t, air[:3])
        if air.moment is not None:
            self._put("/disturbance_moment", t, (air.moment,))

    def battery(self, t: int, battery: Battery) -> None:
        """Record the state of the battery."""
        self._put("/battery", t, battery)

    def event(self, t: int, severity: Severity, name: str, text: str) -> None:
        """Record something that a person wants to know."""
        level: Any = code(SEVERITIES, severity, "severity")
        message = LogMessage(timestamp=timestamp(t), level=level, name=name, message=text)
        self._put("/events", t, message.SerializeToString())

    def timing(self, t: int, control_step_ns: int, solve_ns: int) -> None:
        """Record measured times; the only message that is not part of the digest."""
        self._measured.append((t, (control_step_ns, solve_ns)))

    def _lay_out(self, topic: str, layout: Layout) -> None:
        """Take the layout of a topic from its first message.

        Raises:
            LogError: A later message has another number of states.
        """
        if self._layouts.setdefault(topic, layout) is not layout:
            raise LogError(f"the number of states on {topic} changes within the flight: give all of them each time")

    def _put(self, topic: str, t: int, values: Iterable[Any] | bytes) -> None:
        if t >= self._flush_due:
            self._flush_due = (t // FLUSH_PERIOD_NS + 1) * FLUSH_PERIOD_NS
            self.flush()
        self._waiting.append((topic, t, values))
        self.time = t

    @uninterrupted()
    def flush(self) -> None:
        """Write out all signals so far."""
        self.pack_waiting()
        self._to.flush()

    def pack_waiting(self) -> None:
        """Hand all signals so far to the file."""
        waiting, self._waiting = self._waiting, []
        rows = defaultdict[str, list[Iterable[Any]]](list)
        for topic, _, values in waiting:
            if type(values) is not bytes:
                rows[topic].append(values)
        # A number beyond the range of float32 becomes infinite.
        with np.errstate(over="ignore"):
            packed = {topic: iter(self._layouts[topic].pack(values)) for topic, values in rows.items()}
        messages = [
            (topic, t, values if type(values) is bytes else next(packed[topic])) for topic, t, values in waiting
        ]
        measured, self._measured = self._measured, []
        times = self._layouts[TIMING].pack([values for _, values in measured]) if measured else []
        self._to.write([(TIMING, t, data) for (t, _), data in zip(measured, times, strict=True)])
        self._to.digest(self._to.write(messages))
        self._to.digest(self._to.write([*self._viewers.messages(messages)]))
