"""`heli-twin compare`: several flights beside each other."""

import csv
import json
import sys
from argparse import ArgumentParser, Namespace, _SubParsersAction
from collections.abc import Sequence
from typing import TYPE_CHECKING

from heli_twin.commands import command, file_path, progress_bar, say
from heli_twin.errors import HeliTwinError
from heli_twin.terminal_text import clean

if TYPE_CHECKING:
    from heli_twin.log_tables.compare import Compared

MOST_COLUMNS = 6
"""Flights whose experiments stand in columns; of more, each field has its values in one cell."""
AXES = ("x", "y", "z", "yaw")
BY_AXIS = (("rmse", "RMS"), ("max", "largest"))
OTHERS = (
    ("effort", "effort"),
    ("variation.x", "pitch"),
    ("variation.y", "roll"),
    ("tilt.max", "tilt"),
    ("control_step_ms.p50", "step"),
    ("solve_ms.p50", "solve"),
    ("solve_ms.p99", "solve 99 %"),
)
OTHERS_TITLE = "whole flight: variance of the inputs (effort), stick travel a second, largest tilt, computing times"


def add(subparsers: "_SubParsersAction[ArgumentParser]") -> None:
    """Add the command."""
    parser = command(
        subparsers,
        "compare",
        run,
        "compare recorded flights: what differs, and how well each flew",
        "Print what differs between the experiments of several logs, how each ended, and statistics of the distance\n"
        "from the reference, named as evo names them: rmse, mean, median, std, min, max, sse. An error counts from\n"
        "2 s on, or from --from to --to; effort, stick travel and times are those of the whole flight.",
        "  heli-twin compare A.mcap B.mcap\n"
        "  heli-twin compare logs/*.mcap --sort rmse\n"
        "  heli-twin compare A.mcap B.mcap --from 5 --to 10 --json",
    )
    parser.add_argument("logs", nargs="+", type=file_path, metavar="RUN.mcap", help="logs that heli-twin recorded")
    parser.add_argument("--from", dest="start", type=float, metavar="SECONDS", help="first moment (default 2)")
    parser.add_argument("--to", dest="end", type=float, metavar="SECONDS", help="last moment (default: the end)")
    parser.add_argument("--sort", metavar="STATISTIC", help="smallest first, by this statistic of the distance")
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--json", action="store_true", help="print everything as JSON, for programs: SI units")
    form.add_argument("--csv", action="store_true", help="the same as CSV, one row a flight")


def run(parsed: Namespace) -> int:
    """Compare them."""
    from heli_twin.log_tables.compare import STATISTICS, compared, differing
    from heli_twin.terminal_text import instead

    if parsed.sort is not None and parsed.sort not in STATISTICS:
        raise HeliTwinError(f"--sort: unknown statistic {instead(parsed.sort, STATISTICS)}")
    with progress_bar() as bar:
        paths = bar.track(parsed.logs, description="logs")
        flights = compared(paths, parsed.start, parsed.end)
    if parsed.sort is not None:
        flights.sort(key=lambda flight: flight.errors["position"][parsed.sort] if flight.errors else float("inf"))
    if parsed.json:
        fields = [{"field": path, "values": values} for path, values in differing(flights)]
        print(json.dumps({"differences": fields, "flights": [f.plain() for f in flights]}, indent=2, allow_nan=False))
    elif parsed.csv:
        rows = [flight.plain() for flight in flights]
        writer = csv.DictWriter(
            sys.stdout, list(dict.fromkeys(key for row in rows for key in row)), lineterminator="\n"
        )
        writer.writeheader()
        writer.writerows({key: clean(v) if isinstance(v, str) else v for key, v in row.items()} for row in rows)
    else:
        _print(flights, parsed)
    return 0


def _print(flights: "Sequence[Compared]", parsed: Namespace) -> None:
    from heli_twin.log_tables.compare import STATISTICS
    from heli_twin.metrics.tracking import SETTLING_S
    from heli_twin.reporting.terminal_tables import metric_text, print_table

    rows = [(f.name, f.path.name, f"{f.log.outcome} after {1e-9 * f.log.ending.time:.4g} s") for f in flights]
    print_table(("", "file", "outcome"), rows, left=(0, 1, 2))
    _print_differences(flights)
    first = SETTLING_S if parsed.start is None else parsed.start
    window = f"from {first:g} s" + ("" if parsed.end is None else f" to {parsed.end:g} s")
    rows = [(f.name, *_statistics(f)) for f in flights]
    print_table(("", *STATISTICS), rows, f"distance from the reference {window}, cm (sse: cm\u00b2)")
    for key, title in BY_AXIS:
        rows = [(f.name, *(_of_axis(f, axis, key) for axis in AXES)) for f in flights]
        print_table(("", *AXES), rows, f"{title} error of each axis {window}")
    rows = [(f.name, *(metric_text(name, f.metrics.get(name)) for name, _ in OTHERS)) for f in flights]
    print_table(("", *(name for _, name in OTHERS)), rows, OTHERS_TITLE)


def _statistics(flight: "Compared") -> list[str]:
    from heli_twin.log_tables.compare import STATISTICS
    from heli_twin.reporting.terminal_tables import MISSING

    if flight.errors is None:
        return [MISSING] * len(STATISTICS)
    found = flight.errors["position"]
    return [f"{found[name] * (1e4 if name == 'sse' else 100):.4g}" for name in STATISTICS]


def _of_axis(flight: "Compared", axis: str, key: str) -> str:
    from heli_twin.reporting.terminal_tables import angle, length

    value = flight.errors[axis][key] if flight.errors else None
    return angle(value) if axis == "yaw" else length(value)


def _print_differences(flights: "Sequence[Compared]") -> None:
    from heli_twin.log_tables.compare import differing
    from heli_twin.reporting.terminal_tables import print_table

    fields = differing(flights)
    if not fields:
        if len(flights) > 1:
            say("the experiments are the same")
    elif len(flights) <= MOST_COLUMNS:
        rows = [(path, *values) for path, values in fields]
        print_table(("", *(f.name for f in flights)), rows, "what differs", left=range(len(flights) + 1))
    else:
        names = [flight.name for flight in flights]
        rows = [(path, "; ".join(f"{n} {v}" for n, v in zip(names, values, strict=True))) for path, values in fields]
        print_table(("field", "values"), rows, "what differs", left=(0, 1))
