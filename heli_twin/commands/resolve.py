"""`heli-twin resolve`: solve every control problem of a log again."""

from argparse import ArgumentParser, Namespace, _SubParsersAction
from pathlib import Path
from typing import TYPE_CHECKING

from heli_twin.commands import add_with, command, file_path, load_with, say

if TYPE_CHECKING:
    from heli_twin.reanalysis.resolve import Resolution
    from heli_twin.recording import Log


def add(subparsers: "_SubParsersAction[ArgumentParser]") -> None:
    """Add the command."""
    parser = command(
        subparsers,
        "resolve",
        run,
        "solve every logged control problem again, as it was or with another controller",
        "Rebuild every control problem from the logged estimates, nominal inputs and reference and solve it again.\n"
        "Without changes the inputs have to be those sent: bit for bit on the same host and build, elsewhere within\n"
        "1e-4 of full stick; exit code 1 means they are not. With changes the new inputs and plans are written to\n"
        "RUN.resolved.mcap, which `heli-twin replay RUN.mcap RUN.resolved.mcap` shows beside the flown ones.",
        "  heli-twin resolve RUN.mcap\n"
        "  heli-twin resolve RUN.mcap controller.horizon=12 controller.coupling=full\n"
        "  heli-twin resolve PID.mcap controller.kind=ltv_mpc    # what the MPC would have done",
    )
    parser.add_argument("log", type=file_path, metavar="RUN.mcap", help="a log with estimates")
    parser.add_argument(
        "overrides",
        nargs="*",
        default=[],
        metavar="controller.path=value",
        help="changes of the controller; trajectory=... for a log without a reference",
    )
    parser.add_argument(
        "--log-dir", type=Path, metavar="DIR", help="where the new log goes (default beside RUN.mcap; needs changes)"
    )
    add_with(parser)
    parser.add_argument("--yes", action="store_true", help="do it even if it takes longer than ten minutes")


def run(parsed: Namespace) -> int:
    """Solve again; the exit code is 1 when unchanged problems have other answers."""
    import numpy as np

    from heli_twin.logbook import flown_experiment
    from heli_twin.reanalysis.effort import control_effort, require_agreement
    from heli_twin.reanalysis.resolve import INPUT_TOLERANCE, resolve, resolved_experiment, write
    from heli_twin.recording import read_log
    from heli_twin.recording.reader import of_ship
    from heli_twin.whole_file import free_path

    load_with(parsed)
    log = read_log(parsed.log)
    experiment = resolved_experiment(log, parsed.overrides)
    require_agreement(control_effort(experiment, len(log.estimate.time)), "solving these problems again", parsed.yes)
    resolution = resolve(log, parsed.overrides)
    # What sent the inputs of a real flight is not known.
    differs = resolution.experiment != flown_experiment(log) or log.origin == "import"
    with np.errstate(all="ignore"):
        report(log, resolution)
    if differs or parsed.log_dir:
        flown, ship = of_ship(parsed.log)
        stem = f"{flown.stem}-{ship}" if ship else flown.stem
        path = free_path((parsed.log_dir or flown.parent) / f"{stem}.resolved.mcap")
        write(log, resolution, path)
        say(f"wrote {path}: inputs and plans are new, all else is as flown")
    return 0 if differs or abs(resolution.difference).max() <= INPUT_TOLERANCE else 1


def report(log: "Log", resolution: "Resolution") -> None:
    """Print how the answers differ from the inputs flown."""
    import numpy as np
    from rich.console import Console
    from rich.table import Table

    flown, u = resolution.flown, resolution.u
    equal = int(np.count_nonzero((u == flown).all(axis=1)))
    largest = float(np.abs(resolution.difference).max())
    print(
        f"{len(u)} control problems: u_0 is bit for bit the input sent in {equal},"
        f" largest difference {largest:.3g} of full stick"
    )
    table = Table(title="new input minus input sent, fraction of full stick", title_justify="left")
    for column in ("", "pitch", "roll", "thrust", "yaw"):
        table.add_column(column, justify="right" if column else "left")
    difference = resolution.difference
    for name, values in (
        ("mean", difference.mean(axis=0)),
        ("mean size", np.abs(difference).mean(axis=0)),
        ("largest size", np.abs(difference).max(axis=0)),
    ):
        table.add_row(name, *(f"{value:.3g}" for value in values))
    Console().print(table)
    _solver(log, resolution)


def _solver(log: "Log", resolution: "Resolution") -> None:
    """Print how the problems were solved, in flight and now."""
    from collections import Counter

    import numpy as np

    from heli_twin.metrics.tracking import milliseconds

    reports = [answer.qp.status for answer in resolution.commands if answer.qp]
    for name, statuses, ns in (
        ("in flight", log.qp.status.tolist(), log.timing.solve_ns),
        ("again", reports, np.array([answer.solve_ns for answer in resolution.commands], np.int64)),
    ):
        counts = ", ".join(f"{count} {status}" for status, count in sorted(Counter(statuses).items())) or "none"
        times = ", ".join(f"{key} {value:.2f} ms" for key, value in milliseconds(ns).items() if value is not None)
        say(f"{name:<10} {counts}; solving took {times or 'no time'}")
