"""The command that flies a run again: what differs from a preset, and nothing else."""

import json
import shlex
from collections.abc import Iterator
from functools import cache
from typing import Any

from heli_twin.configuration import load, presets
from heli_twin.specs import Tree, canonical_json


def fly_command(experiment: str) -> str:
    """The shortest `heli-twin fly` that flies an experiment.

    Args:
        experiment: Canonical JSON.
    """
    tree = json.loads(experiment)
    commands = [f"heli-twin fly{name}{_words(tree, base)}" for name, base in _bases().items()]
    return min(commands, key=len)


@cache
def _bases() -> dict[str, Tree]:
    return {"" if name == "lab" else f" {name}": json.loads(canonical_json(load(name))) for name in presets()}


def _words(tree: Tree, base: Tree) -> str:
    words = [f"{path}={_text(value)}" for path, value in changes(tree, base)]
    return "".join(" " + shlex.quote(word) for word in words)


def changes(tree: Tree, base: Tree, here: str = "") -> Iterator[tuple[str, Any]]:
    """Every value that differs, by dotted path; a part of another kind is compared with that kind's defaults."""
    for key, value in tree.items():
        path = f"{here}{key}"
        if not isinstance(value, dict):
            if value != base.get(key):
                yield path, value
        elif here in ("disturbances.", "faults.") and key not in base:
            yield path, "on"
            yield from changes(value, _defaults(path, "on"), f"{path}.")
        elif value.get("kind") != base[key].get("kind"):
            yield path, value["kind"]
            yield from changes(value, _defaults(path, value["kind"]), f"{path}.")
        else:
            yield from changes(value, base[key], f"{path}.")
    for key in base.keys() - tree.keys():
        yield f"{here}{key}", "off"


def _defaults(path: str, kind: str) -> Tree:
    """A part of a kind as `heli-twin fly path=kind` has it."""
    tree = json.loads(canonical_json(load(None, [f"{path}={kind}"])))
    for key in path.split("."):
        tree = tree[key]
    return tree


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)
