"""Pictures on their way: to a file, which is whole or not there, or to a viewer, which may be missing, hang or die."""

from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from pathlib import Path
from threading import Thread
from typing import NamedTuple, TypeVar

import rerun as rr
import rerun.blueprint as rrb

from heli_twin.recording.schema import LogError
from heli_twin.viewing.viewer_process import DELIVERY, listens, spawn, url

APPLICATION = "heli_twin"
ANSWER = 10.0
"""How long a viewer may take to answer, s."""

T = TypeVar("T")


class Sink(NamedTuple):
    """Where pictures go: to a file or to a viewer on this machine."""

    file: Path | None = None
    """`NAME.rrd`."""
    port: int | None = None
    """Of the viewer."""
    spawn: bool = False
    """Whether to start a viewer if none listens."""


def deliver(sink: Sink, blueprint: rrb.Blueprint, fill: Callable[[rr.RecordingStream], None]) -> None:
    """Make a recording and deliver it; a file is whole or not there at all.

    Raises:
        LogError: No viewer listens or answers, or the file cannot be written.
    """
    if sink.file is not None:
        stream = rr.RecordingStream(APPLICATION)
        # Rerun's own file can hang when its disk is full.
        recording = stream.memory_recording()
        stream.send_blueprint(blueprint, make_active=False)
        fill(stream)
        _write(sink.file, recording.drain_as_bytes())
        return
    start(sink)
    stream = within(ANSWER, sink, lambda: opened(sink, blueprint))
    if stream is None:
        raise LogError(absent(sink))

    def work() -> None:
        fill(stream)
        finish(stream, sink)

    within(DELIVERY, sink, work)


def _write(file: Path, data: bytes) -> None:
    """Write a file or leave what was there."""
    part = file.with_name(f"{file.name}.part")
    try:
        part.write_bytes(data)
        part.replace(file)
    except OSError as error:
        with suppress(OSError):
            part.unlink()
        raise LogError(f"pictures cannot be written to {file} ({error.strerror}): choose another place") from error


def within(seconds: float, sink: Sink, work: Callable[[], T]) -> T:
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
        leave_behind()
        what = "make room or choose another place" if sink.file else "end it and start another"
        raise LogError(f"{mute(sink)} within {seconds:g} s: {what}") from None


def leave_behind() -> None:
    """Keep Rerun from waiting for a viewer that hangs when the program ends, for ever."""
    rr.unregister_shutdown()


def mute(sink: Sink) -> str:
    """That nothing is taken in."""
    return f"{sink.file} cannot be written" if sink.file else f"the viewer on port {sink.port} does not answer"


def start(sink: Sink) -> None:
    """Start the viewer if one is wanted and none listens."""
    if sink.spawn and sink.port is not None and not listens(sink.port):
        spawn(sink.port)


def absent(sink: Sink) -> str:
    """That there is no viewer, and what to do."""
    how = f"`rerun --port {sink.port}`"
    if sink.spawn:
        return f"the viewer did not start: try {how} to see why, or write a Rerun file"
    return f"no viewer listens on port {sink.port}: start one with {how}"


def opened(sink: Sink, blueprint: rrb.Blueprint) -> rr.RecordingStream | None:
    """A stream to all of the sink that is there."""
    sinks: list[rr.FileSink | rr.GrpcSink] = []
    if sink.file is not None:
        _write(sink.file, b"")
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


def finish(stream: rr.RecordingStream, sink: Sink) -> None:
    """Wait until everything is delivered.

    Raises:
        LogError: The viewer has died, or the disk is full.
    """
    try:
        stream.flush()
    except RuntimeError as error:
        lost = f"{sink.file} cannot be written, make room" if sink.file else "the viewer is gone"
        raise LogError(f"{lost}: the picture is incomplete") from error
    finally:
        stream.disconnect()
