"""A film of one recorded flight, or of two side by side."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image

from heli_twin.errors import HeliTwinError
from heli_twin.films.encoding import encode, require_encoder
from heli_twin.films.flights import PLAN_COLOR, CameraKind, Cameras, Shown, cameras, drawing, pose, shown
from heli_twin.films.ships import frames_of_ships, shown_ships
from heli_twin.films.strip import Strip, axes, strip_height, titled
from heli_twin.lab.plant.renderer import Renderer
from heli_twin.recording import Log, read_log
from heli_twin.reporting.names import told_apart
from heli_twin.whole_file import whole_file

MOST_FLIGHTS = 2
CAMERAS: tuple[CameraKind, ...] = ("follow", "room", "top")
DEFAULT_SIZE, GIF_SIZE = (854, 480), (640, 360)
"""Pixels; a software renderer draws 30 s of the first in less than a minute of two cores."""
LEAST_PX, MOST_PX = (320, 180), (3840, 2160)
TOPICS = ("/truth", "/mocap/pose", "/reference", "/mpc/plan", "/view/reference_path", "/path")
CountProgress = Callable[[int, int], None]
"""Called with the numbers of finished and of all frames."""


class Take(NamedTuple):
    """How a film is made."""

    start: float = 0.0
    """First moment, s."""
    end: float | None = None
    """Last moment, s; None for the end of the longest flight."""
    fps: float | None = None
    """Frames a second; None: 25, and 10 in a GIF."""
    size: tuple[int, int] | None = None
    """Width and height, pixels; None: `DEFAULT_SIZE`, `GIF_SIZE` in a GIF."""
    camera: CameraKind = "room"


class Filmed(NamedTuple):
    """What was made."""

    frames: int
    fps: float
    size: tuple[int, int]


def film(paths: Sequence[Path], file: Path, take: Take, progress: CountProgress = lambda done, total: None) -> Filmed:
    """Draw and encode a film; the file is there whole or not at all.

    Args:
        paths: Logs of one flight, or of two, which are shown side by side; or one of several helicopters.
        file: `NAME.mp4` or `NAME.gif`.
        take: How.
        progress: Told of every frame.

    Raises:
        HeliTwinError: A log cannot be read, a number is out of its limits, the encoder or the graphics driver is
            missing, or the file cannot be written.
    """
    require_encoder(file)
    if not 1 <= len(paths) <= MOST_FLIGHTS:
        raise HeliTwinError(f"{len(paths)} flights do not fit beside each other: give one log or two")
    is_gif = file.suffix == ".gif"
    fps = take.fps if take.fps is not None else 10.0 if is_gif else 25.0
    width, height = take.size or (GIF_SIZE if is_gif else DEFAULT_SIZE)
    _check(fps, (width, height), is_gif=is_gif)
    logs = [read_log(path, TOPICS) for path in paths]
    together = len(logs) == 1 and bool(logs[0].ships)
    flights = shown_ships(logs[0]) if together else _shown(logs, paths)
    times = _times(flights, take, fps)
    with ExitStack() as stack:
        kept = [PLAN_COLOR, *(flight.color for flight in flights)]
        if together:
            frames = frames_of_ships(stack, logs[0], flights, (take.camera, (width, height)), times)
        else:
            frames = _frames(stack, flights, take.camera, times, (width, height))
        try:
            with whole_file(file) as part:
                encode(_counted(frames, len(times), progress), part, file.suffix, fps, kept)
        except OSError as error:
            raise HeliTwinError(f"cannot write {file}: {error.strerror or error}") from None
    return Filmed(len(times), fps, (width, height))


def _shown(logs: Sequence[Log], paths: Sequence[Path]) -> list[Shown]:
    return [shown(log, name, i) for i, (log, name) in enumerate(zip(logs, told_apart(logs, paths), strict=True))]


def _check(fps: float, size: tuple[int, int], *, is_gif: bool) -> None:
    most = 50 if is_gif else 120
    if not 1 <= fps <= most:
        raise HeliTwinError(f"--fps {fps:g}: give 1 to {most} frames a second")
    for side, least, greatest, name in zip(size, LEAST_PX, MOST_PX, ("width", "height"), strict=True):
        if not least <= side <= greatest or side % 2:
            raise HeliTwinError(
                f"--size: a {name} of {side} pixels: give an even number from {least} to {greatest}, such as 854x480"
            )


def _times(flights: Sequence[Shown], take: Take, fps: float) -> np.ndarray:
    longest = max(flight.end for flight in flights)
    end = longest if take.end is None else min(take.end, longest)
    if not 0 <= take.start < end:
        to = " on" if take.end is None else f" to {take.end:g} s"
        raise HeliTwinError(
            f"nothing was recorded from {take.start:g} s{to}: give --from and --to within 0 and {longest:g} s"
        )
    return take.start + np.arange(max(1, round((end - take.start) * fps))) / fps


def _counted(frames: Iterator[Image.Image], total: int, progress: CountProgress) -> Iterator[Image.Image]:
    for done, picture in enumerate(frames, start=1):
        yield picture
        progress(done, total)


def _frames(
    stack: ExitStack, flights: Sequence[Shown], camera: CameraKind, times: np.ndarray, size: tuple[int, int]
) -> Iterator[Image.Image]:
    """Yield the pictures of a film; the renderers close with the stack."""
    width, height = size
    # Both halves have an even width.
    each = width // len(flights) // 2 * 2
    below = strip_height(height)
    renderers = [stack.enter_context(Renderer(flight.plant, each, height - below)) for flight in flights]
    shared = axes(flights, float(times[0]), float(max(times[-1], times[0] + 0.1)))
    strips = [Strip(flight, each, below, shared) for flight in flights]
    placed = cameras(flights, camera, times, each / (height - below))
    return _drawn(list(zip(flights, renderers, strips, strict=True)), placed, times, size)


def _drawn(
    parts: Sequence[tuple[Shown, Renderer, Strip]], placed: Cameras, times: np.ndarray, size: tuple[int, int]
) -> Iterator[Image.Image]:
    each = size[0] // len(parts) // 2 * 2
    for frame, t in enumerate(times.tolist()):
        whole = Image.new("RGB", size, (255, 255, 255))
        for i, (flight, renderer, strip) in enumerate(parts):
            here = pose(flight, t)
            lines, balls = drawing(flight, t, here.position)
            pixels = renderer.draw(here, placed.at(i, frame), lines, balls)
            scene = titled(Image.fromarray(pixels), flight, max(9, round(0.028 * size[1])))
            whole.paste(scene, (i * each, 0))
            whole.paste(strip.at(t), (i * each, scene.height))
        yield whole
