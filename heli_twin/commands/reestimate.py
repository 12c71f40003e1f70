"""`heli-twin reestimate`: run the estimator again on a log."""

from argparse import ArgumentParser, Namespace, _SubParsersAction
from typing import TYPE_CHECKING

from heli_twin.commands import add_with, command, file_path, load_with

if TYPE_CHECKING:
    from heli_twin.reanalysis.reestimate import Consistency, Reestimation
    from heli_twin.recording import Log
    from heli_twin.recording.log import Estimates


def add(subparsers: "_SubParsersAction[ArgumentParser]") -> None:
    """Add the command."""
    parser = command(
        subparsers,
        "reestimate",
        run,
        "run the estimator again on logged poses and commands",
        "Run the estimator on the poses and commands of a log and print its error against the truth and whether it\n"
        "knows its error (NEES, NIS). Without changes its estimates have to be the logged ones: bit for bit on the\n"
        "same host and build, elsewhere within 1e-9; exit code 1 means they are not.",
        "  heli-twin reestimate RUN.mcap\n"
        "  heli-twin reestimate RUN.mcap estimator.roll_forward=false\n"
        "  heli-twin reestimate RUN.mcap estimator.velocity_walk=0.5 controller.model.b_x=2.2",
    )
    parser.add_argument("log", type=file_path, metavar="RUN.mcap", help="a log with poses")
    parser.add_argument(
        "overrides",
        nargs="*",
        default=[],
        metavar="estimator.path=value",
        help="changes of the estimator, or of controller.model, which it believes in",
    )
    add_with(parser)
    parser.add_argument("--yes", action="store_true", help="do it even if it takes longer than ten minutes")


def run(parsed: Namespace) -> int:
    """Run it again; the exit code is 1 when an unchanged estimator says something else."""
    import numpy as np

    from heli_twin.logbook import flown_experiment
    from heli_twin.reanalysis.effort import ESTIMATOR_STEP_S, require_agreement
    from heli_twin.reanalysis.reestimate import ESTIMATE_TOLERANCE, largest_difference, reestimate, same_bits
    from heli_twin.recording import read_log

    load_with(parsed)
    log = read_log(parsed.log)
    steps = max(len(log.estimate.time), len(log.sent.time), len(log.pose.time))
    require_agreement(ESTIMATOR_STEP_S * steps, "running the estimator again", parsed.yes)
    again = reestimate(log, parsed.overrides)
    count, changed = len(again.estimates.time), again.experiment != flown_experiment(log)
    difference = largest_difference(again.estimates, log.estimate)
    if changed or not len(log.estimate.time):
        difference = 0.0
        print(f"{count} estimates, {len(log.estimate.time)} in the log")
    elif same_bits(again.estimates, log.estimate):
        print(f"{count} estimates, each bit for bit the logged one")
    else:
        print(f"{count} estimates, not all the logged ones: they differ by {difference:.3g} (SI)")
    with np.errstate(all="ignore"):
        show_errors(log, again)
        show_consistency(log, again)
    return 0 if difference <= ESTIMATE_TOLERANCE else 1


def show_errors(log: "Log", again: "Reestimation") -> None:
    """Print how far the estimates were from the truth."""
    from rich import box
    from rich.console import Console
    from rich.table import Table

    if len(log.truth.time) < 2:
        print("error against the truth: unknown, the log has no /truth")
        return
    table = Table(title="estimate minus truth, when it holds", title_justify="left", box=box.SIMPLE, pad_edge=False)
    columns = ("", "x", "y", "z", "yaw", "vx", "vy", "vz", "r")
    units = ("", "mm", "mm", "mm", "deg", "mm/s", "mm/s", "mm/s", "deg/s")
    for column, unit in zip(columns, units, strict=True):
        table.add_column(f"{column}\n{unit}", justify="right" if column else "left", no_wrap=True)
    for name, estimates in (("logged", log.estimate), ("again", again.estimates)):
        rms, largest = _size(estimates, log)
        table.add_row(f"{name}: rms", *rms)
        table.add_row(f"{name}: largest", *largest)
    Console().print(table)


def _size(estimates: "Estimates", log: "Log") -> tuple[list[str], list[str]]:
    """Root mean square and largest error of each state, as text."""
    import numpy as np

    from heli_twin.reanalysis.reestimate import error

    _, errors = error(estimates, log.truth)
    if not len(errors):
        return ["-"] * 8, ["-"] * 8
    unit = np.array([1000.0, 1000.0, 1000.0, 180 / np.pi])[:, None]
    scaled = np.abs(unit * errors).transpose(0, 2, 1).reshape(-1, 8)
    rows = np.sqrt((scaled**2).mean(axis=0)), scaled.max(axis=0)
    return [f"{v:.3g}" for v in rows[0]], [f"{v:.3g}" for v in rows[1]]


def show_consistency(log: "Log", again: "Reestimation") -> None:
    """Print whether the estimator knows its error."""
    from heli_twin.reanalysis.reestimate import Consistency

    _line("NEES, position and velocity", again.nees(log.truth))
    _line("NIS, poses", again.nis())
    squared = again.innovation**2 / again.innovation_variance
    for i, axis in enumerate(("x", "y", "z", "yaw")):
        _line(f"  NIS of {axis}", Consistency(1, squared[:, i]))
    if len(again.estimates.rejected):
        print(f"{int(again.estimates.rejected[-1])} poses refused")


def _line(name: str, found: "Consistency") -> None:
    from heli_twin.reanalysis.reestimate import CHI2_95

    if not len(found.values):
        print(f"{name + ':':<30} unknown")
        return
    low, high = CHI2_95[found.freedom]
    print(
        f"{name + ':':<30} mean {found.values.mean():.2f} (consistent: {found.freedom}),"
        f" {100 * found.inside:.0f} % inside [{low:.2g}, {high:.3g}] (consistent: 95 %)"
    )
