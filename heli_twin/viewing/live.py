"""A flight in Rerun: the same picture from a finished log and while it flies.

Only this module and its neighbours `delivery`, `layout`, `style`, `rows`, `comparison` and `viewer` import Rerun, and
nothing imports them before a viewer is asked for. A viewer that is missing, slow or dies costs its pictures and
nothing else.
"""

import logging
from collections.abc import Sequence
from queue import Full, Queue
from threading import Event, Thread
from time import perf_counter

import rerun as rr

from heli_twin.recording.log import Log, Messages
from heli_twin.recording.schema import LogError
from heli_twin.viewing.blueprint import TIMELINE, Scales, layout
from heli_twin.viewing.entities import Rows, rows
from heli_twin.viewing.sinks import (
    ANSWER,
    Sink,
    absent,
    deliver,
    finish,
    leave_behind,
    mute,
    opened,
    start,
    within,
)
from heli_twin.viewing.style import send_static

SLICE = 500_000_000
"""Simulated ns that are handed over at once while flying."""
PATIENCE = 200
"""Slices that wait to be shown at most: 100 s of flight, about 15 MB."""
IDLE, SHARE = 0.1, 0.1
"""Least pause between two looks at what waits, s, and share of the time that pictures take at most: they are made in
the interpreter that flies."""
FAREWELL = 5.0
"""How long the rest may take when the flight is over, s."""

_LOGGER = logging.getLogger(__name__)

Slice = dict[str, tuple[list[int], list[bytes]]]
"""By topic, times and messages of a piece of a flight."""


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

    Whatever goes wrong with the picture is told once, and the flight goes on. A thread of its own sends it, so that a
    viewer or a disk that hangs does not hold up the flight; what cannot be sent in time is left out of the picture.
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
        start(sink)
        self._stream = within(ANSWER, sink, self._opened) if sink.file else None
        self._server = Thread(target=self._serve, daemon=True)
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
        self._server.join(FAREWELL)
        if self._server.is_alive():
            leave_behind()
            self._tell(f"{mute(self._sink)}: the picture is incomplete")

    def _end_slice(self) -> None:
        taken, self._slice = self._slice, {}
        try:
            self._slices.put_nowait(taken)
        except Full:
            self._tell(f"{mute(self._sink)}: the picture has gaps")

    def _serve(self) -> None:
        """Show slices until the last; the only one that talks to a viewer."""
        try:
            self._stream = self._stream or self._opened()
        # Whatever it is that fails in Rerun or in a slice, it ends the picture and not the flight.
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
        stream = opened(self._sink, layout(self._scales))
        if stream is None:
            self._tell(f"{absent(self._sink)}; the flight goes on without its picture")
        else:
            send_static(stream)
        return stream

    def _show(self, slices: Sequence[Slice]) -> None:
        if self._stream is None:
            return
        try:
            send(self._stream, _joined(slices), self._scales)
        # As above.
        except Exception:
            _LOGGER.exception("the flight goes on without its picture")
            self._stream = None

    def _close(self) -> None:
        if self._stream is None:
            return
        try:
            finish(self._stream, self._sink)
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
