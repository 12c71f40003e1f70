"""Sets values at the dotted paths of an experiment's tree.

A `kind` selects the member of a family, with its default values.
"""

import reprlib
from collections.abc import Iterator, Mapping
from dataclasses import is_dataclass
from typing import Any

from controllers.markers import EachOf, OneOf
from heli_twin.experiment import Experiment
from heli_twin.experiment.families import members
from heli_twin.experiment.fields import FieldInfo, fields_of
from heli_twin.experiment.named_files import is_content, rows_of
from heli_twin.experiment.own import OWN, require_own, without_mark
from heli_twin.experiment.past import PHYSICS_VERSION, Tree, restore_past
from heli_twin.experiment.tree import kind_under, table_of, unknown_field
from heli_twin.experiment.values import ExperimentError, listing
from heli_twin.terminal_text import clean, instead


def put(tree: Tree, path: str, value: Any) -> None:
    """Set the value at a dotted path of a tree; another `kind` resets its table to that member's default values.

    Args:
        tree: Tree of a whole experiment, changed in place.
        path: Dotted path of a field or a table.
        value: Number, text, list, or a table with some of the fields.

    Raises:
        ExperimentError: The path names no field; the message suggests one.
    """
    if isinstance(value, dict) and value:
        for inner, leaf in leaves_of(value, f"{path}."):
            put(tree, inner, leaf)
        return
    if "." not in path and path not in tree:
        raise unknown_field(path, tree, [p for p, _ in leaves_of(tree) if p.rpartition(".")[2] == path])
    put_in(tree, Experiment, path.split("."), value, path)


def put_part(tree: Tree, path: str, value: Any) -> None:
    """Set the value at a dotted path of a tree, as `put` does.

    A table with `physics` was written for an older version: fields that it leaves out get the values of that version.
    """
    version = value.get("physics") if isinstance(value, dict) else None
    if type(version) is not int or not 1 <= version <= PHYSICS_VERSION:
        version = PHYSICS_VERSION
    else:
        value = {name: inner for name, inner in value.items() if name != "physics"}
    put(tree, path, value)
    restore_past(Experiment, tree, version, dict(leaves_of({path: value})), under=path)


def leaves_of(tree: Tree, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield every value of a tree with its dotted path; what selects the kind comes first, as it resets the others."""
    for key, value in sorted(
        tree.items(), key=lambda item: (item[0] != OWN, item[0] != "kind", not is_content(item[1]))
    ):
        if isinstance(value, dict) and value:
            yield from leaves_of(value, f"{path}{key}.")
        elif not isinstance(value, dict):
            yield f"{path}{key}", value


def put_in(node: Tree, spec: type, keys: list[str], value: Any, path: str) -> None:
    """Set a value in a tree.

    Args:
        node: Tree of a spec, changed in place.
        spec: Its class.
        keys: The path below it.
        value: Number, text or list, or the kind of a member.
        path: The whole dotted path, for messages.

    Raises:
        ExperimentError: The path names no field; the message suggests one.
    """
    key, *rest = keys
    known = fields_of(spec)
    table = path.split(".")[: -len(rest) - 1]
    if key == OWN:
        require_own(value, ".".join(table))
        return
    if key not in known:
        raise unknown_field(".".join([*table, key]), known)
    info = known[key]
    match info.family:
        case EachOf():
            _put_each(node[key], info.family, rest, value, path)
        case OneOf():
            kinds = members(info.family.package)
            if rest == ["kind"] or (not rest and isinstance(value, str)):
                if not isinstance(value, str) or value not in kinds:
                    raise ExperimentError(f"unknown {key} {instead(value, kinds)}")
                if node[key]["kind"] != value or OWN in node[key]:
                    node[key] = table_of(kinds[value]())
            elif rest:
                if kind := _kind_by_content(kinds, node[key]["kind"], rest, value):
                    node[key] = table_of(kinds[kind]())
                node[key] = without_mark(node[key], ".".join([*table, key]), info.family.package)
                put_in(node[key], kinds[node[key]["kind"]], rest, value, path)
            else:
                raise ExperimentError(f"{path} = {reprlib.repr(value)} names no {key}. {listing(kinds)}")
        case None if isinstance(info.type, type) and is_dataclass(info.type):
            if not rest:
                raise ExperimentError(f"{path} is a table; set one of its fields: {', '.join(fields_of(info.type))}")
            without_mark(node[key], ".".join([*table, key]))
            put_in(node[key], info.type, rest, value, path)
        case None:
            if rest:
                raise ExperimentError(
                    f"{path[: -len('.'.join(rest)) - 1]} is a single value; it has no field '{clean(rest[0], 80)}'"
                )
            node[key] = _read_value(value, info, path)


def _put_each(node: Tree, family: EachOf, keys: list[str], value: Any, path: str) -> None:
    """Set a field of one of several members; or add one with `on` or its kind, or remove it with `off`."""
    kinds = members(family.package)
    if not keys:
        raise ExperimentError(f"{path} is a table; set one of its fields: {', '.join(kinds)}")
    name, *rest = keys
    kind = node[name]["kind"] if name in node else name
    if rest == ["kind"] or (not rest and isinstance(value, str) and value not in ("on", "off")):
        kind = kind_under(name, value, kinds, path.removesuffix(".kind"))
        if name not in node or node[name]["kind"] != kind or OWN in node[name]:
            node[name] = table_of(kinds[kind]())
        return
    table = ".".join(path.split(".")[: -len(keys)])
    if rest == [OWN]:
        require_own(value, f"{table}.{name}")
        return
    if rest and name in node:
        node[name] = without_mark(node[name], f"{table}.{name}", family.package)
    if kind not in kinds and not (value == "off" and name in node):
        raise ExperimentError(
            f"unknown {table} {instead(name, {**kinds, **node})}; to add one with a name of its own, write its kind:"
            f" {table}.NAME=KIND"
        )
    if not rest and value not in ("on", "off"):
        raise ExperimentError(
            f"{path} = {reprlib.repr(value)}: write on, off, or one of its fields: {', '.join(fields_of(kinds[kind]))}"
        )
    if value == "off" and not rest:
        node.pop(name, None)
        return
    node.setdefault(name, table_of(kinds[kind]()))
    if rest:
        put_in(node[name], kinds[kind], rest, value, path)


def _read_value(value: Any, info: FieldInfo, path: str) -> Any:
    """The value that a text is short for: a CSV file for its rows, a text for a list with this text."""
    if isinstance(value, str) and info.columns:
        return rows_of(value, info.columns, path)
    return [value] if isinstance(value, str) and info.type == tuple[str, ...] else value


def _kind_by_content(kinds: Mapping[str, type], now: str, rest: list[str], value: Any) -> str | None:
    """Return the kind with a field for such a content, if that of now has none: the content selects the member."""
    if not is_content(value) or len(rest) != 1:
        return None
    takers = [kind for kind, spec in kinds.items() if (info := fields_of(spec).get(rest[0])) and info.content]
    return takers[0] if takers and now not in takers else None
