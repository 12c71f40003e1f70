"""Requirements in TOML: `[requirements]` with `name = "formula"`, or a table `[requirements.name]`."""

import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

from heli_twin.errors import HeliTwinError
from heli_twin.requirements.formula import Formula
from heli_twin.requirements.parser import FormulaError, parse
from heli_twin.requirements.signals import UNITS_OF
from heli_twin.terminal_text import clean, instead

MOST, LARGEST_FILE = 200, 1_000_000
"""Requirements, and bytes, of one file."""
KEYS = ("formula", "text", "source")


class RequirementError(HeliTwinError):
    """A requirement that cannot be read."""


@dataclass(frozen=True)
class Requirement:
    """What a flight must do."""

    name: str
    formula: str
    """As it was written."""
    parsed: Formula
    text: str = ""
    """In words, for a person."""
    source: str = ""
    """Where it comes from: a standard, a document, a customer."""


def shipped() -> dict[str, str]:
    """Return the shipped requirement files: TOML by name."""
    folder = files("heli_twin.requirements") / "shipped"
    return {file.name.removesuffix(".toml"): file.read_text() for file in sorted(folder.iterdir(), key=str)}


def requirements_of(source: Path | str | Mapping[str, Any]) -> tuple[Requirement, ...]:
    """Return the requirements of a TOML file, of a shipped one by its name, or of a mapping like its content.

    Raises:
        RequirementError: One sentence that names the requirement and the place in its formula.
    """
    if isinstance(source, Mapping):
        return _of_table(source.get("requirements", source), "the requirements")
    path = Path(source)
    if not path.suffix and not path.exists():
        known = shipped()
        if str(source) not in known:
            raise RequirementError(f"no file and no shipped requirements are called {instead(source, known)}")
        return _of_text(known[str(source)], str(source))
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST_FILE + 1)
    except OSError as error:
        raise RequirementError(f"{clean(path, 200)} cannot be read: {error.strerror or error}") from None
    if len(data) > LARGEST_FILE:
        raise RequirementError(f"{clean(path, 200)} has more than {LARGEST_FILE} bytes: it is no requirement file")
    try:
        return _of_text(data.decode(), str(path))
    except UnicodeDecodeError:
        raise RequirementError(f"{clean(path, 200)} is not UTF-8 text") from None


def table_of(requirements: Iterable[Requirement]) -> dict[str, dict[str, str]]:
    """Return requirements as the table of a TOML file."""
    return {r.name: {"formula": r.formula, "text": r.text, "source": r.source} for r in requirements}


def _of_text(text: str, name: str) -> tuple[Requirement, ...]:
    name = clean(name, 200)
    try:
        tree = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError, ValueError) as error:
        raise RequirementError(f"{name} is not TOML: {clean(error, 200)}") from None
    if set(tree) != {"requirements"}:
        other = next((key for key in tree if key != "requirements"), None)
        said = f"it has '{clean(other, 60)}'" if other is not None else "it is empty"
        raise RequirementError(f"{name} needs one table, `[requirements]`; {said}")
    return _of_table(tree["requirements"], name)


def _of_table(table: Any, name: str) -> tuple[Requirement, ...]:
    if not isinstance(table, Mapping) or not table:
        raise RequirementError(f'{name}: `[requirements]` has to hold lines such as hover = "always tilt < 20 deg"')
    if len(table) > MOST:
        raise RequirementError(f"{name}: {len(table)} requirements, {MOST} are the most")
    return tuple(_requirement(str(key), value) for key, value in table.items())


def _requirement(name: str, value: Any) -> Requirement:
    shown = f"requirement '{clean(name, 60)}'"
    fields = {"formula": value} if isinstance(value, str) else value
    if not isinstance(fields, Mapping):
        raise RequirementError(f"{shown} has to be a formula in quotes or a table, it is {clean(value, 60)}")
    for key, text in fields.items():
        if key not in KEYS:
            raise RequirementError(f"{shown}: it has no key {instead(key, KEYS)}")
        if not isinstance(text, str):
            raise RequirementError(f"{shown}: {key} has to be text, it is {clean(text, 60)}")
    if "formula" not in fields:
        raise RequirementError(f"{shown} has no formula")
    try:
        parsed = parse(fields["formula"], UNITS_OF)
    except FormulaError as error:
        raise RequirementError(f"{shown}, {error}") from None
    return Requirement(name, fields["formula"], parsed, fields.get("text", ""), fields.get("source", ""))
