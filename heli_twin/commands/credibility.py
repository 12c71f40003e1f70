"""`heli-twin credibility`: what may be believed of the twin, and what shows it."""

from argparse import ArgumentParser, Namespace, _SubParsersAction
from pathlib import Path
from typing import TYPE_CHECKING

from heli_twin.commands import command, file_path, say
from heli_twin.errors import HeliTwinError

if TYPE_CHECKING:
    from heli_twin.credibility import Ledger

COLORS = {"validated": "green", "verified": "cyan", "fitted": "yellow", "not validated": "red"}


def add(subparsers: "_SubParsersAction[ArgumentParser]") -> None:
    """Add the command."""
    parser = command(
        subparsers,
        "credibility",
        run,
        "say what may be believed of the twin, and what shows it",
        "Print the ledger of claims, each with its status and evidence, and the credibility factors of\n"
        "NASA-STD-7009B, each with a level and what the next one needs.\n\n"
        "  validated       a witness outside this code agrees: another solver, another reader, the paper\n"
        "  verified        it agrees with mathematics or with itself, by tests\n"
        "  fitted          a value was chosen so that it agrees\n"
        "  not validated   nothing shows it yet\n\n"
        "The tests fail where a row has no evidence, or evidence that does not exist.",
        "  heli-twin credibility\n  heli-twin credibility --out credibility.html     # with the text of each test",
    )
    parser.add_argument("--out", type=file_path, metavar="PAGE.html", help="write it as one HTML page")


def run(parsed: Namespace) -> int:
    """Print the ledger, or write the page."""
    from heli_twin.credibility import read_ledger
    from heli_twin.credibility.page import credibility_page, summary
    from heli_twin.whole_file import write_whole

    ledger = read_ledger()
    if parsed.out is None:
        show(ledger)
        say(summary(ledger))
        return 0
    path = Path(parsed.out)
    if path.suffix.lower() not in (".html", ".htm"):
        raise HeliTwinError(f"--out {path}: the page is HTML, so give a name that ends in .html")
    try:
        write_whole(path, credibility_page(ledger).encode())
    except OSError as error:
        raise HeliTwinError(f"cannot write {path} ({error.strerror}): give another --out") from None
    say(f"page {path}")
    return 0


def show(ledger: "Ledger") -> None:
    """Print the ledger for a person."""
    from rich import box
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from heli_twin.credibility.page import short

    claims = Table(title="Claims", title_justify="left", box=box.SIMPLE, show_lines=False)
    for column in ("status", "claim", "shown by", "missing"):
        claims.add_column(column, overflow="fold")
    for status, color in COLORS.items():
        for claim in (each for each in ledger.claims if each.status == status):
            witness = [f"witness: {claim.witness.replace('_', ' ')}"] if claim.witness else []
            shown = "\n".join([*witness, *map(short, claim.evidence)])
            claims.add_row(Text(status, color), Text(claim.text), Text(shown), Text(claim.missing))
    factors = Table(title="Factors of NASA-STD-7009B", title_justify="left", box=box.SIMPLE)
    for column in ("factor", "level", "why", "the next level needs"):
        factors.add_column(column, overflow="fold")
    for factor in ledger.factors:
        factors.add_row(Text(factor.name), f"{factor.level} of 4", Text(factor.why), Text(factor.missing))
    Console().print(claims, factors)
