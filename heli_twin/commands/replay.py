"""`heli-twin replay`: a recorded flight in Rerun."""

from argparse import ArgumentParser, Namespace, _SubParsersAction
from pathlib import Path

from heli_twin.commands import command


def add(subparsers: "_SubParsersAction[ArgumentParser]") -> None:
    """Add the command."""
    parser = command(
        subparsers,
        "replay",
        run,
        "show a recorded flight in Rerun",
        "Show a recorded flight in Rerun, the same picture as while it was flown.",
        "  heli-twin replay logs/RUN.mcap\n"
        "  heli-twin replay logs/RUN.mcap --save flight.rrd\n"
        "  heli-twin replay logs/RUN.mcap --connect",
    )
    parser.add_argument("log", type=Path, metavar="RUN.mcap", help="a log that heli-twin recorded")
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--spawn", action="store_true", help="start a viewer (the default)")
    where.add_argument("--connect", action="store_true", help="show it in a viewer that is running")
    where.add_argument("--save", metavar="FILE.rrd", help="write a Rerun file, which `rerun FILE.rrd` opens")


def run(parsed: Namespace) -> int:
    """Show it."""
    from heli_twin.configuration import from_json
    from heli_twin.pictures import scales, sink
    from heli_twin.recording import read_log
    from heli_twin.recording.rerun_bridge import show

    log = read_log(parsed.log)
    where = parsed.save or ("connect" if parsed.connect else "spawn")
    show(log, sink(where), scales(from_json(log.experiment)))
    if parsed.save:
        print(f"wrote {parsed.save}: open it with `rerun {parsed.save}`")
    return 0
