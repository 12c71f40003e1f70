"""`heli-twin margins`: how far a control loop is from instability."""

import json
from argparse import ArgumentParser, Namespace, _SubParsersAction
from math import isfinite
from typing import TYPE_CHECKING

from heli_twin.commands import add_experiment, command, experiment_arguments, progress_bar

if TYPE_CHECKING:
    from heli_twin.metrics.margins import Margins


def add(subparsers: "_SubParsersAction[ArgumentParser]") -> None:
    """Add the command."""
    parser = command(
        subparsers,
        "margins",
        run,
        "gain margin, delay margin and peak sensitivity of a control law",
        "Measure how far each loop is from instability: a hover in still air with small sines on the commands, which\n"
        "the ground station does not know of, on the twin and on the helicopter that the law believes in. The gain\n"
        "margin is the factor on a stick's effect at which the loop becomes unstable, the delay margin the further\n"
        "delay at which it does. Ms, the peak sensitivity, is the factor by which the loop amplifies a disturbance at\n"
        "its worst frequency: below 2 is robust, above 3 is near a limit cycle. Battery, ground effect, servo play\n"
        "and spool-up are left out, for they are not linear.",
        "  heli-twin margins                                    # the lab\n"
        "  heli-twin margins controller.terminal=riccati\n"
        "  heli-twin margins detailed plant.attitude_frequency=10\n"
        "  heli-twin margins pid.toml --json",
    )
    add_experiment(parser)
    parser.add_argument("--json", action="store_true", help="print them as JSON, for programs; null: never unstable")


def run(parsed: Namespace) -> int:
    """Measure and print."""
    from heli_twin.experiment.text import load
    from heli_twin.tuning.margins import HELICOPTERS, law_margins

    source, overrides = experiment_arguments(parsed)
    experiment = load(source, overrides)
    with progress_bar() as bar:
        task = bar.add_task("margins, flights", total=len(HELICOPTERS))
        of_all = {}
        for helicopter in HELICOPTERS:
            of_all[helicopter] = law_margins(experiment, helicopter)
            bar.advance(task)
    if parsed.json:
        plain = {helicopter: {axis: m.plain() for axis, m in loops.items()} for helicopter, loops in of_all.items()}
        print(json.dumps(plain, indent=2, allow_nan=False))
        return 0
    titles = ("on the twin", "on the helicopter that the law believes in")
    for helicopter, title in zip(HELICOPTERS, titles, strict=True):
        print_margins(f"margins {title}", of_all[helicopter])
    return 0


def print_margins(title: str, loops: "dict[str, Margins]") -> None:
    """Print the margins of all loops for a person."""
    from rich.console import Console
    from rich.table import Table

    table = Table(title=title, title_justify="left")
    for column in ("", "gain margin", "delay margin", "Ms", "crossover"):
        table.add_column(column, justify="right" if column else "left")
    for axis, m in loops.items():
        gain = f"{m.gain:.2f}" if isfinite(m.gain) else "none"
        delay = f"{1e3 * m.delay:.0f} ms" if isfinite(m.delay) else "none"
        table.add_row(axis, gain, delay, f"{m.peak_sensitivity:.2f}", f"{m.crossover:.1f} rad/s")
    Console().print(table)
