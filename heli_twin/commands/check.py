"""`heli-twin check`: whether a member of a user's own keeps the rules of its family."""

import json
from argparse import ArgumentParser, Namespace, _SubParsersAction

from heli_twin.commands import command, say


def add(subparsers: "_SubParsersAction[ArgumentParser]") -> None:
    """Add the command."""
    parser = command(
        subparsers,
        "check",
        run,
        "check a control law, trajectory, ... of your own against the rules of its family",
        "Run the conformance tests of its family on every member that a file holds, with the defaults of its fields.\n"
        "The exit code is 1 if a rule is broken. The same checks for a test suite: heli_twin.conformance.",
        "  heli-twin check ./my_law.py\n  heli-twin check my_package.laws:Mine --json",
    )
    parser.add_argument("what", metavar="FILE.py[:CLASS] | PACKAGE.MODULE:CLASS", help="what to check")
    parser.add_argument("--json", action="store_true", help="print the verdicts as JSON, for programs")


def run(parsed: Namespace) -> int:
    """Check, print."""
    from heli_twin.conformance import verdicts
    from heli_twin.experiment.families import FamilyError, specs_at

    found = specs_at(parsed.what)
    if not found:
        raise FamilyError(f"{parsed.what} holds no member of a family: a frozen dataclass with a field kind")
    report = [
        {"class": spec.__name__, "family": family, "rule": verdict.rule, "trouble": verdict.trouble}
        for family, spec in found
        for verdict in verdicts(family, spec)
    ]
    if parsed.json:
        print(json.dumps(report, indent=2))
    else:
        for family, spec in found:
            say(f"{spec.__name__}, a member of {family}")
            for row in report:
                if row["class"] == spec.__name__:
                    say(f"  {'broken' if row['trouble'] else 'kept  '}  {row['rule']}")
                    if row["trouble"]:
                        say(f"          {row['trouble']}")
    return 1 if any(row["trouble"] for row in report) else 0
