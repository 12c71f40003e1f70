"""`heli-twin judge`: whether flights keep their requirements, and by how much."""

import json
from argparse import ArgumentParser, Namespace, _SubParsersAction
from pathlib import Path
from typing import TYPE_CHECKING

from heli_twin.commands import command, file_path, say

if TYPE_CHECKING:
    from heli_twin.mission import Result
    from heli_twin.requirements import Requirement, Verdict
    from heli_twin.several.fly import SeveralResult

BROKEN = 3
"""The exit code of a flight that does not keep a requirement."""


def add(subparsers: "_SubParsersAction[ArgumentParser]") -> None:
    """Add the command."""
    parser = command(
        subparsers,
        "judge",
        run,
        "say whether flights keep their requirements, and by how much",
        "Judge logs, also imported ones, by requirements in TOML:\n\n"
        "  [requirements]\n"
        '  steady = "always[2s,end] error.position < 10 cm"\n'
        '  stops = "always(poses_lost implies eventually[0s,1s] speed < 0.2 m/s)"\n\n'
        "always, eventually and until take an interval in seconds from now; `end` is the end of the flight.\n"
        "A margin is how much nearer the tightest signal may come to its limit; a negative one breaks the\n"
        "requirement. `--signals` lists what can be compared. A flight that ends early is judged up to there:\n"
        "ask for `eventually completed` too.\n"
        "Exit code: 0 all hold, 3 one is broken, 2 a mistake in what was asked for.",
        "  heli-twin judge hover logs/RUN.mcap\n"
        "  heli-twin judge requirements.toml logs/*.mcap --json\n"
        "  heli-twin judge --signals\n"
        "  heli-twin fly trajectory=hover --require hover",
    )
    parser.add_argument(
        "requirements", nargs="?", metavar="REQ.toml|NAME", help=f"a file, or a shipped one: {_names()}"
    )
    parser.add_argument("logs", nargs="*", type=file_path, metavar="RUN.mcap", help="logs of flights")
    parser.add_argument("--signals", action="store_true", help="list the signals that a requirement may speak of")
    parser.add_argument("--json", action="store_true", help="print margins as JSON; of several logs one object by log")


def _names() -> str:
    folder = Path(__file__).parents[1] / "requirements" / "shipped"
    return ", ".join(sorted(file.stem for file in folder.glob("*.toml")))


def run(parsed: Namespace) -> int:
    """Judge; the exit code is 3 if a requirement is broken."""
    from heli_twin.errors import HeliTwinError
    from heli_twin.recording import read_log
    from heli_twin.requirements import judge, requirements_of

    if parsed.signals:
        return _signals()
    if parsed.requirements is None or not parsed.logs:
        raise HeliTwinError("judge needs requirements and a log: heli-twin judge hover logs/RUN.mcap")
    requirements = requirements_of(parsed.requirements)
    verdicts: dict[str, dict[str, Verdict]] = {}
    for path in parsed.logs:
        try:
            verdicts[str(path)] = judge(requirements, read_log(path))
        except HeliTwinError as error:
            raise HeliTwinError(f"{path}: {error}" if str(path) not in str(error) else str(error)) from None
    if parsed.json:
        plain = {path: {name: verdict.plain() for name, verdict in of.items()} for path, of in verdicts.items()}
        print(json.dumps(plain if len(plain) > 1 else next(iter(plain.values())), indent=2, allow_nan=False))
    else:
        for path, of in verdicts.items():
            show(of, path if len(verdicts) > 1 else "")
    return 0 if all(verdict.holds for of in verdicts.values() for verdict in of.values()) else BROKEN


def verdicts_on(requirements: "tuple[Requirement, ...]", result: "Result | SeveralResult") -> "dict[str, Verdict]":
    """Judge a flight; an invalid run says nothing."""
    from heli_twin.flight import INVALID

    if not requirements or result.outcome.kind == INVALID:
        return {}
    from heli_twin.requirements import judge

    return judge(requirements, result.log)


def show(verdicts: "dict[str, Verdict]", title: str = "requirements") -> None:
    """Print verdicts for a person."""
    from rich import box
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from heli_twin.terminal_text import clean

    table = Table(title=Text(clean(title)), title_justify="left", box=box.SIMPLE)
    for column in ("requirement", "", "margin", "of limit", "tightest at", "then"):
        right = column in ("margin", "of limit", "tightest at")
        table.add_column(column, justify="right" if right else "left", overflow="fold")
    for name, verdict in verdicts.items():
        table.add_row(
            Text(clean(name, 60)),
            "holds" if verdict.holds else Text("BROKEN", style="bold red"),
            verdict.margin_text or "-",
            "-" if verdict.normalised is None else f"{100 * verdict.normalised:.0f} %",
            "-" if verdict.tightest_at is None else f"{verdict.tightest_at:.2f} s",
            Text(clean(verdict.reason, 200)),
        )
    Console().print(table)
    broken = sum(not verdict.holds for verdict in verdicts.values())
    say(f"{broken} of {len(verdicts)} broken" if broken else f"all {len(verdicts)} hold")


def _signals() -> int:
    from rich import box
    from rich.console import Console
    from rich.table import Table

    from heli_twin.requirements.signals import SIGNALS

    table = Table(box=box.SIMPLE)
    for column in ("signal", "unit", "is"):
        table.add_column(column)
    for name, signal in SIGNALS.items():
        table.add_row(name, "true or false" if signal.unit is None else signal.unit or "share, %", signal.text)
    Console().print(table)
    return 0
