"""`heli-twin check`: whether a member of a user's own keeps the rules of its family."""

import json
from argparse import ArgumentParser, Namespace, _SubParsersAction
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from heli_twin.commands import command, command_words, say
from heli_twin.errors import HeliTwinError

if TYPE_CHECKING:
    from heli_twin.conformance import Verdict


def add(subparsers: "_SubParsersAction[ArgumentParser]") -> None:
    """Add the command."""
    parser = command(
        subparsers,
        "check",
        run,
        "check a control law, trajectory, airframe, ... of your own against the rules of its family",
        "Run the conformance tests of its family on every member that a file holds, with the defaults of its fields.\n"
        "The exit code is 1 if a rule is broken. The same checks for a test suite: heli_twin.conformance.\n"
        "The contract of an airframe, an MJCF file: python -m pydoc heli_twin.lab.plant.contract",
        "  heli-twin check ./my_law.py\n"
        "  heli-twin check my_package.laws:Mine --json\n"
        "  heli-twin check ./my_heli.xml                    # an airframe\n"
        "  heli-twin check ./pid                            # a law that is a program\n"
        '  heli-twin check \'["python3", "law.py"]\'',
    )
    parser.add_argument(
        "what", metavar="FILE.py[:CLASS] | PACKAGE.MODULE:CLASS | FILE.xml | PROGRAM", help="what to check"
    )
    parser.add_argument("--json", action="store_true", help="print the verdicts as JSON, for programs")


def run(parsed: Namespace) -> int:
    """Check, print."""
    from heli_twin.conformance import verdicts

    found = _members(parsed.what)
    report = [
        {"class": name, "family": family, "rule": verdict.rule, "trouble": verdict.trouble}
        for family, name, spec in found
        for verdict in (_of_airframe(Path(name)) if spec is None else verdicts(family, spec))
    ]
    if parsed.json:
        print(json.dumps(report, indent=2))
    else:
        for family, name, _ in found:
            say(f"{name}, a member of {family}")
            for row in report:
                if row["class"] == name:
                    say(f"  {'broken' if row['trouble'] else 'kept  '}  {row['rule']}")
                    if row["trouble"]:
                        say(f"          {row['trouble']}")
    return 1 if any(row["trouble"] for row in report) else 0


def _of_airframe(file: Path) -> "Iterator[Verdict]":
    """Check whether an MJCF keeps its contract, and then the rules of a plant."""
    from heli_twin.conformance import Verdict, verdicts
    from heli_twin.lab.plant.airframe import Airframe, read_model

    rule = "It keeps the contract of an airframe."
    try:
        text = read_model(file)
    except OSError as error:
        raise HeliTwinError(f"cannot read {file}: {error.strerror}") from None
    except ValueError as error:
        yield Verdict(rule, str(error))
        return
    yield Verdict(rule, "")
    yield from verdicts("heli_twin.lab.plant", lambda: Airframe(model=text))


def _members(what: str) -> Sequence[tuple[str, str, Callable[[], Any] | None]]:
    """What is to be checked: family, name, and what makes the member with its defaults; None for an airframe's file."""
    from controllers.laws.external import External
    from heli_twin.experiment.families import FamilyError
    from heli_twin.experiment.named_classes import is_reference, specs_at

    if what.endswith(".xml"):
        return [("heli_twin.lab.plant", what, None)]
    if is_reference(what):
        found = [(family, spec.__name__, spec) for family, spec in specs_at(what)]
        if not found:
            raise FamilyError(f"{what} holds no member of a family: a frozen dataclass with a field kind")
        return found
    try:
        law = External(command=tuple(command_words(what)))
    except ValueError as error:
        raise FamilyError(f"{what}: {error}") from None
    return [("controllers.laws", " ".join(law.command), lambda: law)]
