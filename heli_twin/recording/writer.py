"""The recorder: writes every signal of a flight to one MCAP file while it is flown."""

import hashlib
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any, Self

import numpy as np

from controllers.signals import NX, Array, Command, Estimate, Plan, Pose, QpReport, Reference
from heli_twin.lab.plant import Air, Battery, Truth
from heli_twin.lab.plant.shape import Primitive
from heli_twin.recording.derived_topics import Timed, Viewers, timestamp
from heli_twin.recording.foxglove import LogMessage
from heli_twin.recording.growing_file import LogFile
from heli_twin.recording.log import ORIGIN_KEY, Attachment, Log, OutcomeKind
from heli_twin.recording.mcap_stream import McapStream
from heli_twin.recording.packing import Layout
from heli_twin.recording.reader import read_log
from heli_twin.recording.schema import (
    EXPERIMENT,
    FORMAT,
    LAYOUTS,
    PLAN_STATES,
    PROTO,
    QP_STATUS,
    SEVERITIES,
    TIMING,
    TOPICS,
    LogError,
    Severity,
    code,
    extra_estimate_layout,
    extra_plan_layout,
    plan_layout,
    proto,
    sealed,
)
from heli_twin.whole_file import uninterrupted

FLUSH_PERIOD_NS = 500_000_000
"""Simulated time between two writes to the file: a crash loses no more than this."""
CHUNK_SIZE = 256 * 1024
"""Largest chunk, bytes."""

LIBRARY = "heli_twin"
"""Name of the writing program in the file's header."""

Listener = Callable[[str, int, bytes], None]
"""Called with the topic, log time (ns) and bytes of every message, at every flush; must neither block nor raise."""


class Recorder:
    """Writes one flight, with one method for each topic; the first argument is the simulated time in ns.

    Arrays that are handed over must not change afterwards: they are packed at the next flush, which takes half the time
    of packing them between two control steps, where the processor's caches hold other data.

    Every flight is recorded, without a path in memory, so that metrics always come from a log. The file is called
    `NAME.mcap.part` until `close`. If it cannot be written any more, the log goes on in memory, `path` becomes None and
    `trouble` gives the reason; the flight, its digest and its metrics stay the same.

    When its `with` block raises, an aborted flight is closed and kept; an import or a resolve is removed.
    """

    def __init__(
        self,
        path: Path | None = None,
        *,
        experiment: str = "{}",
        metadata: Mapping[str, str] | None = None,
        attachments: Sequence[Attachment] = (),
        listeners: Sequence[Listener] = (),
        shape: Sequence[Primitive] = (),
    ) -> None:
        """Open the log and write the experiment, the metadata and the attachments.

        Args:
            path: Path of the finished log, `.../NAME.mcap`; None keeps it in memory.
            experiment: The experiment as canonical JSON.
            metadata: Facts that do not determine the flight: versions, platform, commit, wall-clock start.
            attachments: Files to keep with the flight.
            listeners: Called with every message.
            shape: The drawn shape of the helicopter; empty for the mCX2.

        Raises:
            LogError: The file exists already or cannot be written.
        """
        self.listeners = listeners
        self._closed = False
        self._is_flight = ORIGIN_KEY not in (metadata or {})
        self._time = 0
        self._flush_due = FLUSH_PERIOD_NS
        self._hash = hashlib.sha256(experiment.encode())
        self._waiting: list[tuple[str, int, Iterable[Any] | bytes]] = []
        """Not packed yet: topic, time, and values or the whole message."""
        self._measured: list[tuple[int, tuple[int, int]]] = []
        """Not packed yet, of the topic that is not hashed: time and values."""
        self._file: LogFile | BytesIO = BytesIO() if path is None else LogFile(path, lambda: self._time)
        self._mcap = McapStream(self._file, library=LIBRARY, chunk_size=CHUNK_SIZE)
        self._mcap.metadata("heli_twin", {"format": str(FORMAT)})
        self._mcap.metadata("run", sealed(metadata or {}))
        flown = Attachment(EXPERIMENT, "application/json", experiment.encode())
        for attachment in (flown, Attachment(PROTO.name, "text/plain", proto()), *attachments):
            self._mcap.attachment(*attachment)
        if isinstance(self._file, LogFile) and self._file.trouble:
            self._file.discard()
            raise LogError(f"the log {path} cannot be written: make room or record to another folder")
        self._channels = {topic.name: self._mcap.channel(*topic) for topic in TOPICS}
        self._layouts = dict(LAYOUTS)
        self._viewers = Viewers(shape)
        self._hash.update(self._write([self._viewers.description()]))

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

    @property
    def digest(self) -> str:
        """SHA-256 of the experiment and every message so far but the measured times."""
        self._pack_waiting()
        return self._hash.hexdigest()

    @uninterrupted()
    def close(self, outcome: OutcomeKind, t: int, text: str = "", error: str = "") -> None:
        """Write how the flight ended and give the file its name; later calls do nothing.

        Args:
            outcome: How the flight ended.
            t: Simulated end, ns.
            text: The same in one sentence.
            error: The exception that aborted the flight.
        """
        if self._closed:
            return
        self._closed = True
        self._flush()
        digest = "" if outcome == "invalid" else self.digest
        ending = {"outcome": outcome, "time": str(t), "digest": digest, "text": text, "error": error}
        self._mcap.metadata("end", sealed({key: value for key, value in ending.items() if value}))
        self._mcap.finish()
        if isinstance(self._file, LogFile):
            self._file.finish()

    @property
    def path(self) -> Path | None:
        """The path of the log, finished or not; None if it is in memory only."""
        return self._file.path if isinstance(self._file, LogFile) and self._file.memory is None else None

    @property
    def trouble(self) -> str:
        """The reason why a requested file cannot be written, one sentence; else empty."""
        return self._file.trouble if isinstance(self._file, LogFile) else ""

    @property
    def stream(self) -> BytesIO | None:
        """The log in memory; None if it is in a file."""
        return self._file.memory if isinstance(self._file, LogFile) else self._file

    def log(self) -> Log:
        """The finished log, read back."""
        return read_log(self.path or self.stream or BytesIO())

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: object) -> None:
        if self._closed:
            return
        if error is not None and not self._is_flight:
            self._closed = True
            if isinstance(self._file, LogFile):
                self._file.discard()
            return
        self.close("aborted", self._time, error=repr(error) if error else "")
        if error is not None and self.path is not None:
            error.add_note(f"the log until then is {self.path}")

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
            self._flush()
        self._waiting.append((topic, t, values))
        self._time = t

    @uninterrupted()
    def _flush(self) -> None:
        self._pack_waiting()
        self._mcap.flush()

    def _pack_waiting(self) -> None:
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
        self._write([(TIMING, t, data) for (t, _), data in zip(measured, times, strict=True)])
        self._hash.update(self._write(messages))
        self._hash.update(self._write([*self._viewers.messages(messages)]))

    def _write(self, messages: Sequence[Timed]) -> bytes:
        """Write messages to the file, pass them to the listeners, and return their bytes in the file."""
        channels = self._channels
        written = self._mcap.messages([(channels[topic], t, data) for topic, t, data in messages])
        for listener in self.listeners:
            for message in messages:
                listener(*message)
        return b"".join(written)
