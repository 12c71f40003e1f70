"""The recorder: every wire of the flight, as it happens, into one MCAP file."""

import hashlib
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any, Self

import numpy as np
from foxglove_schemas_protobuf.Log_pb2 import Log as LogMessage

from controllers.signals import Array, Command, Estimate, Plan, Pose, QpReport, Reference
from heli_twin.lab.plant import Air, Battery, Truth
from heli_twin.recording.derived_topics import Timed, Viewers, timestamp
from heli_twin.recording.growing_file import LogFile
from heli_twin.recording.log import Attachment, Log
from heli_twin.recording.mcap_stream import McapStream
from heli_twin.recording.reader import read_log
from heli_twin.recording.schema import (
    EXPERIMENT,
    FORMAT,
    LAYOUTS,
    PROTO,
    QP_STATUS,
    SEVERITY,
    TIMING,
    TOPICS,
    LogError,
    code,
    plan_layout,
    proto,
    sealed,
)
from heli_twin.whole_file import uninterrupted

FLUSH_PERIOD = 500_000_000
"""Simulated ns between two writes to the file: what a crash can lose."""
CHUNK_SIZE = 256 * 1024
"""Bytes in one chunk at most."""

LIBRARY = "heli_twin"
"""What wrote the file, in its header."""

Listener = Callable[[str, int, bytes], None]
"""Takes the topic, log time (ns) and bytes of every message, at every flush; must neither block nor raise."""


class Recorder:
    """Writes one flight, wire by wire; a method for each, its first argument the simulated time in ns.

    What it is given must not change any more: it is packed at the next flush. Between two control steps, whose
    matrices have pushed everything else out of the processor's caches, the same work would take twice as long.

    A flight always records: without a path into memory, so that metrics come from the same log either way. The file
    is called `NAME.mcap.part` until `close`. If it cannot be written any more the log goes on in memory, `path` becomes
    None and `trouble` says why; the flight, its digest and its metrics are what they would have been.
    """

    def __init__(
        self,
        path: Path | None = None,
        *,
        experiment: str = "{}",
        metadata: Mapping[str, str] | None = None,
        attachments: Sequence[Attachment] = (),
        listeners: Sequence[Listener] = (),
    ) -> None:
        """Open the log and write what is known before the flight.

        Args:
            path: Where the log shall be when the flight is over, `.../NAME.mcap`; None keeps it in memory.
            experiment: What determines the flight, canonical JSON.
            metadata: Versions, platform, commit, wall-clock start: what may differ for the same experiment.
            attachments: Files to keep with the flight.
            listeners: Called with every message.

        Raises:
            LogError: The file exists already or cannot be written.
        """
        self.listeners = listeners
        self._closed = False
        self._time = 0
        self._flush_due = FLUSH_PERIOD
        self._hash = hashlib.sha256(experiment.encode())
        self._waiting: list[tuple[str, int, Iterable[Any] | bytes]] = []
        """Topic, time and values, or the whole message, of what is not packed yet."""
        self._measured: list[tuple[int, tuple[int, int]]] = []
        """Time and values of what is not packed yet of the one topic that is not hashed."""
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
        self._viewers = Viewers()
        self._hash.update(self._write([self._viewers.description()]))

    def truth(self, t: int, truth: Truth) -> None:
        """What the helicopter does."""
        self._put("/truth", t, truth)

    def pose(self, t: int, pose: Pose) -> None:
        """What the motion capture says, at its arrival."""
        self._put("/mocap/pose", t, pose)

    def estimate(self, t: int, estimate: Estimate) -> None:
        """What the estimator believes."""
        self._put("/estimate", t, estimate)

    def reference(self, t: int, reference: Reference) -> None:
        """Where the helicopter should be: the first row of the planned flight."""
        self._put("/reference", t, (reference.stamp, reference.x[0], reference.u[0]))

    def reference_path(self, t: int, points: Array) -> None:
        """The whole path to fly, (n, 3) world, m, for the eye; once, or again when it changes."""
        self._put(*self._viewers.reference_path(t, points))

    def sent(self, t: int, command: Command) -> None:
        """What the controller asks for; its plan and report are wires of their own."""
        self._put("/command/sent", t, command[:2])

    def acting(self, t: int, u: Array, stamp: int = -1) -> None:
        """The input (4,) in force at the helicopter from now on, and when it was decided (-1: by no controller)."""
        self._put("/command/acting", t, (stamp, u))

    def plan(self, t: int, plan: Plan) -> None:
        """What the controller expects; the horizon stays the same within a flight."""
        if self._viewers.plan is None:
            self._viewers.plan = self._layouts["/mpc/plan"] = plan_layout(len(plan.u))
        self._put("/mpc/plan", t, plan)

    def qp(self, t: int, report: QpReport) -> None:
        """How the control problem was solved."""
        self._put("/mpc/qp", t, (code(QP_STATUS, report.status, "QP status"), *report[1:]))

    def disturbance(self, t: int, air: Air) -> None:
        """What the surroundings do to the helicopter until told otherwise."""
        self._put("/disturbance", t, air)

    def battery(self, t: int, battery: Battery) -> None:
        """What the battery gives."""
        self._put("/battery", t, battery)

    def event(self, t: int, severity: str, name: str, text: str) -> None:
        """Something worth telling a person; severity is debug, info, warning, error or fatal."""
        level: Any = code(SEVERITY, severity, "severity")
        message = LogMessage(timestamp=timestamp(t), level=level, name=name, message=text)
        self._put("/events", t, message.SerializeToString())

    def timing(self, t: int, control_step_ns: int, solve_ns: int) -> None:
        """Measured times; the only message that is not part of the digest."""
        self._measured.append((t, (control_step_ns, solve_ns)))

    @property
    def digest(self) -> str:
        """SHA-256 of the experiment and every message so far but the measured times."""
        self._pack_waiting()
        return self._hash.hexdigest()

    @uninterrupted()
    def close(self, outcome: str, t: int, **ending: str) -> None:
        """Write how the flight ended, and when (ns), and give the file its name; later calls do nothing.

        Args:
            outcome: One word: landed, crashed, ...
            t: Simulated end, ns.
            ending: Anything else to keep, such as measured totals.
        """
        if self._closed:
            return
        self._closed = True
        self._flush()
        ends = {"outcome": outcome, "time": str(t), "digest": self.digest, **ending}
        self._mcap.metadata("end", sealed(ends))
        self._mcap.finish()
        if isinstance(self._file, LogFile):
            self._file.finish()

    @property
    def path(self) -> Path | None:
        """Where the log is or will be; None if it is in memory only."""
        return self._file.path if isinstance(self._file, LogFile) and self._file.memory is None else None

    @property
    def trouble(self) -> str:
        """Why there is no file although one was wanted, one sentence; empty if all is well."""
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
        self.close("aborted", self._time, error=repr(error) if error else "")
        if error is not None and self.path is not None:
            error.add_note(f"the log until then is {self.path}")

    def _put(self, topic: str, t: int, values: Iterable[Any] | bytes) -> None:
        if t >= self._flush_due:
            self._flush_due = (t // FLUSH_PERIOD + 1) * FLUSH_PERIOD
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
        # A number that a float32 cannot hold is an infinity there.
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
        """Write messages to the file and tell the listeners; returns them as they stand in the file."""
        channels = self._channels
        written = self._mcap.messages([(channels[topic], t, data) for topic, t, data in messages])
        for listener in self.listeners:
            for message in messages:
                listener(*message)
        return b"".join(written)
