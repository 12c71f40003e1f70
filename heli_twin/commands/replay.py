"""`heli-twin replay`: a recorded flight in Rerun, or two side by side."""

from argparse import ArgumentParser, Namespace, _SubParsersAction
from pathlib import Path

from heli_twin.commands import command, file_path
from heli_twin.terminal_text import clean, pasteable


def add(subparsers: "_SubParsersAction[ArgumentParser]") -> None:
    """Add the command."""
    parser = command(
        subparsers,
        "replay",
        run,
        "show a recorded flight in Rerun, or two in one scene",
        "Show a recorded flight in Rerun, the same picture as while it was flown.\n"
        "Of two logs both helicopters fly in one scene, A blue and B pink; the plots hold the errors of both and\n"
        "how far B is from A, and a table says what differs between the experiments.",
        "  heli-twin replay logs/RUN.mcap\n"
        "  heli-twin replay logs/RUN.mcap --save flight.rrd\n"
        "  heli-twin replay logs/A.mcap logs/B.mcap\n"
        "  heli-twin replay logs/RUN.mcap --connect",
    )
    parser.add_argument("log", type=file_path, metavar="RUN.mcap", help="a log that heli-twin recorded")
    parser.add_argument(
        "other", type=file_path, nargs="?", metavar="OTHER.mcap", help="a second one to compare it with"
    )
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--spawn", action="store_true", help="start a viewer (the default)")
    where.add_argument("--connect", action="store_true", help="show it in a viewer that is running")
    where.add_argument("--save", metavar="FILE.rrd", help="write a Rerun file, which `rerun FILE.rrd` opens")


def run(parsed: Namespace) -> int:
    """Show it."""
    from heli_twin.viewing.show import destination, flights

    where = parsed.save or ("connect" if parsed.connect else "spawn")
    flights([path for path in (parsed.log, parsed.other) if path]).show(destination(where))
    if parsed.save:
        print(f"wrote {clean(parsed.save)}: open it with `{pasteable('rerun', Path(parsed.save))}`")
    return 0
