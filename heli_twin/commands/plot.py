"""`heli-twin plot`: recorded flights as a figure for a paper."""

from argparse import ArgumentParser, Namespace, _SubParsersAction
from pathlib import Path

from heli_twin.commands import command, file_path, say
from heli_twin.errors import HeliTwinError
from heli_twin.whole_file import free_path


def add(subparsers: "_SubParsersAction[ArgumentParser]") -> None:
    """Add the command."""
    parser = command(
        subparsers,
        "plot",
        run,
        "draw recorded flights as a figure for a paper (svg, pdf, png)",
        "Draw recorded flights as a figure for a paper; no window opens. Several flights lie over each other in their\n"
        "own colours; inputs and estimates stand side by side. What can be drawn:\n"
        "  tracking  flown, reference and error of x, y, z and yaw (the default)\n"
        "  inputs    sent and acting, with the feed-forward and the believed limits\n"
        "  path      from above and from the side\n"
        "  estimate  the estimator's error with two of its standard deviations, and the poses\n"
        "  timing    measured times of control step and solver\n"
        "  distance  the least distance of several helicopters, flown and planned\n"
        "  all       everything that the logs hold, on one long page\n"
        "With --require: the moments at which a flight comes nearest to breaking a requirement, with margins.\n"
        "Grey: no poses. Red bar above: a fault. Dotted: what the supervisor decided, touch-down, the end.",
        "  heli-twin plot logs/RUN.mcap\n"
        "  heli-twin plot A.mcap B.mcap --names MPC,PID --out compared.pdf\n"
        "  heli-twin plot logs/RUN.mcap --require hover\n"
        "  heli-twin plot logs/RUN.mcap --what inputs --from 5 --to 12 --width 3.5 --out fig3.svg",
    )
    parser.add_argument("logs", nargs="+", type=file_path, metavar="RUN.mcap", help="logs that heli-twin recorded")
    parser.add_argument("--what", default="tracking", metavar="KIND", help="what to draw (default tracking)")
    parser.add_argument(
        "--out",
        type=file_path,
        metavar="FILE.svg|pdf|png",
        help="the file to write (default: RUN-KIND.svg in the working folder, under a name that is free)",
    )
    parser.add_argument("--from", dest="start", type=float, metavar="SECONDS", help="first moment (default 0)")
    parser.add_argument("--to", dest="end", type=float, metavar="SECONDS", help="last moment (default: the end)")
    parser.add_argument("--names", metavar="A,B,...", help="for the legend (default: what differs between the flights)")
    parser.add_argument("--require", metavar="REQ.toml|NAME", help="requirements, as `heli-twin judge` takes them")
    parser.add_argument(
        "--width", type=float, default=7.16, metavar="INCHES", help="7.16 fills a page, 3.5 a column (default 7.16)"
    )
    parser.add_argument("--force", action="store_true", help="replace the file if it exists")


def run(parsed: Namespace) -> int:
    """Draw and write."""
    out = parsed.out or free_path(Path(f"{parsed.logs[0].name.replace('.mcap', '')}-{parsed.what}.svg"))
    if parsed.out is not None:
        require_free(out, parsed.force)
    from heli_twin.plots.figure import form_of, plot, save

    form_of(out)
    names = None if parsed.names is None else parsed.names.split(",")
    window = {"start": parsed.start, "end": parsed.end}
    figure = plot(
        *parsed.logs, what=parsed.what, names=names, width=parsed.width, requirements=parsed.require, **window
    )
    save(figure, out)
    say(f"wrote {out}")
    return 0


def require_free(out: Path, force: bool) -> None:
    """Check that a file can be written.

    Raises:
        HeliTwinError: It exists already, or there is no such folder.
    """
    if out.exists() and not force:
        raise HeliTwinError(f"{out} exists already: choose another name, or replace it with --force")
    if not out.parent.is_dir():
        raise HeliTwinError(f"cannot write {out}: there is no folder {out.parent}")
