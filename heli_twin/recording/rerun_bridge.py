"""A flight in Rerun: the same picture from a finished log and while it flies.

Only this module and its neighbours `layout`, `style`, `rows`, `comparison` and `viewer` import Rerun, and nothing
imports them before a viewer is asked for. A viewer that is missing, or that dies, costs its pictures and nothing else.
"""

import logging
from contextlib import suppress
from pathlib import Path
from queue import Full, Queue
from threading import Thread
from typing import NamedTuple

import rerun as rr
import rerun.blueprint as rrb

from heli_twin.recording.layout import TIMELINE, Scales, layout
from heli_twin.recording.log import Log, Messages
from heli_twin.recording.rows import Rows, rows
from heli_twin.recording.schema import LogError
from heli_twin.recording.style import send_static
from heli_twin.recording.viewer import listens, spawn, url

APPLICATION = "heli_twin"
SLICE = 500_000_000
"""Simulated ns that are sent at once while flying."""
PATIENCE = 200
"""Slices that wait for a viewer at most: 100 s of flight, about 15 MB."""
FAREWELL = 5.0
"""How long a viewer may take for the rest when the flight is over, s."""

_LOGGER = logging.getLogger(__name__)


class Sink(NamedTuple):
    """Where pictures go: to a file, to a viewer on this machine, or to both."""

    file: Path | None = None
    """`NAME.rrd`."""
    port: int | None = None
    """Of the viewer."""
    spawn: bool = False
    """Whether to start a viewer if none listens."""


def show(log: Log, sink: Sink, scales: Scales) -> None:
    """Show a whole flight.

    Raises:
        LogError: No viewer listens, or the file cannot be written.
    """
    scales = scales.seeing(log)
    stream = open_stream(sink, layout(scales))
    send_static(stream)
    send(stream, log, scales)
    close_stream(stream)


class Live:
    """A listener of the recorder that shows the flight while it lasts, slice by slice.

    Whatever goes wrong with the picture is told once, and the flight goes on. A viewer is served by a thread of its
    own, so that one that hangs does not hold up the flight; what it cannot take in time is left out of the picture.
    A file is written at once.
    """

    def __init__(self, sink: Sink, scales: Scales) -> None:
        """Open the pictures; without a viewer there are none.

        Raises:
            LogError: The file cannot be written.
        """
        self._sink, self._scales = sink, scales
        self._slice: dict[str, tuple[list[int], list[bytes]]] = {}
        self._due = SLICE
        self._told = False
        self._slices: Queue[Log | None] = Queue(PATIENCE)
        self._stream = self._opened() if sink.port is None else None
        self._server = None if sink.port is None else Thread(target=self._serve, daemon=True)
        if sink.spawn and sink.port is not None and not listens(sink.port):
            spawn(sink.port)
        if self._server is not None:
            self._server.start()

    def __call__(self, topic: str, t: int, data: bytes) -> None:
        """Take a message of the flight."""
        if t >= self._due:
            self._due = (t // SLICE + 1) * SLICE
            self._end_slice()
        times, messages = self._slice.setdefault(topic, ([], []))
        times.append(t)
        messages.append(data)

    def close(self) -> None:
        """Show the rest."""
        self._end_slice()
        if self._server is None:
            self._close()
            return
        with suppress(Full):
            self._slices.put(None, timeout=FAREWELL)
        self._server.join(FAREWELL)
        if self._server.is_alive():
            # Otherwise Rerun waits for this viewer when the program ends, for ever.
            rr.unregister_shutdown()
            self._tell("the viewer does not answer: its picture is incomplete")

    def _end_slice(self) -> None:
        taken, self._slice = self._slice, {}
        log = Log({topic: Messages(*columns) for topic, columns in taken.items()})
        if self._server is None:
            self._show(log)
            return
        try:
            self._slices.put_nowait(log)
        except Full:
            self._tell("the viewer is too slow: its picture has gaps")

    def _serve(self) -> None:
        """Show slices until the last; the only one that talks to a viewer."""
        try:
            self._stream = self._opened()
        except Exception:
            _LOGGER.exception("the flight goes on without its picture")
        while (log := self._slices.get()) is not None:
            self._show(log)
        self._close()

    def _opened(self) -> rr.RecordingStream | None:
        stream = _stream(self._sink, layout(self._scales))
        if stream is not None:
            send_static(stream)
        return stream

    def _show(self, log: Log) -> None:
        if self._stream is None:
            return
        try:
            send(self._stream, log, self._scales)
        except Exception:
            _LOGGER.exception("the flight goes on without its picture")
            self._stream = None

    def _close(self) -> None:
        if self._stream is not None:
            close_stream(self._stream)

    def _tell(self, what: str) -> None:
        if not self._told:
            _LOGGER.warning("%s", what)
        self._told = True


def send(stream: rr.RecordingStream, log: Log, scales: Scales, below: str = "") -> None:
    """Send a log or a slice of one, all of it below an entity such as `A/`."""
    for entity, times, columns in rows(log, scales):
        send_rows(stream, (below + entity, times, columns))


def send_rows(stream: rr.RecordingStream, some: Rows) -> None:
    """Send columns unless they are empty."""
    entity, times, columns = some
    if len(times):
        stream.send_columns(entity, [rr.TimeColumn(TIMELINE, duration=times.astype("m8[ns]"))], columns)


def open_stream(sink: Sink, blueprint: rrb.Blueprint) -> rr.RecordingStream:
    """A stream to all of the sink that is there.

    Raises:
        LogError: Nothing is there, or the file cannot be written.
    """
    stream = _stream(sink, blueprint)
    if stream is None:
        raise LogError(f"no viewer listens on port {sink.port}: start one with `rerun --port {sink.port}`")
    return stream


def _stream(sink: Sink, blueprint: rrb.Blueprint) -> rr.RecordingStream | None:
    sinks: list[rr.FileSink | rr.GrpcSink] = []
    if sink.file is not None:
        sinks.append(rr.FileSink(str(sink.file)))
    if sink.port is not None and (listens(sink.port) or (sink.spawn and spawn(sink.port))):
        sinks.append(rr.GrpcSink(url(sink.port)))
    if not sinks:
        return None
    stream = rr.RecordingStream(APPLICATION)
    try:
        stream.set_sinks(*sinks, default_blueprint=blueprint)
    except RuntimeError as error:
        raise LogError(f"pictures cannot be written to {sink.file}: {error}") from error
    return stream


def close_stream(stream: rr.RecordingStream) -> None:
    """Wait until everything is delivered, but not for a viewer that has died."""
    try:
        stream.flush(timeout_sec=5)
    except RuntimeError as error:
        _LOGGER.warning("the viewer is gone, its picture is incomplete: %s", error)
    stream.disconnect()
