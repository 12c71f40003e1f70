"""`heli-twin replay`: a recorded flight in Rerun, or two side by side."""

import subprocess
from argparse import ArgumentParser, Namespace, _SubParsersAction
from contextlib import suppress
from pathlib import Path
from threading import Event

from heli_twin.commands import command, say
from heli_twin.errors import HeliTwinError
from heli_twin.terminal_text import clean, pasteable

WEB_PORT = 9090
"""Of the page of the web viewer."""


def add(subparsers: "_SubParsersAction[ArgumentParser]") -> None:
    """Add the command."""
    parser = command(
        subparsers,
        "replay",
        run,
        "show recorded flights in Rerun: one, two in one scene, or a table of many",
        "Show a recorded flight in Rerun, the same picture as while it was flown.\n"
        "Of two logs both helicopters fly in one scene, A blue and B pink; the plots hold the errors of both and\n"
        "how far B is from A, and a table says what differs between the experiments.\n"
        "Of a study, a folder or more than two logs it is a table with a moving picture in each row, those that\n"
        "failed first; click a row's name to open the flight. It needs `pip install 'heli-twin[table]'`.",
        "  heli-twin replay logs/RUN.mcap\n"
        "  heli-twin replay logs/RUN.mcap --save flight.rrd\n"
        "  heli-twin replay logs/A.mcap logs/B.mcap --tab inputs\n"
        "  heli-twin replay logs/studies/mass           # every flight of a study\n"
        "  heli-twin replay logs/RUN.mcap --ghost calibration.toml   # beside what the twin predicts\n"
        "  heli-twin replay logs/RUN.mcap --require hover   # and where it comes nearest to breaking a requirement\n"
        "  heli-twin replay logs/RUN.mcap --connect\n"
        "  heli-twin replay logs/RUN.mcap --web        # in a browser, also over SSH",
    )
    parser.add_argument(
        "logs", type=Path, nargs="+", metavar="RUN.mcap | FOLDER", help="logs, or the folder of a study or of logs"
    )
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--spawn", action="store_true", help="start a viewer (the default)")
    where.add_argument("--connect", action="store_true", help="show it in a viewer that is running")
    where.add_argument("--save", metavar="FILE.rrd", help="write a Rerun file, which `rerun FILE.rrd` opens")
    where.add_argument("--web", action="store_true", help="serve it to a browser, on this machine only, until Ctrl-C")
    parser.add_argument(
        "--port", type=int, default=WEB_PORT, metavar="N", help=f"of --web; N + 1 is used too (default {WEB_PORT})"
    )
    add_ghost(parser)
    parser.add_argument("--require", metavar="REQ.toml|NAME", help="requirements, as `heli-twin judge` takes them")
    parser.add_argument(
        "--tab", default="", metavar="NAME", help="the plots in front, as `heli-twin snapshot` has them"
    )


def add_ghost(parser: ArgumentParser) -> None:
    """Add `--ghost`."""
    parser.add_argument(
        "--ghost",
        default="",
        metavar="calibration.toml",
        help="of one log: what this twin predicts, translucent; every two seconds it starts again from the poses, and"
        " flies by the sent commands alone",
    )


def run(parsed: Namespace) -> int:
    """Show it."""
    from heli_twin.viewing.show import destination, flights, in_browser

    if len(parsed.logs) > 2 or any(path.is_dir() for path in parsed.logs):
        if parsed.require:
            raise HeliTwinError("--require judges one flight or two: name their logs")
        return show_table(parsed)
    shown = flights(parsed.logs, parsed.require)
    if parsed.ghost:
        from heli_twin.validation.ghost import with_ghost

        shown = with_ghost(shown, parsed.ghost)
    if parsed.web:
        with in_browser(shown, web_port(parsed.port), parsed.tab) as server:
            tell_web_address(parsed.port)
            return wait(server)
    shown.show(destination(parsed.save or ("connect" if parsed.connect else "spawn")), parsed.tab)
    if parsed.save:
        print(f"wrote {clean(parsed.save)}: open it with `{pasteable('rerun', Path(parsed.save))}`")
    return 0


def show_table(parsed: Namespace) -> int:
    """Show many flights as a table, until it is closed.

    Raises:
        HeliTwinError: There are none, or nothing to show them with.
    """
    from heli_twin.studies.browse import table_of
    from heli_twin.viewing.flight_table import served
    from heli_twin.viewing.show import VIEWER_PORT, destination
    from heli_twin.viewing.viewer_process import has_screen, is_viewer, open_in_viewer, refuse_taken, web_viewer, window

    if parsed.save:
        raise HeliTwinError("a table of flights needs Rerun's server and fits into no file: use --web or --spawn")
    where = destination("connect" if parsed.connect else "spawn")
    if not parsed.web and not (is_viewer(VIEWER_PORT) if parsed.connect else has_screen()):
        raise HeliTwinError(where.no_viewer())
    if parsed.web:
        refuse_taken(web_port(parsed.port) + 1)
    flights = table_of(parsed.logs)
    say(f"{flights.title}: {len(flights.logs)} flights, {len([log for log in flights.logs if log])} with a log")
    with served(flights, parsed.port + 1 if parsed.web else None) as address:
        if parsed.web:
            with web_viewer(address, parsed.port) as server:
                tell_web_address(parsed.port, address)
                return wait(server)
        if parsed.connect:
            open_in_viewer(VIEWER_PORT, address)
            print("the viewer shows the table; Ctrl-C ends it", flush=True)
            return wait(None)
        with window(address) as viewer:
            return wait(viewer)


def web_port(port: int) -> int:
    """Return a port if it can be one.

    Raises:
        HeliTwinError: It cannot.
    """
    if not 1024 <= port <= 65534:
        raise HeliTwinError(f"--port {port}: give one from 1024 to 65534")
    return port


def tell_web_address(port: int, source: str = "") -> None:
    """Say where the page is, here and from another machine."""
    from heli_twin.viewing.viewer_process import web_address

    say(f"open {web_address(port, source)}")
    tunnel = f"ssh -L {port}:localhost:{port} -L {port + 1}:localhost:{port + 1} THIS_MACHINE"
    print(f"from another machine the same address, after `{tunnel}`; Ctrl-C ends it", flush=True)


def wait(process: "subprocess.Popen[bytes] | None") -> int:
    """Wait until a viewer is closed or Ctrl-C, neither of which is a failure."""
    with suppress(KeyboardInterrupt):
        if process is None:
            Event().wait()
        else:
            process.wait()
    return 0
