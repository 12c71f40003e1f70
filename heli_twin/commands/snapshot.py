"""`heli-twin snapshot`: a picture of one moment, on a machine without a screen too."""

import argparse
import re
from argparse import ArgumentParser, Namespace, _SubParsersAction

from heli_twin.commands import command, file_path, say
from heli_twin.commands.replay import add_ghost
from heli_twin.errors import HeliTwinError

MIN_SIZE_PX = 640, 400
"""Below this the titles and numbers of the plots cannot be read."""
MAX_SIDE_PX = 8192
"""The longest side that software renderers draw."""


def add(subparsers: "_SubParsersAction[ArgumentParser]") -> None:
    """Add the command."""
    parser = command(
        subparsers,
        "snapshot",
        run,
        "write a picture of a recorded flight, no screen needed",
        "Write what `heli-twin replay` shows at one moment as a picture. It needs no screen and no graphics card,\n"
        "but a driver that draws: on Debian and Ubuntu `apt install mesa-vulkan-drivers`.",
        "  heli-twin snapshot logs/RUN.mcap --at 12.3 flight.png\n"
        "  heli-twin snapshot logs/A.mcap logs/B.mcap compared.png --at 12.3 --size 1920x1080\n"
        "  heli-twin snapshot logs/RUN.mcap sticks.png --tab inputs\n"
        "  heli-twin snapshot logs/RUN.mcap ghost.png --ghost calibration.toml --at 12.3 --tab difference",
    )
    parser.add_argument("log", type=file_path, metavar="RUN.mcap", help="a log that heli-twin recorded")
    parser.add_argument(
        "other", type=file_path, nargs="?", metavar="OTHER.mcap", help="a second one to compare it with"
    )
    parser.add_argument("picture", type=file_path, metavar="PICTURE.png", help="the file to write")
    parser.add_argument("--at", type=float, metavar="SECONDS", help="simulated time (default: the end of the flight)")
    parser.add_argument("--size", type=_size, default="1600x900", metavar="WxH", help="pixels (default 1600x900)")
    add_ghost(parser)
    parser.add_argument("--require", metavar="REQ.toml|NAME", help="requirements, as `heli-twin judge` takes them")
    parser.add_argument(
        "--tab",
        default="",
        metavar="NAME",
        help="the plots to show: flight, position, inputs, air or computing; of two flights errors, difference,"
        " position, inputs or controller; with --require also requirements (default: what has changed)",
    )


def run(parsed: Namespace) -> int:
    """Write it."""
    from heli_twin.viewing.show import flights, snapshot

    if not parsed.picture.parent.is_dir():
        raise HeliTwinError(f"cannot write {parsed.picture}: there is no folder {parsed.picture.parent}")
    shown = flights([path for path in (parsed.log, parsed.other) if path], parsed.require)
    if parsed.ghost:
        from heli_twin.validation.ghost import with_ghost

        shown = with_ghost(shown, parsed.ghost)
    snapshot(shown, parsed.picture, at=parsed.at, size=parsed.size, tab=parsed.tab)
    say(f"wrote {parsed.picture}")
    return 0


def _size(text: str) -> tuple[int, int]:
    sides = re.fullmatch(r"(\d{1,5})x(\d{1,5})", text)
    width, height = (int(side) for side in sides.groups()) if sides else (0, 0)
    if not (MIN_SIZE_PX[0] <= width <= MAX_SIDE_PX and MIN_SIZE_PX[1] <= height <= MAX_SIDE_PX):
        least, most = "x".join(map(str, MIN_SIZE_PX)), f"{MAX_SIDE_PX}x{MAX_SIDE_PX}"
        raise argparse.ArgumentTypeError(
            f"'{text}' is no size that can be read: write width x height in pixels, {least} to {most}, such as 1600x900"
        )
    return width, height
