"""`heli-twin trajectories`: list the trajectories with a sketch and their demands on the helicopter."""

import json
from argparse import ArgumentParser, Namespace, _SubParsersAction
from typing import TYPE_CHECKING, Any

from heli_twin.commands import add_experiment, command, experiment_arguments

if TYPE_CHECKING:
    from heli_twin.experiment import Experiment
    from heli_twin.reporting.trajectory_survey import Survey


def add(subparsers: "_SubParsersAction[ArgumentParser]") -> None:
    """Add the command."""
    parser = command(
        subparsers,
        "trajectories",
        run,
        "list the trajectories with a sketch and what they demand",
        "List every trajectory with its defaults: a sketch, the largest inputs and speeds against the limits that the\n"
        "controller believes, and whether it can be flown. Given an experiment, show that experiment's trajectory.",
        "  heli-twin trajectories\n"
        "  heli-twin trajectories trajectory=circle trajectory.rate=2.5\n"
        "  heli-twin trajectories trajectory=waypoints trajectory.points=my_points.csv trajectory.corners=pass\n"
        "  heli-twin trajectories trajectory=csv trajectory.rows=my_flight.csv\n"
        "  heli-twin trajectories --json | jq '.circle.peak'",
    )
    add_experiment(parser)
    parser.add_argument("--json", action="store_true", help="print the demands as JSON, for programs")


def run(parsed: Namespace) -> int:
    """Survey and print; the exit code is 1 where an asked-for trajectory cannot be flown."""
    from dataclasses import replace

    from heli_twin.experiment.families import members
    from heli_twin.experiment.text import load
    from heli_twin.reporting.trajectory_survey import show, survey

    source, overrides = experiment_arguments(parsed)
    experiment = load(source, overrides)
    chosen = {tree_kind(experiment): experiment.trajectory}
    if source is None and not overrides:
        chosen = {kind: spec() for kind, spec in members("controllers.trajectories").items()}
    surveys = {kind: survey(replace(experiment, trajectory=trajectory)) for kind, trajectory in chosen.items()}
    if parsed.json:
        print(json.dumps({kind: _plain(result) for kind, result in surveys.items()}, indent=2))
    else:
        for kind, result in surveys.items():
            show(kind, (type(chosen[kind]).__doc__ or "").partition("\n")[0], result)
    return 1 if any(result.complaint for result in surveys.values()) else 0


def tree_kind(experiment: "Experiment") -> str:
    """The `kind` of an experiment's trajectory."""
    from heli_twin.experiment.tree import tree_of

    return str(tree_of(experiment)["trajectory"]["kind"])


def _plain(result: "Survey") -> dict[str, Any]:
    import numpy as np

    from heli_twin.reporting.trajectory_survey import DEMANDS

    names = [name.replace(" ", "_") for name, _ in DEMANDS]
    peak, limit = np.nan_to_num(result.peak).tolist(), result.limit.tolist()
    return {
        "feasible": not result.complaint,
        "complaint": result.complaint,
        "peak": dict(zip(names, peak, strict=True)),
        "limit": dict(zip(names, limit, strict=True)),
    }
