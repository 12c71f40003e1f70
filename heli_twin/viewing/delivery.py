"""Send a recording to a file, which is written whole or not at all, or to a viewer, which may be missing or hang."""

from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from threading import Thread
from typing import NamedTuple, TypeVar

import rerun as rr
import rerun.blueprint as rrb

from heli_twin.recording.schema import LogError
from heli_twin.terminal_text import pasteable
from heli_twin.viewing.viewer_process import DELIVERY_TIMEOUT_S, has_screen, is_listening, is_viewer, spawn, url
from heli_twin.whole_file import write_whole

APPLICATION = "heli_twin"
ANSWER_TIMEOUT_S = 10.0
"""Time that a viewer may take to answer."""

T = TypeVar("T")


class Destination(NamedTuple):
    """The destination of pictures: a file, or a viewer on this machine."""

    file: Path | None = None
    """`NAME.rrd`."""
    port: int | None = None
    """The viewer's."""
    spawn: bool = False
    """Start a viewer if none listens."""
    recording: str | None = None
    """Id of the recording in a file; None for a new one."""
    name: str = ""
    """Of the recording in a file, for a person."""

    def no_answer(self) -> str:
        """The beginning of a sentence: the destination takes nothing in."""
        return f"{self.file} cannot be written" if self.file else f"the viewer on port {self.port} does not answer"

    def no_viewer(self) -> str:
        """A sentence: there is no viewer, and what to do."""
        command = pasteable("rerun", "--port", self.port)
        if self.port is not None and is_listening(self.port):
            return (
                f"another program than a viewer uses port {self.port}: end it, or write a Rerun file, NAME.rrd, and"
                " open it with `rerun --new NAME.rrd`"
            )
        if self.spawn and not has_screen():
            return (
                "there is no screen to show a viewer on: write a Rerun file, NAME.rrd, or a picture with"
                " `heli-twin snapshot`, or look from another machine with `heli-twin replay RUN.mcap --web`"
            )
        if self.spawn:
            return f"the viewer did not start: try `{command}` to see why, or write a Rerun file"
        return f"no viewer listens on port {self.port}: start one with `{command}`"


def deliver(destination: Destination, blueprint: rrb.Blueprint, fill: Callable[[rr.RecordingStream], None]) -> None:
    """Make a recording and deliver it.

    Args:
        destination: A file is written whole or not at all.
        blueprint: The views.
        fill: Sends the data to the stream that it is given.

    Raises:
        LogError: No viewer listens or answers, or the file cannot be written.
    """
    if destination.file is not None:
        stream = rr.RecordingStream(APPLICATION, recording_id=destination.recording)
        if destination.name:
            stream.send_recording_name(destination.name)
        # Rerun's own file can hang when its disk is full.
        recording = stream.memory_recording()
        # Not as a default only: the web viewer shows a layout of its own then.
        stream.send_blueprint(blueprint, make_active=True)
        fill(stream)
        _write(destination.file, recording.drain_as_bytes())
        return
    start_viewer(destination)
    stream = with_timeout(ANSWER_TIMEOUT_S, destination, lambda: open_stream(destination, blueprint))
    if stream is None:
        raise LogError(destination.no_viewer())

    def work() -> None:
        fill(stream)
        flush_and_close(stream, destination)

    with_timeout(DELIVERY_TIMEOUT_S, destination, work)


def _write(file: Path, data: bytes) -> None:
    """Write a file or leave the one that was there."""
    try:
        write_whole(file, data)
    except OSError as error:
        raise LogError(f"pictures cannot be written to {file} ({error.strerror}): choose another place") from error


def with_timeout(seconds: float, destination: Destination, work: Callable[[], T]) -> T:
    """Do work that talks to a destination, on a thread that the program can abandon: Rerun waits without a limit.

    Raises:
        LogError: It was not done in time.
    """
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
        abandon_viewer()
        what = "make room or choose another place" if destination.file else "end it and start another"
        raise LogError(f"{destination.no_answer()} within {seconds:g} s: {what}") from None


def abandon_viewer() -> None:
    """Keep Rerun from waiting, when the program ends, for a viewer that hangs."""
    rr.unregister_shutdown()


def start_viewer(destination: Destination) -> None:
    """Start the viewer if one is wanted and none listens."""
    if destination.spawn and destination.port is not None and has_screen() and not is_listening(destination.port):
        spawn(destination.port)


def open_stream(destination: Destination, blueprint: rrb.Blueprint) -> rr.RecordingStream | None:
    """Open a stream to a destination; None if no viewer listens.

    Raises:
        LogError: The file cannot be written, or the viewer refuses.
    """
    sinks: list[rr.FileSink | rr.GrpcSink] = []
    if destination.file is not None:
        _write(destination.file, b"")
        sinks.append(rr.FileSink(str(destination.file)))
    if destination.port is not None and is_viewer(destination.port):
        sinks.append(rr.GrpcSink(url(destination.port)))
    if not sinks:
        return None
    stream = rr.RecordingStream(APPLICATION)
    try:
        stream.set_sinks(*sinks, default_blueprint=blueprint)
    except RuntimeError as error:
        where = destination.file or url(destination.port or 0)
        raise LogError(f"pictures cannot be written to {where}: {error}") from error
    return stream


def flush_and_close(stream: rr.RecordingStream, destination: Destination) -> None:
    """Wait until everything is delivered, and end the stream.

    Raises:
        LogError: The viewer has died, or the disk is full.
    """
    try:
        stream.flush()
    except RuntimeError as error:
        lost = f"{destination.file} cannot be written, make room" if destination.file else "the viewer is gone"
        raise LogError(f"{lost}: the picture is incomplete") from error
    finally:
        stream.disconnect()
