"""`heli-twin film`: a recorded flight as a film."""

import re
from argparse import ArgumentParser, ArgumentTypeError, Namespace, _SubParsersAction

from heli_twin.commands import command, file_path, progress_bar, say
from heli_twin.commands.plot import require_free
from heli_twin.terminal_text import instead

CAMERAS = ("follow", "room", "top")


def add(subparsers: "_SubParsersAction[ArgumentParser]") -> None:
    """Add the command."""
    parser = command(
        subparsers,
        "film",
        run,
        "film a recorded flight, or two side by side (mp4, gif), no screen needed",
        "Film a recorded flight without a screen: the helicopter with its trail, the reference (black) and the plan\n"
        "of its controller (purple), and below it the distance from the reference; grey means no poses.\n"
        "It needs a driver that draws (on Debian and Ubuntu `apt install libegl1 libgl1-mesa-dri`), and for MP4 PyAV:\n"
        "`pip install 'heli-twin[film]'`. A square of the floor is 25 cm wide.",
        "  heli-twin film logs/RUN.mcap flight.mp4\n"
        "  heli-twin film A.mcap B.mcap compared.mp4 --camera top\n"
        "  heli-twin film logs/RUN.mcap landing.gif --from 5 --to 9 --camera follow",
    )
    parser.add_argument("log", type=file_path, metavar="RUN.mcap", help="a log that heli-twin recorded")
    parser.add_argument("other", type=file_path, nargs="?", metavar="OTHER.mcap", help="a second one, shown beside it")
    parser.add_argument("film", type=file_path, metavar="FILM.mp4|gif", help="the file to write")
    parser.add_argument("--from", dest="start", type=float, default=0.0, metavar="SECONDS", help="begin (default 0)")
    parser.add_argument("--to", dest="end", type=float, metavar="SECONDS", help="end (default: that of the flight)")
    parser.add_argument("--fps", type=float, metavar="N", help="frames a second (default 25, in a GIF 10)")
    parser.add_argument("--size", type=_size, metavar="WxH", help="pixels (default 854x480, in a GIF 640x360)")
    parser.add_argument("--camera", type=_camera, default="room", metavar="KIND", help="room (default), follow or top")
    parser.add_argument("--force", action="store_true", help="replace the file if it exists")


def run(parsed: Namespace) -> int:
    """Film it."""
    require_free(parsed.film, parsed.force)
    from heli_twin.films.film import Take, film

    take = Take(parsed.start, parsed.end, parsed.fps, parsed.size, parsed.camera)
    with progress_bar() as bar:
        task = bar.add_task("frames", total=None)
        made = film(
            [path for path in (parsed.log, parsed.other) if path],
            parsed.film,
            take,
            lambda done, total: bar.update(task, completed=done, total=total),
        )
    width, height = made.size
    seconds = made.frames / made.fps
    say(f"wrote {parsed.film}: {made.frames} frames, {seconds:.3g} s, {width}x{height}")
    return 0


def _camera(text: str) -> str:
    if text not in CAMERAS:
        raise ArgumentTypeError(f"unknown camera {instead(text, CAMERAS)}")
    return text


def _size(text: str) -> tuple[int, int]:
    sides = re.fullmatch(r"(\d{1,5})x(\d{1,5})", text)
    if sides is None:
        raise ArgumentTypeError(f"'{text}' is no size: write width x height in pixels, such as 854x480")
    return int(sides[1]), int(sides[2])
