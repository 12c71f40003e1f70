"""Rerun's viewer as a process of this machine: find it, start it, take its picture without a screen."""

import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager, suppress
from tempfile import TemporaryDirectory, TemporaryFile
from typing import IO
from urllib.parse import quote

from rerun.experimental import ViewerClient

from heli_twin.recording.schema import LogError
from heli_twin.viewing.blueprint import TIMELINE

HOST = "127.0.0.1"
START_TIMEOUT_S = 20.0
"""Time that a viewer may take until it listens."""
END_TIMEOUT_S = 2.0
"""Time that a killed server may take until its ports are free."""
DELIVERY_TIMEOUT_S = 60.0
"""Time that a viewer may take to receive a flight."""
REDRAW_PAUSE_S = 0.7
"""Time in which a picture still changes after the simulated time was set: plots fade to their final range."""
START_NOTE_S = 4.5
"""Time for which a viewer shows the note that it has started, in front of the picture."""

WATCHED = ("sh", "-c", 'exec 3<&0; "$@" & viewer=$!; (read line <&3; kill -9 0) & wait $viewer', "sh")
"""Runs a command that ends, with all processes of its session, when the standard input does: with this program,
whatever ends it."""


def url(port: int) -> str:
    """The address of the viewer on this port."""
    return f"rerun+http://{HOST}:{port}/proxy"


def is_listening(port: int) -> bool:
    """Return whether a process listens on this port."""
    try:
        with socket.create_connection((HOST, port), timeout=0.2):
            return True
    except OSError:
        return False


def is_viewer(port: int) -> bool:
    """Return whether what listens on this port talks HTTP/2 as a viewer does: it says its settings at once."""
    try:
        with socket.create_connection((HOST, port), timeout=GREETING_TIMEOUT_S) as connection:
            connection.sendall(b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + bytes([0, 0, 0, SETTINGS_FRAME, 0, 0, 0, 0, 0]))
            head = b""
            while len(head) < 4 and (data := connection.recv(9)):
                head += data
            return head[3:4] == bytes([SETTINGS_FRAME])
    except OSError:
        return False


GREETING_TIMEOUT_S = 2.0
"""Time that a viewer may take to greet."""
SETTINGS_FRAME = 4
"""Type of HTTP/2's first frame, RFC 9113."""


def has_screen() -> bool:
    """Return whether this machine can show a window; only of Linux it is known."""
    return sys.platform != "linux" or any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))


def spawn(port: int) -> bool:
    """Start a viewer that only this machine can reach and that outlives this program; returns whether it listens."""
    viewer = _start([], port, "--expect-data-soon", stdin=subprocess.DEVNULL, output=subprocess.DEVNULL)
    return _comes_up(viewer, port)


def picture(show: Callable[[int], None], at: float, size: tuple[int, int]) -> bytes:
    """Take a PNG of a flight at one moment, from a viewer without a window that ends afterwards.

    Args:
        show: Sends the flight to the viewer on the port that it is given.
        at: Simulated time, s.
        size: Width and height, pixels.

    Raises:
        LogError: There is nothing to draw with, or the viewer failed.
    """
    with headless(size) as (port, viewer):
        started = time.monotonic()
        show(port)
        _wait_until_all_is_there(viewer)
        viewer.set_time(TIMELINE, duration=at, play_state="paused")
        time.sleep(max(REDRAW_PAUSE_S, started + START_NOTE_S - time.monotonic()))
        return viewer.take_screenshot()


@contextmanager
def web_viewer(source: str, port: int) -> Generator[subprocess.Popen[bytes]]:
    """Serve Rerun's web viewer while the block lasts; only this machine can reach it.

    Args:
        source: A Rerun file, whose data come from the next port, `port` + 1; or an address of Rerun's server.
        port: Of the page.

    Raises:
        LogError: A port is taken, or the server failed.
    """
    is_served = source.startswith("rerun+http://")
    ports = [port] if is_served else [port, port + 1]
    for number in ports:
        refuse_taken(number)
    with TemporaryDirectory(ignore_cleanup_errors=True) as place, TemporaryFile() as said:
        options = (source, "--serve-web", "--web-viewer-port", str(port))
        own_port = "auto" if is_served else port + 1
        starting = _start(WATCHED, own_port, *options, stdin=subprocess.PIPE, output=said, TMPDIR=place)
        with starting as process, _explained(process, said):
            if not all(_comes_up(process, number) for number in ports):
                raise LogError(f"the web viewer did not start in {START_TIMEOUT_S:g} s: try again")
            yield process
        # The process that waited for the server may end a moment before it.
        deadline = time.monotonic() + END_TIMEOUT_S
        while any(map(is_listening, ports)) and time.monotonic() < deadline:
            time.sleep(0.02)


def refuse_taken(port: int) -> None:
    """Refuse a port on which something listens.

    Raises:
        LogError: It is taken.
    """
    if is_listening(port):
        raise LogError(f"port {port} is taken: give another one with --port; the one after it is needed too")


