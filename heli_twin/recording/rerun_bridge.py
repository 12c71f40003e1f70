"""A flight in Rerun: the same picture from a finished log and while it flies.

Only this module and its neighbours `layout`, `style`, `rows`, `comparison` and `viewer` import Rerun, and nothing
imports them before a viewer is asked for. A viewer that is missing, or that dies, costs its pictures and nothing else.
"""

import logging
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from contextlib import suppress
from pathlib import Path
from queue import Full, Queue
from threading import Event, Thread
from time import perf_counter
from typing import NamedTuple, TypeVar

import rerun as rr
import rerun.blueprint as rrb

from heli_twin.recording.layout import TIMELINE, Scales, layout
from heli_twin.recording.log import Log, Messages
from heli_twin.recording.rows import Rows, rows
from heli_twin.recording.schema import LogError
from heli_twin.recording.style import send_static
from heli_twin.recording.viewer import DELIVERY, listens, spawn, url

APPLICATION = "heli_twin"
SLICE = 500_000_000
"""Simulated ns that are sent at once while flying."""
PATIENCE = 200
"""Slices that wait for a viewer at most: 100 s of flight, about 15 MB."""
IDLE, SHARE = 0.1, 0.1
"""Pause between two looks at what waits, s, and share of the time that a viewer's pictures may take at most: they are
made in the interpreter that flies."""
ANSWER = 10.0
"""How long a viewer may take to answer, s."""
FAREWELL = 5.0
"""How long a viewer may take for the rest when the flight is over, s."""

_LOGGER = logging.getLogger(__name__)


