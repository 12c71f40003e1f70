"""`heli-twin info`: the contents of a log."""

import json
from argparse import ArgumentParser, Namespace, _SubParsersAction
from typing import TYPE_CHECKING, Any

from heli_twin.commands import command, file_path, say
from heli_twin.terminal_text import clean, pasteable

if TYPE_CHECKING:
    from heli_twin.recording import Log

VALUE_LIMIT = 300
"""Characters of one value that are printed."""


def add(subparsers: "_SubParsersAction[ArgumentParser]") -> None:
    """Add the command."""
    parser = command(
        subparsers,
        "info",
        run,
        "say what is in a log",
        "Print what was flown, how it ended, every topic with its rate and size, versions and metrics.",
        "  heli-twin info logs/RUN.mcap\n  heli-twin info logs/RUN.mcap --json | jq .metrics",
    )
    parser.add_argument("log", type=file_path, metavar="RUN.mcap", help="a log that heli-twin recorded")
    parser.add_argument("--json", action="store_true", help="print it as JSON, for programs")


def run(parsed: Namespace) -> int:
    """Print the facts."""
    import numpy as np

    from heli_twin.recording import read_log
    from heli_twin.recording.reader import of_ship

    log, (path, _) = read_log(parsed.log), of_ship(parsed.log)
    with np.errstate(all="ignore"):
        facts = about_several(log) if log.ships else about(log)
    facts |= {"file": str(parsed.log), "size": path.stat().st_size}
    if parsed.json:
        print(json.dumps(facts, indent=2, allow_nan=False, default=str))
    elif log.ships:
        show_several(facts)
    else:
        show(facts)
    return 0


def about_several(log: "Log") -> dict[str, Any]:
    """The facts about a log of several helicopters, as JSON can hold them; under `ships` those of each."""
    from heli_twin.experiment.tree import ExperimentError
    from heli_twin.several.fly import flown_several, summary_of

    metrics: dict[str, Any] = {}
    problem = None
    try:
        metrics = summary_of(log, flown_several(log))
    except ExperimentError as error:
        problem = str(error)
    return {
        "outcome": log.outcome,
        "outcome_text": log.ending.text,
        "duration": 1e-9 * log.ending.time,
        "recovered": log.ending.recovered,
        "digest": log.digest,
        "experiment_problem": problem,
        "metadata": dict(log.metadata),
        "metrics": {key: _finite(value) for key, value in metrics.items() if key != "ships"},
        "ships": {name: about(log.ship(name)) | _reached(metrics, name) for name in log.ships},
    }


def _reached(metrics: dict[str, Any], name: str) -> dict[str, Any]:
    ship = metrics.get("ships", {}).get(name, {})
    return {key: ship.get(key) for key in ("arrived", "time_to_goal", "stuck")}


def show_several(facts: dict[str, Any]) -> None:
    """Print the facts about a log of several helicopters for a person."""
    from heli_twin.commands._several import show_distances, show_ships

    say(f"{'file':<16} {facts['file']}, {facts['size'] / 1e6:.2f} MB")
    rows = [
        ("helicopters", ", ".join(facts["ships"])),
        ("outcome", f"{facts['outcome']} after {facts['duration']:g} s: {facts['outcome_text']}"),
        ("digest", facts["digest"]),
        *facts["metadata"].items(),
    ]
    if facts["recovered"]:
        rows.append(("recovered", "yes: this is what was saved of a broken log"))
    for key, value in rows:
        print(f"{clean(key, VALUE_LIMIT):<16} {clean(value, VALUE_LIMIT)}")
    if facts["experiment_problem"]:
        print(clean(facts["experiment_problem"], VALUE_LIMIT))
        return
    show_ships({"ships": {name: ship | ship["metrics"] for name, ship in facts["ships"].items()}})
    show_distances(facts["metrics"])
    first = next(iter(facts["ships"]))
    say(f"of one of them: {pasteable('heli-twin', 'info', facts['file'] + '#' + first)}")


