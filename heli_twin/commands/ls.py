"""`heli-twin ls`: a table over logs."""

import csv
import json
import sys
from argparse import ArgumentParser, Namespace, _SubParsersAction
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from heli_twin.commands import command, progress_bar, say
from heli_twin.errors import HeliTwinError
from heli_twin.terminal_text import clean

if TYPE_CHECKING:
    from heli_twin.log_tables.rows import LogRow

LONG_S = 3.0
"""A pass over messages that takes longer is announced."""
MEASURED = ("rmse.position", "max_abs_error.position", "rmse.yaw", "effort", "solve_ms.p50")
"""Columns that need a pass over the messages."""
WIDE, MEDIUM = 170, 100
"""Characters of a terminal from which on every column has a place of its own, and the last ones have any."""
IN_THE_FILE = ("started", "flown", "changes")
"""Columns that a narrow table shows below the name of the file, or leaves to it."""
LAST = ("effort", "solve_ms.p50")
COLUMNS = (
    ("file", "file"),
    ("started", "when (UTC)"),
    ("flown", "flown"),
    ("changes", "preset and changes"),
    ("outcome", "outcome"),
    ("duration", "time"),
    ("rmse.position", "RMS"),
    ("max_abs_error.position", "largest"),
    ("rmse.yaw", "yaw RMS"),
    ("effort", "effort"),
    ("solve_ms.p50", "solve"),
)
"""Names for programs and for a person."""


def add(subparsers: "_SubParsersAction[ArgumentParser]") -> None:
    """Add the command."""
    parser = command(
        subparsers,
        "ls",
        run,
        "list the logs in a folder: what was flown, how it ended, how well",
        "List logs: when, what was flown, what differs from the preset, how it ended, the errors from 2 s on\n"
        "(distance from the reference, RMS and largest; yaw), the variance of the inputs (effort) and the median time\n"
        "of the solver. `where` keeps those for which all comparisons hold: of a field (`heli-twin show`),\n"
        "a column, or a metric (--json names them), in SI units or with a unit written behind the number. Files that\n"
        "cannot be read have a row that says why.",
        "  heli-twin ls\n"
        "  heli-twin ls logs where 'plant.mass>0.03'\n"
        "  heli-twin ls logs where 'controller=pid and rmse.position<5cm' --sort rmse.position\n"
        "  heli-twin ls logs --quick\n"
        "  heli-twin ls logs --recursive --csv > flights.csv",
    )
    parser.add_argument(
        "words",
        nargs="*",
        default=[],
        metavar="DIR | RUN.mcap | where 'FIELD>VALUE and ...'",
        help="folders or logs (default logs), then a filter",
    )
    parser.add_argument(
        "--sort", default="started", metavar="FIELD", help="sort by this (default: when they were flown)"
    )
    parser.add_argument("--reverse", action="store_true", help="the other way round")
    parser.add_argument("--recursive", "-r", action="store_true", help="folders below too")
    parser.add_argument("--quick", action="store_true", help="without errors, effort and times: read no messages")
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--json", action="store_true", help="print everything as JSON, for programs: SI units")
    form.add_argument("--csv", action="store_true", help="the same as CSV")


def run(parsed: Namespace) -> int:
    """List them."""
    from heli_twin.log_tables.rows import head_row, logs_in
    from heli_twin.log_tables.where import check_field, comparisons, matching, value_of

    places, filters = _split(parsed.words)
    wanted = [comparison for text in filters for comparison in comparisons(text)]
    paths = [
        path for place in places for path in (logs_in(place, below=parsed.recursive) if place.is_dir() else [place])
    ]
    rows = [head_row(path) for path in paths]
    early = [each for each in wanted if not _is_metric(each.field)]
    for field in (parsed.sort, *(each.field for each in wanted)):
        if not _is_metric(field):
            check_field(rows, field)
        elif parsed.quick:
            raise HeliTwinError(f"{field} is a metric, which --quick does not compute: leave out --quick")
    rows = matching(rows, early)
    if not parsed.quick:
        rows = _measured(rows)
    rows = matching(rows, [each for each in wanted if each not in early])
    check_field(rows, parsed.sort)
    rows.sort(key=lambda row: _order(value_of(row, parsed.sort)), reverse=parsed.reverse)
    # What has no value stands last in either direction.
    rows.sort(key=lambda row: value_of(row, parsed.sort) is None)
    if parsed.json:
        print(json.dumps([row.facts for row in rows], indent=2, allow_nan=False))
    elif parsed.csv:
        _print_csv(rows)
    else:
        _print(rows, places, quick=parsed.quick)
    return 0


