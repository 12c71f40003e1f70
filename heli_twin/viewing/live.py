"""A flight in Rerun: the same picture from a finished log and while it flies.

A viewer that is missing, slow or dies costs its pictures and nothing else.
"""

import logging
import sys
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from queue import Full, Queue
from threading import Event, Thread
from time import perf_counter

import rerun as rr

from heli_twin.errors import HeliTwinError
from heli_twin.recording import read_log
from heli_twin.recording.log import Log
from heli_twin.recording.records import Messages
from heli_twin.recording.schema import LogError
from heli_twin.viewing.blueprint import TIMELINE, Scales, layout
from heli_twin.viewing.delivery import (
    ANSWER_TIMEOUT_S,
    Destination,
    abandon_viewer,
    deliver,
    flush_and_close,
    open_stream,
    start_viewer,
    with_timeout,
)
from heli_twin.viewing.entities import Rows, entities, rows
from heli_twin.viewing.ranges import ranges
from heli_twin.viewing.requirements import Judged, judged, send_judged, send_table
from heli_twin.viewing.style import ALONE, floor_mark, send_static

SLICE_NS = 500_000_000
"""Simulated time that is handed over at once while flying."""
MAX_WAITING_SLICES = 200
"""100 s of flight, about 15 MB."""
MIN_PAUSE_S = 0.1
"""Least pause between two looks at the waiting slices."""
MAX_TIME_SHARE = 0.1
"""Greatest share of the time that pictures take: they are made in the interpreter that flies."""
SHUTDOWN_TIMEOUT_S = 5.0
"""Time that the waiting slices may take when the flight is over."""
INTERRUPTED_TIMEOUT_S = 1.0
"""The same when the flight was interrupted: the program is about to end."""

_LOGGER = logging.getLogger(__name__)

Slice = dict[str, tuple[list[int], list[bytes]]]
"""Times (ns) and messages of a piece of a flight, by topic."""


def show(log: Log, destination: Destination, scales: Scales, tab: str = "", found: Sequence[Judged] = ()) -> None:
    """Show a whole flight.

    Args:
        log: The flight.
        destination: Where it is shown.
        scales: What the plots compare with.
        tab: Name of the plots in front; empty for the first, or for those of requirements.
        found: The verdicts on its requirements.

    Raises:
        LogError: No viewer listens or answers, the file cannot be written, or there is no such tab.
    """
    # Where the live picture has it, which knows the plan alone.
    planned, scales = scales.path, scales.for_log(log)
    floor = floor_mark(scales.path if planned is None else planned)
    plotted = {f"requirements/{number}" for number, each in enumerate(found, 1) if each.signals is not None}
    present = entities(log, scales) | plotted | {"requirements/told"}
    required = tuple(each.verdict.requirement for each in found)
    scales = scales._replace(present=present, ranges=ranges([log]), required=required)

    def fill(stream: rr.RecordingStream) -> None:
        send_static(stream, source=scales.source, shape=scales.shape, floor=floor)
        send(stream, log, scales)
        if found:
            send_requirements(stream, found)

    deliver(destination, layout(scales, tab or ("requirements" if found else "")), fill)


def send_requirements(stream: rr.RecordingStream, found: Sequence[Judged]) -> None:
    """Send the verdicts on a flight alone."""
    send_judged(stream, found, ALONE)
    send_table(stream, [("", found)])


