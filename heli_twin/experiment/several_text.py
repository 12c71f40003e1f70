"""Reads several helicopters from a preset or a TOML file, and changes them.

A path such as `scenario.ships`, `coordination.distance` or `network.loss` is the room's; `ships.a.plant.mass` is of one
helicopter; any path of an experiment, `plant.mass` or `duration`, is of every one. `base` names the preset or the file
of an experiment that all begin with.
"""

import json
from collections.abc import Iterable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from controllers.programs import beside
from heli_twin.experiment import Experiment
from heli_twin.experiment.fields import fields_of
from heli_twin.experiment.named_files import with_content, with_members
from heli_twin.experiment.own import with_commands
from heli_twin.experiment.past import PHYSICS_VERSION, Tree, restore_past
from heli_twin.experiment.paths import leaves_of, put_in, put_part
from heli_twin.experiment.several import Several, checked_several
from heli_twin.experiment.text import assignment, load, names_a_kind
from heli_twin.experiment.toml_file import ROOM, parsed_file, part_in, presets
from heli_twin.experiment.tree import (
    experiment_of,
    spec_of,
    table_of,
    tree_of,
    unknown_field,
)
from heli_twin.experiment.values import ExperimentError
from heli_twin.terminal_text import clean, instead

EVERY, SHIPS = "every", "ships"
"""Keys of the experiment of every helicopter, and of those of single ones."""


def load_several(source: str, overrides: Iterable[str] = ()) -> Several:
    """Read several helicopters from a preset or a TOML file and change them.

    Args:
        source: Name of a preset, such as `swap4`, or path of a TOML file.
        overrides: Changes, each `path.to.field=value`, as this module says them.

    Raises:
        ExperimentError: The source or an override is wrong; the message names the nearest valid choice.
    """
    known = presets("several")
    if source not in known and not source.endswith(".toml"):
        raise ExperimentError(f"unknown preset {instead(source, known)}; a file of your own ends in .toml")
    path, file = parsed_file(source)
    version = file.pop("physics", PHYSICS_VERSION)
    if type(version) is not int or not 1 <= version <= PHYSICS_VERSION:
        raise ExperimentError(f"{clean(path, 200)} has physics = {clean(version, 40)}: give 1 to {PHYSICS_VERSION}")
    given = [_override(text) for text in overrides]
    base = next((value for name, value in reversed(given) if name == "base"), file.pop("base", "lab"))
    if not isinstance(base, str):
        raise ExperimentError(f"base = {clean(base, 60)}: give the name of a preset or of a TOML file of an experiment")
    tree = table_of(Several(every=load(base)))
    ships: dict[str, Tree] = {}
    said = [*leaves_of(_read(file, path.parent))]
    for change in _in_order(said):
        put_several(tree, ships, *change)
    for each, prefix in ((tree["every"], ""), *((ship, f"ships.{name}.") for name, ship in ships.items())):
        of_all = [name.removeprefix("every.") for name, _ in said]
        of_one = [name.removeprefix(prefix) for name, _ in said if name.startswith(prefix)]
        restore_past(Experiment, each, version, [*of_all, *of_one])
    return _changed(tree, ships, [(name, value) for name, value in given if name != "base"])


def _read(file: Tree, folder: Path) -> Tree:
    """Return the tables of a file with the contents, classes and programs that they name beside it."""

    def read(table: Any) -> Any:
        table = with_content("", with_members("", table, folder), folder)
        return with_commands(table, partial(beside, folder))

    apart = {name: file[name] for name in file.keys() & (ROOM | {"every", "ships"})}
    for name in apart.keys() & {"every"}:
        apart[name] = read(apart[name])
    if isinstance(ships := apart.get("ships"), dict):
        apart["ships"] = {name: read(table) for name, table in ships.items()}
    return {**read({name: table for name, table in file.items() if name not in apart}), **apart}


def _in_order(given: Iterable[tuple[str, Any]]) -> list[tuple[str, Any]]:
    """Return changes in an order in which they can be made: those of one helicopter last, kinds before their fields."""

    def order(change: tuple[str, Any]) -> tuple[bool, bool]:
        path, value = change
        words = path.split(".")
        in_room = words[0] in ROOM and (words[1:] in ([], ["kind"]))
        return words[0] == SHIPS, not (in_room or names_a_kind(_within(path), value))

    return sorted(given, key=order)