def _split(words: Sequence[str]) -> tuple[list[Path], list[str]]:
    """Places and filters: `DIR ... where FILTER ...`."""
    words = list(words)
    at = words.index("where") if "where" in words else len(words)
    places, filters = [Path(word) for word in words[:at]] or [Path("logs")], words[at + 1 :]
    if at < len(words) and not filters:
        from heli_twin.log_tables.where import EXAMPLE

        raise HeliTwinError(f"`where` is followed by nothing: write where {EXAMPLE}")
    missing = next((place for place in places if not place.exists()), None)
    if missing is not None:
        raise HeliTwinError(f"there is no folder or log {missing}: give one with logs, or fly with `heli-twin fly`")
    return places, filters


def _measured(rows: "Sequence[LogRow]") -> "list[LogRow]":
    from heli_twin.log_tables.rows import measured_rows, seconds_of

    if sys.stderr is not None and (seconds := seconds_of(rows)) > LONG_S:
        told = (
            f"reading the messages of {len(rows)} logs for their errors, about {seconds:.0f} s; --quick leaves them out"
        )
        print(told, file=sys.stderr, flush=True)
    with progress_bar() as bar:
        return list(bar.track(measured_rows(rows), total=len(rows), description="logs"))


def _is_metric(field: str) -> bool:
    from heli_twin.log_tables.rows import metric_names

    return field.startswith("error.") or (field in metric_names() and field not in ("outcome", "duration"))


def _order(value: Any) -> tuple[bool, Any, str]:
    number = isinstance(value, int | float)
    return (not number, value if number else 0, "" if number else str(value))


def _print(rows: "Sequence[LogRow]", places: Sequence[Path], *, quick: bool) -> None:
    from heli_twin.reporting.terminal_tables import print_table, terminal_width

    width = terminal_width()
    folder = places[0] if len(places) == 1 and places[0].is_dir() else None
    columns = [
        (name, title)
        for name, title in COLUMNS
        if not (quick and name in MEASURED)
        and (width >= WIDE or name not in IN_THE_FILE)
        and not (width < MEDIUM and name in LAST)
    ]
    table = [[_cell(row, name, folder, together=width < WIDE) for name, _ in columns] for row in rows]
    left = [i for i, (name, _) in enumerate(columns) if name in ("file", "started", "flown", "changes", "outcome")]
    print_table([title for _, title in columns], table, left=left)
    unreadable = sum(row.facts["outcome"] == "unreadable" for row in rows)
    said = ("1 log" if len(rows) == 1 else f"{len(rows)} logs") + (
        f", {unreadable} of them cannot be read" if unreadable else ""
    )
    say(said + ("" if quick else "; errors are distances from the reference, from 2 s on"))


def _cell(row: "LogRow", name: str, folder: Path | None, *, together: bool) -> str:
    from heli_twin.reporting.terminal_tables import MISSING, metric_text

    facts = row.facts
    match name:
        case "file":
            path = clean(row.path.relative_to(folder) if folder and row.path.is_relative_to(folder) else row.path)
            return f"{path}\n{_cell(row, 'changes', folder, together=False)}" if together else path
        case "started":
            return (facts["started"] or MISSING)[:19].replace("T", " ")
        case "flown" if facts.get("origin", "flight") != "flight":
            return {"import": "imported poses", "resolve": "solved again"}.get(facts["origin"], MISSING)
        case "flown":
            return " ".join(kind for kind in (facts["trajectory"], facts["controller"]) if kind) or MISSING
        case "changes":
            words = facts["changes"]
            return facts["problem"] or (MISSING if words is None else " ".join(words) or "lab")
        case "outcome":
            return facts["outcome"]
        case "duration":
            return f"{facts['duration']:.3g} s" if "duration" in facts else MISSING
        case _:
            return metric_text(name, facts.get(name))


def _print_csv(rows: "Sequence[LogRow]") -> None:
    names = list(dict.fromkeys(name for row in rows for name in row.facts))
    writer = csv.writer(sys.stdout, lineterminator="\n")
    writer.writerow(names)
    for row in rows:
        writer.writerow([_csv_cell(row.facts.get(name)) for name in names])


def _csv_cell(value: Any) -> Any:
    if isinstance(value, list):
        value = " ".join(value)
    return clean(value, CSV_LIMIT) if isinstance(value, str) else value


CSV_LIMIT = 5000
"""Characters of a text in a CSV file."""
