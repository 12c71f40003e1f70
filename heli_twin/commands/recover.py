"""`heli-twin recover`: save what is good of a broken log."""

from argparse import ArgumentParser, Namespace, _SubParsersAction
from typing import TYPE_CHECKING

from heli_twin.commands import command, file_path, say

if TYPE_CHECKING:
    from heli_twin.recording import Log

GAP_PERIODS = 3
"""Control periods without a message from which on messages count as lost."""


def add(subparsers: "_SubParsersAction[ArgumentParser]") -> None:
    """Add the command."""
    parser = command(
        subparsers,
        "recover",
        run,
        "save what is good of a log that broke off or was damaged",
        "Copy everything that passes its checksum into a new log, NAME.mcap of NAME.mcap.part and NAME.recovered.mcap\n"
        "of NAME.mcap, and say what was saved and what was lost. The broken file stays as it is.",
        "  heli-twin recover logs/RUN.mcap.part\n  heli-twin recover logs/RUN.mcap",
    )
    parser.add_argument("log", type=file_path, metavar="BROKEN.mcap[.part]", help="a log that cannot be read")


def run(parsed: Namespace) -> int:
    """Recover it."""
    from heli_twin.recording import read_log, recover

    path = recover(parsed.log)
    log = read_log(path)
    say(f"saved {path}: {saved(log)}")
    say(f"lost  {lost(log)}")
    return 0


def saved(log: "Log") -> str:
    """One sentence: the content of a recovered log."""
    count = sum(len(topic.times) for topic in log.messages.values())
    return f"{1e-9 * _end(log):.2f} s of flight, {count} messages, and what was flown"


def lost(log: "Log") -> str:
    """One sentence: the parts of the flight that a recovered log lacks."""
    from heli_twin.experiment.tree import ExperimentError
    from heli_twin.logbook import viewed_experiment

    flights = {f"{name}: ": log.ship(name) for name in log.ships} or {"": log}
    missing = [
        f"{name}{1e-9 * (b - a):.2f} s from {1e-9 * a:.2f} s on"
        for name, each in flights.items()
        for a, b in _gaps(each)
    ]
    try:
        left = viewed_experiment(next(iter(flights.values()))).duration - 1e-9 * _end(log)
    except ExperimentError:
        left = 0.0
    if log.outcome == "interrupted":
        missing.append(
            f"how the flight ended (its outcome is now `interrupted`), and what it flew of the remaining {left:.2f} s:"
            " at most the last 0.5 s before it broke off"
        )
    return "; ".join(missing) or "nothing"


def _end(log: "Log") -> int:
    """Time of the last message, ns."""
    return max((topic.times[-1] for topic in log.messages.values() if len(topic.times)), default=0)


def _gaps(log: "Log") -> list[tuple[int, int]]:
    """Intervals (start and end, ns) in which the truth, or else the poses, of a flight were not recorded."""
    import numpy as np

    times = log.truth.time if len(log.truth.time) else log.pose.time
    if len(times) < GAP_PERIODS:
        return []
    steps = np.diff(times, prepend=0)
    limit = GAP_PERIODS * np.median(steps)
    gaps = [(int(times[i] - steps[i]), int(times[i])) for i in np.flatnonzero(steps > limit)]
    end = log.ending.time
    return [*gaps, (int(times[-1]), end)] if end - times[-1] > limit else gaps
