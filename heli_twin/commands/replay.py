"""`heli-twin replay`: a recorded flight in Rerun, or two side by side."""

import subprocess
from argparse import ArgumentParser, Namespace, _SubParsersAction
from pathlib import Path

from heli_twin.commands import command, file_path, say
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
        "show a recorded flight in Rerun, or two in one scene",
        "Show a recorded flight in Rerun, the same picture as while it was flown.\n"
        "Of two logs both helicopters fly in one scene, A blue and B pink; the plots hold the errors of both and\n"
        "how far B is from A, and a table says what differs between the experiments.",
        "  heli-twin replay logs/RUN.mcap\n"
        "  heli-twin replay logs/RUN.mcap --save flight.rrd\n"
        "  heli-twin replay logs/A.mcap logs/B.mcap --tab inputs\n"
        "  heli-twin replay logs/RUN.mcap --connect\n"
        "  heli-twin replay logs/RUN.mcap --web        # in a browser, also over SSH",
    )
    parser.add_argument("log", type=file_path, metavar="RUN.mcap", help="a log that heli-twin recorded")
    parser.add_argument(
        "other", type=file_path, nargs="?", metavar="OTHER.mcap", help="a second one to compare it with"
    )
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--spawn", action="store_true", help="start a viewer (the default)")
    where.add_argument("--connect", action="store_true", help="show it in a viewer that is running")
    where.add_argument("--save", metavar="FILE.rrd", help="write a Rerun file, which `rerun FILE.rrd` opens")
    where.add_argument("--web", action="store_true", help="serve it to a browser, on this machine only, until Ctrl-C")
    parser.add_argument(
        "--port", type=int, default=WEB_PORT, metavar="N", help=f"of --web; N + 1 is used too (default {WEB_PORT})"
    )
    parser.add_argument(
        "--tab", default="", metavar="NAME", help="the plots in front, as `heli-twin snapshot` has them"
    )


def run(parsed: Namespace) -> int:
    """Show it."""
    from heli_twin.viewing.show import destination, flights, in_browser

    shown = flights([path for path in (parsed.log, parsed.other) if path])
    if parsed.web:
        with in_browser(shown, web_port(parsed.port), parsed.tab) as server:
            tell_web_address(parsed.port)
            return wait(server)
    shown.show(destination(parsed.save or ("connect" if parsed.connect else "spawn")), parsed.tab)
    if parsed.save:
        print(f"wrote {clean(parsed.save)}: open it with `{pasteable('rerun', Path(parsed.save))}`")
    return 0


def web_port(port: int) -> int:
    """Return a port if it can be one.

    Raises:
        HeliTwinError: It cannot.
    """
    if not 1024 <= port <= 65534:
        raise HeliTwinError(f"--port {port}: give one from 1024 to 65534")
    return port


def tell_web_address(port: int) -> None:
    """Say where the page is, here and from another machine."""
    from heli_twin.viewing.viewer_process import web_address

    say(f"open {web_address(port)}")
    tunnel = f"ssh -L {port}:localhost:{port} -L {port + 1}:localhost:{port + 1} THIS_MACHINE"
    print(f"from another machine the same address, after `{tunnel}`; Ctrl-C ends it", flush=True)


def wait(server: subprocess.Popen[bytes]) -> int:
    """Serve until Ctrl-C, which is no failure."""
    try:
        return server.wait()
    except KeyboardInterrupt:
        return 0
