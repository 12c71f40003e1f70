"""`heli-twin guide`: pages on what can be done, and how."""

from argparse import ArgumentParser, Namespace, _SubParsersAction
from pathlib import Path

from heli_twin.commands import command, say
from heli_twin.errors import HeliTwinError
from heli_twin.terminal_text import instead

PAGES = Path(__file__).parents[1] / "guide"
LAYOUT = "foxglove"
"""The page that is no text but a layout for Foxglove, JSON."""


def add(subparsers: "_SubParsersAction[ArgumentParser]") -> None:
    """Add the command."""
    parser = command(
        subparsers,
        "guide",
        run,
        "read a page on what can be done, and how",
        "Print a page of the guide. Every command on these pages is run by the tests.",
        "  heli-twin guide                  # which pages there are\n"
        "  heli-twin guide studies\n"
        "  heli-twin guide own-code | less\n"
        "  heli-twin guide foxglove > layout.json",
    )
    parser.add_argument("topic", nargs="?", metavar="TOPIC", help="one of the pages; without it they are listed")


def run(parsed: Namespace) -> int:
    """Print a page, or the list of pages.

    Raises:
        HeliTwinError: There is no such page.
    """
    pages = {path.stem: path for path in sorted(PAGES.glob("*.md"))} | {LAYOUT: PAGES / f"{LAYOUT}.json"}
    if parsed.topic is None:
        for name, path in pages.items():
            first = path.read_text(encoding="utf-8").partition("\n")[0].removeprefix("# ")
            say(f"{name:<16} {first if name != LAYOUT else 'a layout for Foxglove, JSON: Layouts, Import from file'}")
        return 0
    if parsed.topic not in pages:
        raise HeliTwinError(f"there is no page {instead(parsed.topic, pages)}")
    print(pages[parsed.topic].read_text(encoding="utf-8"), end="")
    return 0
