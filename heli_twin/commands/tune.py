"""`heli-twin tune`: find a controller's gains on the twin."""

import json
from argparse import ArgumentParser, Namespace, _SubParsersAction
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from heli_twin.commands import add_experiment, command, experiment_arguments, file_path, progress_bar, say
from heli_twin.commands.margins import print_margins
from heli_twin.errors import HeliTwinError
from heli_twin.terminal_text import pasteable
from heli_twin.whole_file import write_whole

if TYPE_CHECKING:
    from heli_twin.experiment import Experiment
    from heli_twin.metrics.margins import Margins
    from heli_twin.tuning.search import Tuned

KINDS = {
    "pid": ["controller=pid"],
    "mpc": ["controller=ltv_mpc"],
    "detailed": ["controller=detailed_mpc", "estimator=detailed_kalman"],
}


def add(subparsers: "_SubParsersAction[ArgumentParser]") -> None:
    """Add the command."""
    parser = command(
        subparsers,
        "tune",
        run,
        "tune the gains of a PID or the weights of an MPC on the twin",
        "Tune a controller on the twin and print the result as TOML that `heli-twin fly` takes. For the PID, Ziegler\n"
        "and Nichols' experiment finds Ku and Tu of every axis first; then a bounded search lowers the MPC's own cost\n"
        "(26) on quick moves under gusts. The weights of the paper's MPC and of the one with the detailed model are\n"
        "searched with the same budget. All keep a gain margin of two and fly attitudes of 10 to 18 rad/s as well.\n"
        "At the end the margins are measured; see `heli-twin margins`.",
        "  heli-twin tune pid --save pid.toml && heli-twin fly pid.toml\n"
        "  heli-twin fly trajectory=hover controller=pid.toml    # the same in another experiment\n"
        "  heli-twin study run gust 'alternatives.tuned={controller=\"pid.toml\"}'    # against others\n"
        "  heli-twin tune pid --budget 1                         # Ziegler and Nichols alone\n"
        "  heli-twin tune pid controller.feed_forward=flat\n"
        "  heli-twin tune mpc --budget 61 --json",
    )
    parser.add_argument("controller", choices=tuple(KINDS), help="what to tune")
    add_experiment(parser)
    parser.add_argument("--budget", type=int, metavar="N", help="trials of the search (default 37; 1: none)")
    parser.add_argument(
        "--save", type=file_path, metavar="FILE.toml", help="write the controller for `heli-twin fly` here"
    )
    parser.add_argument("--json", action="store_true", help="print the result as JSON, for programs")


def run(parsed: Namespace) -> int:
    """Tune, print, save."""
    from heli_twin.experiment.text import load
    from heli_twin.tuning.search import DEFAULT_BUDGET

    budget = DEFAULT_BUDGET if parsed.budget is None else parsed.budget
    if budget < 1:
        raise HeliTwinError(
            f"--budget {budget} leaves nothing to try: 1 judges the start, {DEFAULT_BUDGET} is the default"
        )
    source, overrides = experiment_arguments(parsed)
    base = load(source, [*KINDS[parsed.controller], *overrides])
    tuned = _tuned(base, budget)
    of_loops = _margins(base, tuned)
    text = toml(tuned, pasteable("heli-twin", "tune", parsed.controller, *parsed.experiment, "--budget", budget))
    if parsed.save:
        try:
            write_whole(parsed.save, text.encode())
        except OSError as error:
            raise HeliTwinError(f"cannot write {parsed.save}: {error.strerror}") from None
    if parsed.json:
        plain = {axis: m.plain() for axis, m in of_loops.items()}
        print(json.dumps(tuned.as_json() | {"margins": plain}, indent=2, allow_nan=False))
    else:
        show(tuned, text, parsed.save)
        print_margins("margins of the tuned controller on the twin", of_loops)
    return 0


def _tuned(base: "Experiment", budget: int) -> "Tuned":
    from controllers.laws.pid import Pid
    from heli_twin.metrics.tracking import AXES
    from heli_twin.tuning.search import tune
    from heli_twin.tuning.ultimate_gain import find_ultimate
    from heli_twin.workers.fleet import fleet

    with progress_bar() as bar, fleet() as fly_all:
        ultimates = []
        if isinstance(base.controller, Pid):
            task = bar.add_task("ultimate gains, axes", total=len(AXES))
            for ultimate in fly_all(partial(find_ultimate, base), AXES):
                ultimates.append(ultimate)
                bar.advance(task)
        task = bar.add_task("search, trials", total=budget)
        return tune(base, fly_all, budget, tuple(ultimates), lambda: bar.advance(task))


def _margins(base: "Experiment", tuned: "Tuned") -> "dict[str, Margins]":
    from dataclasses import replace

    from heli_twin.tuning.margins import law_margins

    return law_margins(replace(base, controller=tuned.law))


def toml(tuned: "Tuned", command_line: str) -> str:
    """The controller as a file for `heli-twin fly`, or for `controller=FILE.toml`, with the record of its tuning.

    Args:
        tuned: The result.
        command_line: Tunes it again.
    """
    from heli_twin.experiment.tree import physics_line
    from heli_twin.tuning.record import comment

    lines = [f"{name} = {json.dumps(value)}" for name, value in tuned.table().items()]
    record = comment({"command": command_line} | tuned.record())
    served = [] if tuned.estimator is None else [f'estimator = "{tuned.estimator}"', ""]
    return "\n".join([record, "", physics_line(), "", *served, "[controller]", *lines, ""])


def show(tuned: "Tuned", text: str, saved: Path | None) -> None:
    """Print a result for a person."""
    from rich.console import Console
    from rich.table import Table

    console = Console()
    if tuned.ultimates:
        table = Table(title="Ziegler and Nichols' experiment", title_justify="left")
        for column in ("", "Ku", "Tu", "damping given first"):
            table.add_column(column, justify="right" if column else "left")
        for u in tuned.ultimates:
            table.add_row(u.axis, f"{u.gain:.3g}", f"{u.period:.3g} s", f"{u.damping:.3g}" if u.damping else "-")
        console.print(table)
    table = Table(title=f"search, {tuned.trials} trials: share of the cost (26)", title_justify="left")
    for column in ("", "at the start", "tuned", "gains at the start", "tuned "):
        table.add_column(column, justify="right" if column else "left")
    for axis, cost in tuned.best.cost.items():
        gains = (", ".join(f"{g:.3g}" for g in trial.gains[axis].values()) for trial in (tuned.start, tuned.best))
        table.add_row(axis, f"{tuned.start.cost[axis]:.4g}", f"{cost:.4g}", *gains)
    console.print(table)
    for line in text.splitlines():
        say(line)
    if saved:
        say(f"wrote {saved}")
