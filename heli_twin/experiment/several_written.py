"""Several helicopters as JSON, as a log and a study hold them, as TOML, and as the shortest command that flies them."""

import json
from collections.abc import Iterable
from dataclasses import replace
from functools import cache
from typing import Any

from heli_twin.experiment import Experiment
from heli_twin.experiment.families import members
from heli_twin.experiment.own import refuse_commands, with_program_at_hand
from heli_twin.experiment.past import Tree, add_past, leave_out_past
from heli_twin.experiment.places import family_at
from heli_twin.experiment.several import Several
from heli_twin.experiment.several_text import EVERY, SHIPS, load_several, several_of
from heli_twin.experiment.toml_file import ROOM, presets
from heli_twin.experiment.tree import physics_line, table_of, toml_lines, toml_text, tree_of
from heli_twin.experiment.values import ExperimentError, check_size


def several_json(several: Several) -> str:
    """Return the unique JSON text of several helicopters; new fields with their past values are left out."""
    tree, ships = table_of(several), {name: tree_of(ship) for name, ship in several.ships.items()}
    leave_out_past(Several, tree)
    for ship in ships.values():
        leave_out_past(Experiment, ship)
    return json.dumps(tree | {"ships": ships}, sort_keys=True, separators=(",", ":"), allow_nan=False)


def is_several_json(text: str) -> bool:
    """Return whether canonical JSON is of several helicopters."""
    try:
        tree = json.loads(text)
    except (ValueError, RecursionError):
        return False
    return isinstance(tree, dict) and EVERY in tree


def parsed_several(text: str) -> Tree:
    """Parse canonical JSON of this version or an older one to a tree; its values are not validated.

    Raises:
        ExperimentError: The text is none of several helicopters.
    """
    try:
        tree = json.loads(text)
        check_size(tree)
    except (ValueError, RecursionError) as error:
        raise ExperimentError(f"the experiment is not valid JSON: {error}") from None
    ships = tree.setdefault(SHIPS, {}) if isinstance(tree, dict) else None
    if not isinstance(ships, dict) or not all(isinstance(each, dict) for each in (*ships.values(), tree.get(EVERY))):
        raise ExperimentError("the experiment is not one of several helicopters")
    for each in (tree[EVERY], *ships.values()):
        refuse_commands(each)
    add_past(Several, tree)
    for ship in ships.values():
        add_past(Experiment, ship)
    return tree


def several_from_json(text: str) -> Several:
    """Return the helicopters that `several_json` of this version or an older one wrote.

    Raises:
        ExperimentError: The text is none that this version can read.
    """
    tree = parsed_several(text)
    read = several_of(tree, tree.pop(SHIPS))
    own = {name: with_program_at_hand(ship) for name, ship in read.ships.items()}
    return replace(read, every=with_program_at_hand(read.every), ships=own)


def words_of(text: str) -> list[str]:
    """Return the arguments of the shortest `heli-twin fly` command that flies several helicopters: preset, overrides.

    Args:
        text: Canonical JSON.
    """
    tree = parsed_several(text)
    candidates = [[name, *base, *_overrides(start, tree)] for name, base, start in _starts()]
    return min(candidates, key=lambda words: len(" ".join(words)))


@cache
def _starts() -> list[tuple[str, tuple[str, ...], Tree]]:
    """Preset, another base than its own, and tree of what a command can begin with."""
    return [
        (name, base, parsed_several(several_json(load_several(name, base))))
        for name in presets("several")
        for base in ((), ("base=lab",), ("base=lab_simple",))
    ]


def _overrides(start: Tree, tree: Tree) -> list[str]:
    """Return the overrides that make one tree of another; kinds come before their fields."""
    found: list[str] = []
    for here, before, after, spec in (
        ("", *({name: t[name] for name in sorted(ROOM)} for t in (start, tree)), Several),
        ("", start[EVERY], tree[EVERY], Experiment),
        *((f"ships.{name}.", tree[EVERY], ship, Experiment) for name, ship in tree[SHIPS].items()),
    ):
        for path, value in _differing(before, after, spec):
            text = value if isinstance(value, str) else json.dumps(value)
            found.append(f"{here}{path}={text}")
    return found


def _differing(before: Tree, after: Tree, spec: type, here: str = "") -> Iterable[tuple[str, Any]]:
    """Yield the changes that make one tree of another, in an order in which they can be made.

    Args:
        before: A tree of `spec`, or of a part of one.
        after: The same.
        spec: Class in which the paths begin.
        here: Dotted path of the part, with a dot at its end.
    """
    for key, value in sorted(after.items(), key=lambda item: item[0] != "kind"):
        old, path = before.get(key), f"{here}{key}"
        if not isinstance(value, dict):
            if value != old:
                yield path, value
            continue
        if not isinstance(old, dict) or value.get("kind") != old.get("kind"):
            kind = value["kind"]
            yield path, "on" if old is None and kind == key else kind
            old = _defaults(path, kind, spec)
        yield from _differing(old, value, spec, f"{path}.")
    for key, old in before.items():
        if key not in after and isinstance(old, dict):
            yield f"{here}{key}", "off"


def _defaults(path: str, kind: str, spec: type) -> Tree:
    """Return the tree of a member that is new at a dotted path."""
    family = family_at(path, spec)
    made = members(family).get(kind) if family else None
    return table_of(made()) if made else {"kind": kind}


def several_toml(several: Several) -> str:
    """Return several helicopters as the text of a TOML file: every field, and of each of `ships` what is its own."""
    lines = [physics_line(), *toml_lines(several, "")]
    every = tree_of(several.every)
    for name, ship in several.ships.items():
        lines += ["", f"[ships.{name}]"]
        for path, value in _differing(every, tree_of(ship), Experiment):
            text = toml_text(value) if isinstance(value, str) else json.dumps(value)
            lines.append(f"{path}{'.kind' * _is_table(path, every)} = {text}")
    return "\n".join(lines).strip() + "\n"


def _is_table(path: str, tree: Tree) -> bool:
    """Return whether a table stands at a dotted path, whose kind is to be set."""
    here: Any = tree
    for key in path.split("."):
        here = here.get(key) if isinstance(here, dict) else None
    return isinstance(here, dict) and "kind" in here
