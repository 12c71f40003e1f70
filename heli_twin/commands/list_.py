"""`heli-twin list`: the members of every family, and where each comes from."""

import json
from argparse import ArgumentParser, Namespace, _SubParsersAction

from heli_twin.commands import command, say


def add(subparsers: "_SubParsersAction[ArgumentParser]") -> None:
    """Add the command."""
    parser = command(
        subparsers,
        "list",
        run,
        "list the members of every family, and where each comes from",
        "List what can stand in each part of an experiment, with the package that it comes from. A package adds\n"
        "members with entry points in the groups that are shown.",
        "  heli-twin list\n  heli-twin list --json",
    )
    parser.add_argument("--json", action="store_true", help="print the members as JSON, for programs")


def run(parsed: Namespace) -> int:
    """List them."""
    from heli_twin.experiment.families import GROUPS, all_members

    rows = [
        {"family": package, "group": group, "kind": kind, "from": member.origin, "text": _summary(member.spec)}
        for package, group in GROUPS.items()
        for kind, member in all_members(package).items()
    ]
    if parsed.json:
        print(json.dumps(rows, indent=2))
        return 0
    for package, group in GROUPS.items():
        say(f"{package}  (entry points: {group})")
        for row in rows:
            if row["family"] == package:
                origin = "" if row["from"] == "heli_twin" else f"  [{row['from']}]"
                say(f"  {row['kind']:<22} {row['text']}{origin}")
    return 0


def _summary(spec: type) -> str:
    return " ".join((spec.__doc__ or "").split("\n\n")[0].split())
