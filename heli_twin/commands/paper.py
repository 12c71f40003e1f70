"""`heli-twin paper`: fly what the paper shows, and judge each of its claims."""

from argparse import ArgumentParser, Namespace, _SubParsersAction
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from heli_twin.commands import command, progress_bar, say

if TYPE_CHECKING:
    from heli_twin.paper.verdicts import Claim


def add(subparsers: "_SubParsersAction[ArgumentParser]") -> None:
    """Add the command."""
    parser = command(
        subparsers,
        "paper",
        run,
        "fly what the paper shows and judge each of its claims",
        "Fly the paper's simulations and experiments on the twin, with several seeds on all cores, and write one\n"
        "page: its figures, the identified parameters, and each claim with the paper's number, ours with its\n"
        "interval, and a verdict. The lab is lab_simple: its helicopter has the parameters that the paper identified.\n"
        "Two free cores need three to four minutes.",
        "  heli-twin paper\n  heli-twin paper --seeds 4 --out logs/quick",
    )
    parser.add_argument(
        "--out", type=Path, default=Path("logs/paper"), metavar="DIR", help="where it goes (default logs/paper)"
    )
    parser.add_argument("--seeds", type=int, default=6, metavar="N", help="flights of each kind (default 6)")


def run(parsed: Namespace) -> int:
    """Fly, judge, print the verdicts."""
    from heli_twin.paper.cases import WHY_THIS_LAB
    from heli_twin.paper.write import write_paper

    with progress_bar() as bar:
        task = bar.add_task("flying the paper", total=None)
        claims = write_paper(
            parsed.out,
            parsed.seeds,
            progress=lambda done, total: bar.update(task, completed=done, total=total),
        )
    show(claims)
    say(WHY_THIS_LAB)
    say(f"page {parsed.out / 'paper.html'}")
    return 0


def show(claims: "Sequence[Claim]") -> None:
    """Print the verdicts for a person."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    colors = {"reproduced": "green", "fitted": "yellow", "not reproduced": "red", "not comparable": "dim"}
    table = Table(show_lines=False)
    for column in ("claim", "paper", "ours", "verdict"):
        table.add_column(column)
    for claim in claims:
        table.add_row(claim.claim, claim.paper, claim.ours, Text(claim.verdict, colors[claim.verdict]))
    Console().print(table)
