"""The fields in which two experiments differ, and the shortest command that flies an experiment."""

import hashlib
import json
import reprlib
from collections.abc import Iterator
from functools import cache
from typing import Any, NamedTuple

from heli_twin.experiment import Experiment
from heli_twin.experiment.families import members
from heli_twin.experiment.own import OWN
from heli_twin.experiment.places import family_at
from heli_twin.experiment.text import load
from heli_twin.experiment.toml_file import presets
from heli_twin.experiment.tree import Tree, parsed, table_of, tree_of
from heli_twin.experiment.values import ExperimentError
from heli_twin.terminal_text import clean, instead, pasteable


class Change(NamedTuple):
    """A field in which two trees differ."""

    path: str
    """Dotted path of the field."""
    before: Any
    after: Any
    is_member: bool = False
    """True if a member of a family is replaced, added or removed: the values are kinds, `on` or `off`."""


def changes(before: Tree, after: Tree, here: str = "") -> Iterator[Change]:
    """Yield the overrides that make `after` of `before`, in an order in which they can be applied.

    If a part has another kind, its kind comes first, then the fields that differ from that kind's default values.

    Args:
        before: Tree of an experiment or of one part.
        after: Tree of the same class.
        here: Dotted path of both in the experiment, with a dot at its end; empty for whole experiments.
    """
    for key, value in after.items():
        path, old = f"{here}{key}", before.get(key)
        if not isinstance(value, dict):
            if value != old:
                yield Change(path, old, value)
        elif old is None:
            # Only disturbances, faults and effects can be added and removed.
            yield Change(path, "off", _added(key, value), is_member=True)
            yield from _beyond_defaults(value, path)
        elif value.get("kind") != before[key].get("kind"):
            yield Change(path, before[key]["kind"], value["kind"], is_member=True)
            yield from _beyond_defaults(value, path)
        else:
            yield from changes(before[key], value, f"{path}.")
    for key, value in before.items():
        # A log of a stranger may leave out a field: it has its default value.
        if key not in after and isinstance(value, dict) and "kind" in value:
            yield Change(f"{here}{key}", _added(key, value), "off", is_member=True)


def _beyond_defaults(member: Tree, path: str) -> Iterator[Change]:
    """Yield the fields of a new member that differ from their defaults; of a class of a user's own all but tables."""
    if OWN not in member:
        yield from changes(_defaults(path, member["kind"]), member, f"{path}.")
        return
    for key, value in member.items():
        if key not in ("kind", OWN) and not isinstance(value, dict):
            yield Change(f"{path}.{key}", None, value)


def _added(name: str, member: Tree) -> str:
    """Return the value that adds a disturbance or a fault: `on`, or its kind if it has another name."""
    return "on" if member["kind"] == name else member["kind"]


def differences(a: Experiment, b: Experiment) -> list[tuple[str, str, str]]:
    """Return each field in which two experiments differ: dotted path, value in `a`, value in `b`, as texts.

    For a part that has different kinds, only the kinds are listed, because its fields differ in meaning.
    """
    changed: list[tuple[str, str, str]] = []
    replaced: tuple[str, ...] = ()
    for path, of_a, of_b, is_member in changes(tree_of(a), tree_of(b)):
        if path.startswith(replaced):
            continue
        if is_member:
            replaced += (f"{path}.",)
        text = str if is_member else _short
        changed.append((path, text(of_a), text(of_b)))
    return changed


def fly_command(experiment: str) -> str:
    """Return the shortest `heli-twin fly` command that flies an experiment.

    Args:
        experiment: Canonical JSON.
    """
    return pasteable("heli-twin", "fly", *fly_words(experiment))


def fly_words(experiment: str) -> list[str]:
    """Return the arguments of `fly_command`: a preset other than `lab`, and overrides."""
    from heli_twin.experiment.several_written import is_several_json, words_of

    if is_several_json(experiment):
        return words_of(experiment)
    tree = parsed(experiment)
    candidates = [
        [name] * (name != "lab")
        + [
            f"{change.path}={_text(change.after)}"
            for change in changes(base, tree)
            if not change.path.endswith(f".{OWN}")
        ]
        for name, base in _bases().items()
    ]
    return min(candidates, key=lambda words: len(pasteable(*words)))


@cache
def _bases() -> dict[str, Tree]:
    return {name: tree_of(load(name)) for name in presets()}


def _defaults(path: str, kind: str) -> Tree:
    """Return the tree of a part after `path=kind` where another kind, or none, was before."""
    family = family_at(path)
    kinds = members(family) if family else {}
    if kind not in kinds:
        raise ExperimentError(f"unknown {path} {instead(kind, kinds)}")
    return table_of(kinds[kind]())


def _text(value: Any) -> str:
    return told(value) if isinstance(value, str) else json.dumps(value)


def _short(value: Any) -> str:
    return reprlib.repr(value) if isinstance(value, list) else json.dumps(told(value))


def told(value: Any) -> Any:
    """A value for a table or a command: of a text of several lines, its first line and a hash; others as they are."""
    if not isinstance(value, str) or "\n" not in value:
        return value
    first_line, _, _ = value.partition("\n")
    return f"{clean(first_line, 60)} #{hashlib.sha256(value.encode()).hexdigest()[:8]}"
