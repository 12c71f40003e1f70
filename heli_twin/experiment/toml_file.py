"""Reads a preset or a TOML file: its tables, and the physics version that it was written for."""

import reprlib
import tomllib
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

from controllers.programs import beside
from heli_twin.experiment.named_files import with_content, with_members
from heli_twin.experiment.own import with_commands
from heli_twin.experiment.past import PHYSICS_VERSION, Tree
from heli_twin.experiment.values import ExperimentError, check_size
from heli_twin.terminal_text import clean, instead


def presets(folder_name: str = "") -> dict[str, Path]:
    """Return the TOML files of the experiments that come with heli_twin, by name; `several`: of several helicopters."""
    folder = Path(str(files("heli_twin") / "presets")) / folder_name
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


ROOM = frozenset({"scenario", "coordination", "network", "shared", "transmitters", "world"})
"""Fields of a room of several helicopters; the first words of their paths."""


SIGNS_OF_SEVERAL = ROOM | {"ships", "every", "base"}
"""A TOML file with one of these at its top is of several helicopters."""


def is_several(source: str | None) -> bool:
    """Return whether a preset or a TOML file is of several helicopters.

    Raises:
        ExperimentError: The file cannot be read.
    """
    if source is None or source in presets():
        return False
    return source in presets("several") or (
        source.endswith(".toml") and not SIGNS_OF_SEVERAL.isdisjoint(parsed_file(source)[1])
    )


class TomlFile(NamedTuple):
    """A preset or a TOML file."""

    tree: Tree
    """Its tables, without those of `NOT_FLOWN`."""
    version: int
    """Physics version that they were written for."""
    is_calibration: bool
    """True if it says what flights have covered."""


NOT_FLOWN = ("envelope", "noise")
"""Tables of a calibration that say no field of an experiment."""


def read_file(source: str) -> TomlFile:
    """Return a preset or a TOML file."""
    path, tree = parsed_file(source)
    if not SIGNS_OF_SEVERAL.isdisjoint(tree):
        raise ExperimentError(
            f"{clean(source, 200)} is of several helicopters: `heli-twin fly` and `fly_several` fly it"
        )
    is_calibration = "envelope" in tree
    for name in NOT_FLOWN:
        tree.pop(name, None)
    version = tree.pop("physics", PHYSICS_VERSION)
    if type(version) is not int or not 1 <= version <= PHYSICS_VERSION:
        raise ExperimentError(
            f"{clean(path, 200)} has physics = {reprlib.repr(version)}: this heli_twin knows the versions 1 to"
            f" {PHYSICS_VERSION}; update it,"
            " or remove the line to read the file with today's defaults"
        )
    tree = with_content("", with_members("", tree, path.parent), path.parent)
    return TomlFile(with_commands(tree, partial(beside, path.parent)), version, is_calibration)


def part_in(file: str, path: str) -> Tree:
    """Return the table at a dotted path in a TOML file; `physics` in it is the version of an older file.

    Raises:
        ExperimentError: The file cannot be read, or has no such table.
    """
    tree, version, _ = read_file(file)
    table: Any = tree
    for key in path.split("."):
        table = table.get(key) if isinstance(table, dict) else None
    if not isinstance(table, dict):
        raise ExperimentError(f"{clean(file, 200)} has no table [{clean(path, 80)}]")
    return table | {"physics": version} if version < PHYSICS_VERSION else table


def table_in(source: str, name: str) -> Tree:
    """Return one of the tables `NOT_FLOWN` of a preset or a TOML file; empty if it has none.

    Raises:
        ExperimentError: The file cannot be read, or it is no table.
    """
    _, tree = parsed_file(source)
    table = tree.get(name, {})
    if not isinstance(table, dict):
        raise ExperimentError(f"{clean(source, 200)}: {name} = {reprlib.repr(table)} is not a table")
    return table


def parsed_file(source: str) -> tuple[Path, Tree]:
    """Return the path of a preset or a TOML file, and its tables."""
    known = presets() | presets("several")
    path = known.get(source, Path(source))
    if source not in known and path.suffix != ".toml":
        together = ", ".join(presets("several"))
        raise ExperimentError(
            f"unknown preset {instead(source, presets())}; of several helicopters: {together}; a file of your own ends"
            " in .toml"
        )
    try:
        if path.exists() and not path.is_file():
            raise ExperimentError(f"cannot read {clean(path, 200)}: it is not a file")
        tree = toml_table(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ExperimentError(f"cannot read {clean(path, 200)}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise ExperimentError(f"cannot read {clean(path, 200)}: it is not UTF-8 text") from None
    except NOT_TOML as error:
        # Python's own sentence about integers of more than 4300 digits is for programmers.
        reason = "an integer has too many digits" if "set_int_max_str_digits" in str(error) else clean(error, 200)
        raise ExperimentError(f"{clean(path, 200)} is not valid TOML: {reason}") from None
    return path, tree


NOT_TOML = (ValueError, RecursionError)
"""Errors of the TOML parser: its own, and those of Python for a number of 5000 digits or a thousand brackets."""


def toml_table(text: str) -> Tree:
    """Parse TOML.

    Raises:
        ValueError: It is not valid TOML.
        RecursionError: It is nested too deeply; with `ValueError` this is `NOT_TOML`.
        ExperimentError: It is too large.
    """
    tree = tomllib.loads(text)
    check_size(tree)
    return tree