def web_address(port: int, source: str = "") -> str:
    """The address of the web viewer's page on this port, as a browser on this machine has it.

    Args:
        port: Of the page.
        source: What it shows, an address of Rerun's server; empty for the file that `web_viewer` serves.
    """
    return f"http://localhost:{port}/?url={quote(source or f'rerun+http://localhost:{port + 1}/proxy', safe=':/')}"


@contextmanager
def window(source: str) -> Generator[subprocess.Popen[bytes]]:
    """Show an address of Rerun's server in a window of its own while the block lasts.

    Raises:
        LogError: It did not start.
    """
    with TemporaryFile() as said:
        starting = _start(WATCHED, "auto", source, stdin=subprocess.PIPE, output=said)
        with starting as process, _explained(process, said):
            yield process


def open_in_viewer(port: int, source: str) -> None:
    """Open an address of Rerun's server in the viewer on this port.

    Raises:
        LogError: It refuses.
    """
    try:
        ViewerClient.connect(url(port)).open([source])
    except RuntimeError as error:
        raise LogError(f"the viewer on port {port} shows no table: {error}") from error


@contextmanager
def headless(size: tuple[int, int]) -> Generator[tuple[int, ViewerClient]]:
    """Run a viewer without a window while the block lasts; yields its port and its client. Size in pixels.

    Raises:
        LogError: There is nothing to draw with, or the viewer failed.
    """
    with socket.socket() as probe:
        probe.bind((HOST, 0))
        port = probe.getsockname()[1]
    # A viewer that is killed leaves its cache behind, so it gets a place of its own.
    with TemporaryDirectory(ignore_cleanup_errors=True) as place, TemporaryFile() as said:
        window = f"{size[0]}x{size[1]}"
        options = ("--headless", "--hide-welcome-screen", "--window-size", window)
        starting = _start(WATCHED, port, *options, stdin=subprocess.PIPE, output=said, TMPDIR=place)
        with starting as process, _explained(process, said):
            if not _comes_up(process, port):
                raise LogError(
                    f"the viewer did not start in {START_TIMEOUT_S:g} s: try again when the machine is less busy"
                )
            viewer = ViewerClient.connect(url(port))
            # It listens before it knows whether it can draw.
            viewer.get_state()
            yield port, viewer


@contextmanager
def _explained(process: subprocess.Popen[bytes], said: IO[bytes]) -> Generator[None]:
    """Turn whatever goes wrong with a viewer into one sentence, from its output if it has died."""
    try:
        yield
    except (LogError, RuntimeError, OSError) as error:
        with suppress(subprocess.TimeoutExpired):
            process.wait(2)
            said.seek(0)
            raise LogError(_why(said.read().decode(errors="replace"))) from error
        if isinstance(error, LogError):
            raise
        raise LogError(f"the viewer gave no picture: {error}") from error


def _why(said: str) -> str:
    """One sentence on why a viewer died, from its output."""
    if "render context" in said or "adapter" in said:
        return (
            "there is no graphics driver to draw with: install a software one,"
            " on Debian and Ubuntu `apt install mesa-vulkan-drivers`"
        )
    last = next((line.strip() for line in said.splitlines() if line.strip()), "it said nothing")
    return f"the viewer died ({last}): try `rerun --headless` by itself to see why"


def _start(
    watch: Sequence[str], port: int | str, *options: str, stdin: int, output: int | IO[bytes], **variables: str
) -> subprocess.Popen[bytes]:
    command = [*watch, sys.executable, "-m", "rerun", "--port", str(port), "--bind", HOST, *options]
    # Below errors the viewer shows its own log as notes in front of the picture.
    environment = os.environ | {"RUST_LOG": "off"} | variables
    return subprocess.Popen(command, stdin=stdin, stdout=output, stderr=output, start_new_session=True, env=environment)


def _comes_up(viewer: subprocess.Popen[bytes], port: int) -> bool:
    deadline = time.monotonic() + START_TIMEOUT_S
    while time.monotonic() < deadline and viewer.poll() is None:
        if is_listening(port):
            return True
        time.sleep(0.05)
    return False


def _wait_until_all_is_there(viewer: ViewerClient) -> None:
    """Wait until a recording and its layout have arrived and the recording no longer grows."""
    before, deadline = None, time.monotonic() + DELIVERY_TIMEOUT_S
    while time.monotonic() < deadline:
        state = viewer.get_state()
        now = [(r.store_id, [(line.name, line.end) for line in r.timelines]) for r in state.recordings]
        if (
            state.views
            and now == before
            and any(line.name == TIMELINE for r in state.recordings for line in r.timelines)
        ):
            return
        before = now
        time.sleep(0.2)
    raise LogError(f"the viewer took more than {DELIVERY_TIMEOUT_S:g} s to take in the flight: try a shorter log")
