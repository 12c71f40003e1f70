"""`heli-twin info`: what is in a log."""

import json
from argparse import ArgumentParser, Namespace, _SubParsersAction
from pathlib import Path
from typing import TYPE_CHECKING, Any

from heli_twin.commands import command

if TYPE_CHECKING:
    from heli_twin.recording import Log

LONGEST = 300
"""Characters of a log's own text that are printed."""


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
    parser.add_argument("log", type=Path, metavar="RUN.mcap", help="a log that heli-twin recorded")
    parser.add_argument("--json", action="store_true", help="print it as JSON, for programs")


def run(parsed: Namespace) -> int:
    """Print it."""
    import numpy as np

    from heli_twin.logbook import opened

    with np.errstate(all="ignore"):
        found = about(opened(parsed.log))
    found |= {"file": str(parsed.log), "size": parsed.log.stat().st_size}
    if parsed.json:
        print(json.dumps(found, indent=2, allow_nan=False, default=str))
    else:
        show(found)
    return 0


def about(log: "Log") -> dict[str, Any]:
    """Everything that `info` tells of a log, ready for JSON."""
    from heli_twin.experiment.differences import fly_words
    from heli_twin.experiment.tree import ExperimentError, canonical_json
    from heli_twin.logbook import flown_experiment
    from heli_twin.metrics.tracking import metrics

    experiment = words = problem = None
    try:
        text = canonical_json(flown_experiment(log))
        experiment, words = json.loads(text), fly_words(text)
    except ExperimentError as error:
        problem = str(error)
    return {
        "outcome": log.outcome,
        "outcome_text": log.ending.get("text", ""),
        "duration": 1e-9 * int(log.ending.get("time", "0")),
        "recovered": "recovered" in log.ending,
        "digest": log.digest,
        "overrides": words,
        "experiment": experiment,
        "experiment_problem": problem,
        "topics": {name: _topic(topic.times, topic.data) for name, topic in log.messages.items()},
        "attachments": {name: len(attachment.data) for name, attachment in log.attachments.items()},
        "metadata": dict(log.metadata),
        "metrics": {key: _finite(value) for key, value in metrics(log).items()},
    }


def _topic(times: Any, data: Any) -> dict[str, Any]:
    """Messages, bytes before compression and messages per second of one topic."""
    span = 1e-9 * (max(times) - min(times)) if len(times) > 1 else 0.0
    rate = (len(times) - 1) / span if span > 0 else None
    return {"messages": len(times), "rate": rate, "bytes": sum(len(message) for message in data)}


def _finite(value: Any) -> Any:
    """JSON has no NaN: a flight that left the real numbers has null there."""
    if isinstance(value, dict):
        return {key: _finite(inner) for key, inner in value.items()}
    return None if isinstance(value, float) and value - value != 0.0 else value


def plain(text: str) -> str:
    """Text of a log as a terminal may see it: printable characters only, and not too many."""
    shown = "".join(c if c.isprintable() else "?" for c in text[: LONGEST + 1])
    return shown if len(text) <= LONGEST else shown[:LONGEST] + "..."


def show(found: dict[str, Any]) -> None:
    """Print it for a person."""
    from rich import box
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    rows = {
        "file": f"{found['file']}, {found['size'] / 1e6:.2f} MB",
        "experiment": _experiment(found),
        "outcome": f"{found['outcome']} after {found['duration']:g} s: {found['outcome_text']}",
        "digest": found["digest"],
        **found["metadata"],
        "attachments": ", ".join(f"{name} ({size} bytes)" for name, size in found["attachments"].items()),
    }
    if found["recovered"]:
        rows["recovered"] = "yes: this is what was saved of a broken log"
    for key, value in rows.items():
        print(f"{plain(key):<16} {plain(value)}")
    table = Table(box=box.SIMPLE)
    for column in ("topic", "messages", "per second", "bytes"):
        table.add_column(column, justify="left" if column == "topic" else "right")
    for name, topic in found["topics"].items():
        rate = "" if topic["rate"] is None else f"{topic['rate']:.1f}"
        table.add_row(Text(plain(name)), str(topic["messages"]), rate, f"{topic['bytes']:,}")
    Console().print(table)
    print("metrics          " + plain(json.dumps({k: v for k, v in found["metrics"].items() if k in _SHORT})))


_SHORT = ("max_abs_error", "rmse", "qp_status")
"""Metrics that fit on a line."""


def _experiment(found: dict[str, Any]) -> str:
    if found["overrides"] is None:
        return found["experiment_problem"]
    return " ".join(found["overrides"]) or "lab, every field at its default"