class Live:
    """A listener of the recorder that shows the flight while it lasts, slice by slice.

    Each trouble with the picture is told once, and the flight goes on. A thread of its own sends the slices, so that
    a viewer or a disk that hangs does not delay the flight; slices that cannot be sent in time are left out.
    """

    def __init__(self, destination: Destination, scales: Scales) -> None:
        """Open the destination; without a viewer there are no pictures.

        Raises:
            LogError: The file cannot be written.
        """
        self._destination, self._scales = destination, scales
        self._slice: Slice = {}
        self._found: Sequence[Judged] = ()
        self._due = SLICE_NS
        self._told = False
        self._over = Event()
        self._slices: Queue[Slice] = Queue(MAX_WAITING_SLICES)
        start_viewer(destination)
        self._stream = with_timeout(ANSWER_TIMEOUT_S, destination, self._open) if destination.file else None
        self._server = Thread(target=self._serve, daemon=True)
        self._server.start()

    def __call__(self, topic: str, t: int, data: bytes) -> None:
        """Take a message of the flight."""
        if t >= self._due:
            self._due = (t // SLICE_NS + 1) * SLICE_NS
            self._end_slice()
        times, messages = self._slice.setdefault(topic, ([], []))
        times.append(t)
        messages.append(data)

    def judge(self, log: Path | BytesIO) -> None:
        """Judge the flight by the requirements of the scales; the verdicts are shown after the waiting slices.

        Args:
            log: Of the whole flight.
        """
        if not self._scales.required:
            return
        try:
            self._found = judged(self._scales.required, read_log(log))
        except HeliTwinError as error:
            self._tell(f"the picture has no requirements: {error}")

    def close(self) -> None:
        """Show the waiting slices and end the picture."""
        self._end_slice()
        self._over.set()
        interrupted = isinstance(sys.exception(), KeyboardInterrupt)
        self._server.join(INTERRUPTED_TIMEOUT_S if interrupted else SHUTDOWN_TIMEOUT_S)
        if self._server.is_alive():
            abandon_viewer()
            self._tell(f"{self._destination.no_answer()}: the picture is incomplete")

    def _end_slice(self) -> None:
        taken, self._slice = self._slice, {}
        try:
            self._slices.put_nowait(taken)
        except Full:
            self._tell(f"{self._destination.no_answer()}: the picture has gaps")

    def _serve(self) -> None:
        """Show slices until the last one; only this thread talks to a viewer."""
        try:
            self._stream = self._stream or self._open()
        # Any error in Rerun or in a slice ends the picture and not the flight.
        except Exception:
            _LOGGER.exception("the flight goes on without its picture")
        pause = 0.0
        while not self._over.wait(pause):
            pause = self._show_waiting()
        self._show_waiting()
        self._show_found()
        self._close()

    def _show_waiting(self) -> float:
        """Show all waiting slices as one; returns the pause (s) that leaves the processor to the flight."""
        began = perf_counter()
        waiting = [self._slices.get_nowait() for _ in range(self._slices.qsize())]
        if waiting:
            self._show(waiting)
        return max((perf_counter() - began) / MAX_TIME_SHARE, MIN_PAUSE_S)

    def _open(self) -> rr.RecordingStream | None:
        stream = open_stream(self._destination, layout(self._scales))
        if stream is None:
            self._tell(f"{self._destination.no_viewer()}; the flight goes on without its picture")
        else:
            send_static(stream, shape=self._scales.shape, floor=floor_mark(self._scales.path))
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

    def _show_found(self) -> None:
        if self._stream is None or not self._found:
            return
        try:
            send_requirements(self._stream, self._found)
        # As above.
        except Exception:
            _LOGGER.exception("the picture has no requirements")

    def _close(self) -> None:
        if self._stream is None:
            return
        try:
            flush_and_close(self._stream, self._destination)
        except LogError as error:
            self._tell(str(error))

    def _tell(self, trouble: str) -> None:
        if not self._told:
            _LOGGER.warning("%s", trouble)
        self._told = True


def _joined(slices: Sequence[Slice]) -> Log:
    """Join consecutive slices into one log."""
    topics = dict.fromkeys(topic for piece in slices for topic in piece)
    pieces = {topic: [piece[topic] for piece in slices if topic in piece] for topic in topics}
    return Log(
        {
            topic: Messages([t for times, _ in parts for t in times], [d for _, data in parts for d in data])
            for topic, parts in pieces.items()
        }
    )


def send(stream: rr.RecordingStream, log: Log, scales: Scales, prefix: str = "") -> None:
    """Send a log or a slice of one, each entity under a prefix such as `A/`."""
    for entity, times, columns in rows(log, scales):
        send_rows(stream, (prefix + entity, times, columns))


def send_rows(stream: rr.RecordingStream, entity_rows: Rows) -> None:
    """Send columns unless they are empty."""
    entity, times, columns = entity_rows
    if len(times):
        stream.send_columns(entity, [rr.TimeColumn(TIMELINE, duration=times.astype("m8[ns]"))], columns)
