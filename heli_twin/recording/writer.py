"""The recorder: writes every signal of a flight to one MCAP file while it is flown."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Self

from heli_twin.lab.plant.shape import Primitive
from heli_twin.recording.derived_topics import Timed
from heli_twin.recording.growing_file import LogFile
from heli_twin.recording.log import Log
from heli_twin.recording.mcap_stream import McapStream
from heli_twin.recording.reader import read_log
from heli_twin.recording.records import ORIGIN_KEY, Attachment, OutcomeKind
from heli_twin.recording.schema import (
    EXPERIMENT,
    FORMAT,
    FORMAT_OF_ONE,
    PROTO,
    SHIPS,
    LogError,
    proto,
    sealed,
    topics_of,
)
from heli_twin.recording.wires import Sink, Wires
from heli_twin.whole_file import uninterrupted

CHUNK_SIZE = 256 * 1024
"""Largest chunk, bytes."""

LIBRARY = "heli_twin"
"""Name of the writing program in the file's header."""

Listener = Callable[[str, int, bytes], None]
"""Called with the topic, log time (ns) and bytes of every message, at every flush; must neither block nor raise."""


class LogWriter:
    """The file that a log is written to, and what stands in it beside the messages.

    Every flight is recorded, without a path in memory, so that metrics always come from a log. The file is called
    `NAME.mcap.part` until `close`. If it cannot be written any more, the log goes on in memory, `path` becomes None and
    `trouble` gives the reason; the flight, its digest and its metrics stay the same.

    When its `with` block raises, an aborted flight is closed and kept; an import or a resolve is removed.
    """

    def __init__(
        self,
        path: Path | None,
        experiment: str,
        metadata: Mapping[str, str],
        attachments: Sequence[Attachment],
        ships: Sequence[str] = (),
    ) -> None:
        """Open the log and write the experiment, the metadata and the attachments.

        Args:
            path: Path of the finished log, `.../NAME.mcap`; None keeps it in memory.
            experiment: The experiment as canonical JSON.
            metadata: Facts that do not determine the flight.
            attachments: Files to keep with the flight.
            ships: Names of several helicopters; empty for a log of one.

        Raises:
            LogError: The file exists already or cannot be written.
        """
        self.listeners: Sequence[Listener] = ()
        self._wires: list[Wires] = []
        self._closed = False
        self._is_flight = ORIGIN_KEY not in metadata
        self._hash = hashlib.sha256(experiment.encode())
        self._file: LogFile | BytesIO = BytesIO() if path is None else LogFile(path, lambda: self._newest)
        self._mcap = McapStream(self._file, library=LIBRARY, chunk_size=CHUNK_SIZE)
        identity = {"format": str(FORMAT), SHIPS: ",".join(ships)} if ships else {"format": str(FORMAT_OF_ONE)}
        self._mcap.metadata("heli_twin", identity)
        self._mcap.metadata("run", sealed(metadata))
        flown = Attachment(EXPERIMENT, "application/json", experiment.encode())
        for attachment in (flown, Attachment(PROTO.name, "text/plain", proto()), *attachments):
            self._mcap.attachment(*attachment)
        if isinstance(self._file, LogFile) and self._file.trouble:
            self._file.discard()
            raise LogError(f"the log {path} cannot be written: make room or record to another folder")
        self._channels = {topic.name: self._mcap.channel(*topic) for topic in topics_of(ships)}

    @property
    def digest(self) -> str:
        """SHA-256 of the experiment and every message so far but the measured times."""
        for wires in self._wires:
            wires.pack_waiting()
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
        for wires in self._wires:
            wires.flush()
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
        self.close("aborted", self._newest, error=repr(error) if error else "")
        if error is not None and self.path is not None:
            error.add_note(f"the log until then is {self.path}")

    @property
    def _newest(self) -> int:
        """Time of the newest signal, ns."""
        return max((wires.time for wires in self._wires), default=0)

    def _sink(self, prefix: str = "") -> Sink:
        return Sink(partial(self._write, prefix), self._hash.update, self._mcap.flush)

    def _write(self, prefix: str, messages: Sequence[Timed]) -> bytes:
        """Write messages to the file, pass them to the listeners, and return their bytes in the file."""
        if prefix:
            messages = [(prefix + topic, t, data) for topic, t, data in messages]
        channels = self._channels
        written = self._mcap.messages([(channels[topic], t, data) for topic, t, data in messages])
        for listener in self.listeners:
            for message in messages:
                listener(*message)
        return written


class Recorder(LogWriter, Wires):
    """Writes one flight to a log, with one method for each topic."""

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
        LogWriter.__init__(self, path, experiment, metadata or {}, attachments)
        self.listeners, self._wires = listeners, [self]
        Wires.__init__(self, self._sink(), shape)