def _override(text: str) -> tuple[str, Any]:
    """Parse an override, also one that names a class or the content of a file; return its path and its value."""
    path, value = assignment(text, "path=value, such as plant.mass=0.03 or ships.a.plant.mass=0.03")
    inner = _within(path)
    if not inner or path == "base":
        return path, value
    value = with_content(inner, with_members(inner, value, Path()), Path())
    return path, part_in(value, inner) if isinstance(value, str) and value.endswith(".toml") else value


def _within(path: str) -> str:
    """Return the part of a path that is a path of an experiment; empty for one of the room."""
    words = path.split(".")
    if words[0] in ROOM:
        return ""
    return ".".join(words[2:] if words[0] == SHIPS else words[words[0] == EVERY :])


def put_several(tree: Tree, ships: dict[str, Tree], path: str, value: Any) -> None:
    """Set the value at a dotted path.

    Args:
        tree: Of a `Several` without its ships, changed in place.
        ships: Trees of experiments by name, changed in place; a new name begins as every helicopter is.
        path: Dotted path, as this module says.
        value: Number, text, list, or a table with some of the fields.

    Raises:
        ExperimentError: The path names no field; the message suggests one.
    """
    first, _, rest = path.partition(".")
    if isinstance(value, dict) and value and (first in ROOM or (first == "ships" and rest.count(".") == 0)):
        for inner, leaf in leaves_of(value, f"{path}."):
            put_several(tree, ships, inner, leaf)
    elif first in ROOM:
        put_in(tree, Several, path.split("."), value, path)
    elif first == "ships":
        _put_ship(tree, ships, rest, value)
    elif first in fields_of(Experiment) or first == "every":
        inner = rest if first == "every" else path
        for each in (tree["every"], *ships.values()):
            put_part(each, inner, value)
    else:
        raise unknown_field(path, [*sorted(ROOM), "ships", *fields_of(Experiment)])


def _put_ship(tree: Tree, ships: dict[str, Tree], path: str, value: Any) -> None:
    name, _, inner = path.partition(".")
    if not name or (not inner and value != {}):
        raise ExperimentError("ships is a table of helicopters by name: set one of its fields, ships.a.plant.mass=0.03")
    if name not in ships:
        ships[name] = json.loads(json.dumps(tree["every"]))
    if inner:
        _refuse_wish(tree, inner, f"ships.{path}", name)
        try:
            put_part(ships[name], inner, value)
        except ExperimentError as error:
            raise ExperimentError(f"ships.{clean(name, 60)}: {error}") from None


def _refuse_wish(tree: Tree, inner: str, path: str, name: str = "") -> None:
    """Refuse to change a trajectory that the scenario says."""
    if inner.partition(".")[0] != "trajectory" or tree["scenario"]["kind"] == "own":
        return
    if not name or name in _of_scenario(tree):
        raise ExperimentError(
            f"{clean(path, 80)}: what they fly is the scenario's: change scenario.*, or write scenario=own first"
        )


def _of_scenario(tree: Tree) -> Iterable[str]:
    try:
        return spec_of(Several, {"scenario": tree["scenario"]}).scenario.wishes()
    except ValueError:
        return ()


def several_of(tree: Tree, ships: dict[str, Tree]) -> Several:
    """Make a validated value from a tree without its ships, and the trees of these by name.

    Raises:
        ExperimentError: Names the field, its value, the limit and the default.
    """
    several: Several = spec_of(Several, tree)
    own: dict[str, Experiment] = {}
    for name, ship in sorted(ships.items()):
        try:
            own[name] = experiment_of(ship)
        except ExperimentError as error:
            raise ExperimentError(f"ships.{clean(name, 60)}: {error}") from None
    return checked_several(replace(several, ships=own))


def changed_several(several: Several, overrides: Iterable[str]) -> Several:
    """Return several helicopters with some fields changed.

    Raises:
        ExperimentError: An override is wrong; the message names the nearest valid choice.
    """
    given = [_override(text) for text in overrides]
    if any(path == "base" for path, _ in given):
        raise ExperimentError("base: what is flown begins with it, so that it is given with a preset or a file alone")
    tree, ships = table_of(several), {name: tree_of(ship) for name, ship in several.ships.items()}
    return _changed(tree, ships, given)


def _changed(tree: Tree, ships: dict[str, Tree], given: Iterable[tuple[str, Any]]) -> Several:
    for path, value in _in_order(given):
        # A file may hold the trajectory of every one, as all other fields.
        _refuse_wish(tree, path.removeprefix("every."), path)
        put_several(tree, ships, path, value)
    return several_of(tree, ships)
