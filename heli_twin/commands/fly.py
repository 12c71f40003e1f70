"""`heli-twin fly`: fly one experiment, print what happened, leave a log."""

import json
import sys
from argparse import ArgumentParser, Namespace, _SubParsersAction
from pathlib import Path
from typing import TYPE_CHECKING, Any

from heli_twin.commands import add_experiment, command, experiment_arguments, names_several, progress_bar, say
from heli_twin.commands._several import fly_together
from heli_twin.commands.judge import BROKEN, verdicts_on
from heli_twin.commands.judge import show as show_verdicts
from heli_twin.terminal_text import clean

if TYPE_CHECKING:
    from heli_twin.experiment.envelope import Envelope
    from heli_twin.mission import Result
    from heli_twin.requirements import Requirement


def add(subparsers: "_SubParsersAction[ArgumentParser]") -> None:
    """Add the command."""
    parser = command(
        subparsers,
        "fly",
        run,
        "fly the twin, print the result, leave an MCAP log",
        "Fly one experiment, print what happened and leave an MCAP log that any viewer opens.\n"
        "The presets pair, swap4, swap8, crossing_circles and formation are of several helicopters in one room, and\n"
        "so is a TOML file with a scenario or ships; `heli-twin guide several` tells more.\n"
        "`heli-twin show` lists every field that can be changed.\n"
        "Exit code: 0 completed or landed, 1 ended early or no log could be kept, 2 a mistake in what was asked for,\n"
        "3 a requirement of --require is broken, or\n"
        "3 invalid: the program of an external control law died, sent nonsense or did not answer within 10 s;\n"
        "the environment variable HELI_TWIN_EXTERNAL_LIMIT gives another limit, s.",
        "  heli-twin fly\n"
        "  heli-twin fly trajectory=hover seed=3\n"
        "  heli-twin fly plant.mass=0.031 controller.horizon=12\n"
        "  heli-twin fly ideal mocap.latency=0.04 estimator.roll_forward=false\n"
        "  heli-twin fly mine.toml --rerun flight.rrd\n"
        "  heli-twin fly controller=external controller.command=./pid\n"
        "  heli-twin fly trajectory=hover --require hover\n"
        "  heli-twin fly swap4 scenario.radius=1.0 plant.mass=0.029 ships.a.plant.mass=0.027\n"
        "  heli-twin fly --no-log --json | jq .max_abs_error",
    )
    add_experiment(parser)
    parser.add_argument(
        "--log-dir", type=Path, default=Path("logs"), metavar="DIR", help="where logs go (default logs/)"
    )
    parser.add_argument("--no-log", action="store_true", help="keep no log")
    parser.add_argument(
        "--rerun",
        metavar="spawn|connect|FILE.rrd",
        help="stream to a viewer or a Rerun file while flying; of several helicopters, afterwards",
    )
    parser.add_argument(
        "--require",
        metavar="REQ.toml|NAME",
        help="judge the flight by these requirements; the exit code is 3 if one is broken (`heli-twin judge --help`)",
    )
    parser.add_argument(
        "--embed-source",
        action="store_true",
        help="attach the source of your own control law, trajectory, ... to the log; its hash is there in any case",
    )
    parser.add_argument("--json", action="store_true", help="print the result as JSON, for programs")


def run(parsed: Namespace) -> int:
    """Fly; the exit code is 0 when the flight completed, 1 when it ended early or its log could not be kept.

    It is 3 when the run is invalid.
    """
    from heli_twin.experiment.envelope import envelope_in
    from heli_twin.experiment.text import load
    from heli_twin.mission import Pictures, fly

    source, overrides = experiment_arguments(parsed)
    if source is not None and names_several(source):
        return fly_together(parsed, source, overrides, requirements_named(parsed.require))
    experiment, envelope = load(source, overrides), envelope_in(source)
    requirements = requirements_named(parsed.require)
    with progress_bar() as bar:
        task = bar.add_task("flying, s", total=experiment.duration)
        result = fly(
            experiment,
            log_dir=None if parsed.no_log else parsed.log_dir,
            rerun=Pictures(parsed.rerun, requirements) if parsed.rerun and requirements else parsed.rerun,
            progress=lambda t: bar.update(task, completed=t),
            embed_source=parsed.embed_source,
        )
    if envelope and source:
        warn_outside(source, envelope, result)
    summary = result.summary()
    verdicts = verdicts_on(requirements, result)
    if verdicts:
        summary["requirements"] = {name: verdict.plain() for name, verdict in verdicts.items()}
    if parsed.json:
        print(json.dumps(summary, indent=2, allow_nan=False))
    else:
        show(summary)
        if verdicts:
            show_verdicts(verdicts)
    broken = any(not verdict.holds for verdict in verdicts.values())
    return BROKEN if broken else exit_code(result)


def requirements_named(source: str | None) -> "tuple[Requirement, ...]":
    """Read the requirements before the flight, so that a mistake in them costs none."""
    if source is None:
        return ()
    from heli_twin.requirements import requirements_of

    return requirements_of(source)


def warn_outside(source: str, envelope: "Envelope", result: "Result") -> None:
    """Say where a flight left what the calibration covered that it was flown on."""
    from heli_twin.metrics.reach import flown_reach

    left = envelope.left_by(flown_reach(result.log))
    if left:
        print(
            f"heli-twin: {clean(source, 200)} is a guess for this flight, which left what its flights covered:"
            f" {'; '.join(left)}",
            file=sys.stderr,
        )


INVALID_RUN = 3
"""The exit code of a run that says nothing about its controller, since the controller's own process failed."""


def exit_code(result: "Result") -> int:
    """The exit code that tells how a flight ended."""
    from heli_twin.flight import INTACT, INVALID

    if result.outcome.kind == INVALID:
        return INVALID_RUN
    return 0 if result.outcome.kind in INTACT and not result.log_trouble else 1


def show(summary: dict[str, Any]) -> None:
    """Print a result for a person."""
    from heli_twin.reporting.terminal_tables import control_problems, print_errors

    say(f"{summary['outcome']}: {summary['outcome_text']}")
    if summary["outcome"] == "invalid":
        say("it has no digest and no errors to tell" + (f"; log {summary['log']}" if summary["log"] else ""))
        return
    print_errors(summary)
    say(f"control problems: {control_problems(summary)}")
    say(f"{summary['real_time_factor']:.0f} times real time, digest {summary['flight_digest'][:16]}")
    if summary["log"]:
        say(f"log {summary['log']}")