Slice = dict[str, tuple[list[int], list[bytes]]]
"""By topic, times and messages of a piece of a flight."""


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
        LogError: No viewer listens or answers, or the file cannot be written.
    """
    scales = scales.seeing(log)

    def fill(stream: rr.RecordingStream) -> None:
        send_static(stream)
        send(stream, log, scales)

    deliver(sink, layout(scales), fill)


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
        self._slice: Slice = {}
        self._due = SLICE
        self._told = False
        self._over = Event()
        self._slices: Queue[Slice] = Queue(PATIENCE)
        self._stream = self._opened() if sink.port is None else None
        self._server = None if sink.port is None else Thread(target=self._serve, daemon=True)
        _start(sink)
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
        self._over.set()
        if self._server is None:
            self._close()
            return
        self._server.join(FAREWELL)
        if self._server.is_alive():
            _leave_behind()
            self._tell("the viewer does not answer: its picture is incomplete")

    def _end_slice(self) -> None:
        taken, self._slice = self._slice, {}
        if self._server is None:
            self._show([taken])
            return
        try:
            self._slices.put_nowait(taken)
        except Full:
            self._tell("the viewer is too slow: its picture has gaps")

    def _serve(self) -> None:
        """Show slices until the last; the only one that talks to a viewer."""
        try:
            self._stream = self._opened()
        except Exception:
            _LOGGER.exception("the flight goes on without its picture")
        pause = 0.0
        while not self._over.wait(pause):
            pause = self._show_waiting()
        self._show_waiting()
        self._close()

    def _show_waiting(self) -> float:
        """Show all slices that wait, as one; returns how long to leave the processor to the flight, s."""
        began = perf_counter()
        waiting = [self._slices.get_nowait() for _ in range(self._slices.qsize())]
        if waiting:
            self._show(waiting)
        return max((perf_counter() - began) / SHARE, IDLE)

    def _opened(self) -> rr.RecordingStream | None:
        stream = _opened(self._sink, layout(self._scales))
        if stream is None:
            self._tell(f"{_absent(self._sink)}; the flight goes on without its picture")
        else:
            send_static(stream)
        return stream

    def _show(self, slices: Sequence[Slice]) -> None:
        if self._stream is None:
            return
        try:
            send(self._stream, _joined(slices), self._scales)
        except Exception:
            _LOGGER.exception("the flight goes on without its picture")
            self._stream = None

    def _close(self) -> None:
        if self._stream is None:
            return
        try:
            _finish(self._stream, self._sink)
        except LogError as error:
            self._tell(str(error))

    def _tell(self, what: str) -> None:
        if not self._told:
            _LOGGER.warning("%s", what)
        self._told = True


def _joined(slices: Sequence[Slice]) -> Log:
    """Slices that follow each other as one log."""
    topics = dict.fromkeys(topic for some in slices for topic in some)
    both = {topic: [some[topic] for some in slices if topic in some] for topic in topics}
    return Log(
        {
            topic: Messages([t for times, _ in parts for t in times], [d for _, data in parts for d in data])
            for topic, parts in both.items()
        }
    )


def send(stream: rr.RecordingStream, log: Log, scales: Scales, below: str = "") -> None:
    """Send a log or a slice of one, all of it below an entity such as `A/`."""
    for entity, times, columns in rows(log, scales):
        send_rows(stream, (below + entity, times, columns))


def send_rows(stream: rr.RecordingStream, some: Rows) -> None:
    """Send columns unless they are empty."""
    entity, times, columns = some
    if len(times):
        stream.send_columns(entity, [rr.TimeColumn(TIMELINE, duration=times.astype("m8[ns]"))], columns)


def deliver(sink: Sink, blueprint: rrb.Blueprint, fill: Callable[[rr.RecordingStream], None]) -> None:
    """Make a recording and deliver it to all of the sink that is there; a file is whole or not there at all.

    Raises:
        LogError: Nothing is there or answers, or the file cannot be written.
    """
    _start(sink)
    if sink.file is None:
        _deliver(sink, blueprint, fill)
        return
    part = sink.file.with_name(f"{sink.file.name}.part")
    try:
        _deliver(sink._replace(file=part), blueprint, fill)
        part.replace(sink.file)
    except OSError as error:
        raise LogError(f"{sink.file} cannot be written ({error.strerror}): choose another place") from error
    finally:
        with suppress(OSError):
            part.unlink()


def _deliver(sink: Sink, blueprint: rrb.Blueprint, fill: Callable[[rr.RecordingStream], None]) -> None:
    stream = _within(ANSWER, sink, lambda: _opened(sink, blueprint))
    if stream is None:
        raise LogError(_absent(sink))

    def work() -> None:
        fill(stream)
        _finish(stream, sink)

    _within(DELIVERY, sink, work)


T = TypeVar("T")


def _within(seconds: float, sink: Sink, work: Callable[[], T]) -> T:
    """Talk to a viewer; for one that hangs Rerun waits for ever, on a thread that the program can leave behind."""
    answer: Future[T] = Future()

    def run() -> None:
        try:
            answer.set_result(work())
        except Exception as error:
            answer.set_exception(error)

    Thread(target=run, daemon=True).start()
    try:
        return answer.result(seconds)
    except TimeoutError:
        _leave_behind()
        raise LogError(
            f"the viewer on port {sink.port} does not answer within {seconds:g} s: end it and start another"
        ) from None


def _leave_behind() -> None:
    """Keep Rerun from waiting for a viewer that hangs when the program ends, for ever."""
    rr.unregister_shutdown()


def _start(sink: Sink) -> None:
    """Start the viewer if one is wanted and none listens."""
    if sink.spawn and sink.port is not None and not listens(sink.port):
        spawn(sink.port)


def _absent(sink: Sink) -> str:
    """That there is no viewer, and what to do."""
    how = f"`rerun --port {sink.port}`"
    if sink.spawn:
        return f"the viewer did not start: try {how} to see why, or write a Rerun file"
    return f"no viewer listens on port {sink.port}: start one with {how}"


def _opened(sink: Sink, blueprint: rrb.Blueprint) -> rr.RecordingStream | None:
    """A stream to all of the sink that is there."""
    sinks: list[rr.FileSink | rr.GrpcSink] = []
    if sink.file is not None:
        sinks.append(rr.FileSink(str(sink.file)))
    if sink.port is not None and listens(sink.port):
        sinks.append(rr.GrpcSink(url(sink.port)))
    if not sinks:
        return None
    stream = rr.RecordingStream(APPLICATION)
    try:
        stream.set_sinks(*sinks, default_blueprint=blueprint)
    except RuntimeError as error:
        raise LogError(f"pictures cannot be written to {sink.file or url(sink.port or 0)}: {error}") from error
    return stream


def _finish(stream: rr.RecordingStream, sink: Sink) -> None:
    """Wait until everything is delivered.

    Raises:
        LogError: The viewer has died, or the disk is full.
    """
    try:
        stream.flush()
    except RuntimeError as error:
        lost = f"{sink.file} cannot be written any more, make room" if sink.file else "the viewer is gone"
        raise LogError(f"{lost}: the picture is incomplete") from error
    finally:
        stream.disconnect()