def about(log: "Log") -> dict[str, Any]:
    """The facts that `info` prints about a log, as JSON can hold them."""
    from controllers.supervisors import PHASES
    from heli_twin.experiment.differences import fly_words
    from heli_twin.experiment.tree import ExperimentError, parsed
    from heli_twin.logbook import flown_experiment, viewed_experiment
    from heli_twin.metrics.tracking import metrics
    from heli_twin.mission import steps_before_first_pose

    experiment = words = problem = None
    try:
        # The classes of a user's own that it names need not be here.
        viewed_experiment(log)
        experiment = parsed(log.experiment)
        words = fly_words(log.experiment)
        flown_experiment(log)
    except ExperimentError as error:
        problem = str(error)
    return {
        "outcome": log.outcome,
        "outcome_text": log.ending.text,
        "supervisor": [
            {"time": 1e-9 * event.time, "phase": event.name, "reason": event.text}
            for event in log.events
            if event.name in PHASES
        ],
        "duration": 1e-9 * log.ending.time,
        "recovered": log.ending.recovered,
        "digest": log.digest,
        "overrides": words,
        "experiment": experiment,
        "experiment_problem": problem,
        "positions": "truth" if len(log.truth.time) else "cameras" if len(log.pose.time) else None,
        "topics": {name: _topic(topic.times, topic.data) for name, topic in log.messages.items()},
        "attachments": {name: len(attachment.data) for name, attachment in log.attachments.items()},
        "metadata": dict(log.metadata),
        BLIND: steps_before_first_pose(log),
        "metrics": {key: _finite(value) for key, value in metrics(log).items()},
    }


def _topic(times: Any, data: Any) -> dict[str, Any]:
    """Messages, bytes before compression and messages per second of one topic."""
    span = 1e-9 * (max(times) - min(times)) if len(times) > 1 else 0.0
    rate = (len(times) - 1) / span if span > 0 else None
    return {"messages": len(times), "rate": rate, "bytes": sum(len(message) for message in data)}


def _finite(value: Any) -> Any:
    """JSON has no NaN: null stands for what a flight with a non-finite state left there."""
    if isinstance(value, dict):
        return {key: _finite(inner) for key, inner in value.items()}
    return None if isinstance(value, float) and value - value != 0.0 else value


def show(facts: dict[str, Any]) -> None:
    """Print the facts for a person."""
    from heli_twin.logbook import SOURCES
    from heli_twin.reporting.terminal_tables import control_problems, print_errors, print_table

    say(f"{'file':<16} {facts['file']}, {facts['size'] / 1e6:.2f} MB")
    rows = [
        ("experiment", _experiment(facts)),
        ("positions", POSITIONS_FROM[facts["positions"]]),
        ("outcome", f"{facts['outcome']} after {facts['duration']:g} s: {facts['outcome_text']}"),
        *([("supervisor", _phases(facts["supervisor"]))] if facts["supervisor"] else []),
        ("digest", facts["digest"]),
        *facts["metadata"].items(),
        ("attachments", ", ".join(f"{name} ({size} bytes)" for name, size in facts["attachments"].items())),
    ]
    if sources := [name.removeprefix(SOURCES) for name in facts["attachments"] if name.startswith(SOURCES)]:
        take_out = pasteable("heli-twin", "export", facts["file"], "--source", "DIR")
        rows.append(("source", f"{', '.join(sources)} embedded; {take_out} takes it out"))
    if facts["recovered"]:
        rows.append(("recovered", "yes: this is what was saved of a broken log"))
    for key, value in rows:
        print(f"{clean(key, VALUE_LIMIT):<16} {clean(value, VALUE_LIMIT)}")
    topics = [
        (name, str(topic["messages"]), "" if topic["rate"] is None else f"{topic['rate']:.1f}", f"{topic['bytes']:,}")
        for name, topic in facts["topics"].items()
    ]
    print_table(("topic", "messages", "per second", "bytes"), topics)
    print_errors(facts["metrics"])
    print(f"control problems {clean(control_problems(facts['metrics'] | {BLIND: facts[BLIND]}), VALUE_LIMIT)}")


BLIND = "steps_before_first_pose"
POSITIONS_FROM = {"truth": "the truth", "cameras": "the cameras: nobody knows the truth", None: "none"}


def _phases(changes: list[dict[str, Any]]) -> str:
    return "; ".join(f"{change['phase']} at {change['time']:.2f} s, {change['reason']}" for change in changes)


def _experiment(facts: dict[str, Any]) -> str:
    if facts["overrides"] is None:
        return facts["experiment_problem"]
    return " ".join(facts["overrides"]) or "lab, every field at its default"
