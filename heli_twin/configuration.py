"""The edge where text becomes an experiment: presets, TOML files, dotted overrides, and clear refusals.

As a tree, an experiment is nested tables. A part's `kind` says which member of its family it is, and
`part = "kind"` is short for that member with its defaults. Disturbances and faults are tables by their kind;
`"off"` leaves one out, `"on"` adds one with its defaults.
"""

import csv
import json
import math
import reprlib
import tomllib
from collections.abc import Iterable, Iterator
from dataclasses import fields, is_dataclass
from difflib import get_close_matches
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, NamedTuple, get_args, get_origin, get_type_hints

from annotated_types import DocInfo, Unit
from pydantic import TypeAdapter, ValidationError

from controllers.markers import Rows
from heli_twin.errors import HeliTwinError
from heli_twin.experiment import Experiment
from heli_twin.families import EachOf, OneOf, members

Tree = dict[str, Any]


class ExperimentError(HeliTwinError):
    """An experiment that cannot be flown as it was written."""


class Part(NamedTuple):
    """One field of a spec, as its annotation describes it."""

    type: Any
    """Without its bounds."""
    adapter: TypeAdapter[Any] | None
    """Validates a plain value; None for a table."""
    family: OneOf | EachOf | None
    unit: str
    """Empty for a value without one."""
    doc: str
    columns: tuple[str, ...] = ()
    """Of the CSV file that may stand for it; empty for a value that is no table of rows."""


@cache
def parts(spec: type) -> dict[str, Part]:
    """The fields of a spec by name."""
    hints = get_type_hints(spec, include_extras=True)
    return {f.name: _part(hints[f.name]) for f in fields(spec)}


def _part(hint: Any) -> Part:
    bare, *extras = get_args(hint) if get_origin(hint) is Annotated else (hint,)
    family = next((e for e in extras if isinstance(e, OneOf | EachOf)), None)
    unit = next((e.unit for e in extras if isinstance(e, Unit)), "")
    text = next((e.documentation for e in extras if isinstance(e, DocInfo)), "")
    plain = family is None and not is_dataclass(bare)
    columns = next((e.columns for e in extras if isinstance(e, Rows)), ())
    return Part(bare, TypeAdapter(hint) if plain else None, family, unit, text, columns)


def presets() -> dict[str, Path]:
    """The experiments that come with heli_twin, by name."""
    folder = Path(str(files("heli_twin") / "presets"))
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def load(source: str | None = None, overrides: Iterable[str] = ()) -> Experiment:
    """Read an experiment from a preset or a TOML file and change it.

    Args:
        source: Name of a preset or path of a TOML file; None for `lab`.
        overrides: Changes, each `path.to.field=value`; a change of `kind` counts before the others.

    Raises:
        ExperimentError: One sentence that says what is wrong and what would be right.
    """
    tree = tree_of(Experiment())
    for path, value in _leaves(_read(source or "lab")):
        put(tree, path, value)
    return _changed(tree, overrides)


def changed(experiment: Experiment, overrides: Iterable[str]) -> Experiment:
    """An experiment with some fields changed, each `path.to.field=value`, as `load` does.

    Raises:
        ExperimentError: One sentence that says what is wrong and what would be right.
    """
    return _changed(tree_of(experiment), overrides)


def _changed(tree: Tree, overrides: Iterable[str]) -> Experiment:
    for path, value in sorted(map(_override, overrides), key=lambda change: not _names_a_kind(*change)):
        put(tree, path, value)
    return experiment_of(tree)


def _names_a_kind(path: str, value: Any) -> bool:
    return path.endswith(".kind") or ("." not in path and isinstance(value, str | dict))


def _read(source: str) -> Tree:
    known = presets()
    path = known.get(source, Path(source))
    if source not in known and path.suffix != ".toml":
        raise ExperimentError(f"unknown preset {_instead(source, known)}; a file of your own ends in .toml")
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ExperimentError(f"cannot read {path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise ExperimentError(f"cannot read {path}: it is not UTF-8 text") from None
    except _NOT_TOML as error:
        raise ExperimentError(f"{path} is not valid TOML: {error}") from None


_NOT_TOML = (ValueError, RecursionError)
"""What the parser raises: its own error, and what a number of 5000 digits or a thousand brackets make of Python."""


def _leaves(tree: Tree, path: str = "") -> Iterator[tuple[str, Any]]:
    """Every value of a tree with its dotted path; names of members come first, since they bring defaults along."""
    for key, value in sorted(tree.items(), key=lambda item: item[0] != "kind"):
        if isinstance(value, dict) and value:
            yield from _leaves(value, f"{path}{key}.")
        elif not isinstance(value, dict):
            yield f"{path}{key}", value


def _override(text: str) -> tuple[str, Any]:
    path, equals, value = text.partition("=")
    if not equals or not path.strip():
        raise ExperimentError(f"'{text}' is not an override: write path.to.field=value, such as plant.mass=0.03")
    if value.strip().endswith(".toml"):
        return path.strip(), _table_in(value.strip(), path.strip())
    try:
        return path.strip(), tomllib.loads(f"v = {value}")["v"]
    except _NOT_TOML:
        return path.strip(), value.strip()


def _table_in(file: str, path: str) -> Tree:
    """The table that stands at a dotted path in a TOML file."""
    table: Any = _read(file)
    for key in path.split("."):
        table = table.get(key) if isinstance(table, dict) else None
    if not isinstance(table, dict):
        raise ExperimentError(f"{file} has no table [{path}]")
    return table


def put(tree: Tree, path: str, value: Any) -> None:
    """Set the value at a dotted path of a whole tree; another `kind` starts from that member's defaults.

    Raises:
        ExperimentError: The path names no field; the message suggests one.
    """
    if isinstance(value, dict) and value:
        for inner, leaf in _leaves(value, f"{path}."):
            put(tree, inner, leaf)
        return
    _put(tree, Experiment, path.split("."), value, path)


def _put(node: Tree, spec: type, keys: list[str], value: Any, path: str) -> None:
    key, *rest = keys
    known = parts(spec)
    if key not in known:
        table = path.split(".")[: -len(rest) - 1]
        raise ExperimentError(
            f"unknown field {_instead('.'.join([*table, key]), ['.'.join([*table, k]) for k in known])}"
        )
    part = known[key]
    match part.family:
        case EachOf():
            _put_each(node[key], part.family, rest, value, path)
        case OneOf():
            kinds = members(part.family.package)
            if rest == ["kind"] or (not rest and isinstance(value, str)):
                if not isinstance(value, str) or value not in kinds:
                    raise ExperimentError(f"unknown {key} {_instead(value, kinds)}")
                if node[key]["kind"] != value:
                    node[key] = _table(kinds[value]())
            elif rest:
                _put(node[key], kinds[node[key]["kind"]], rest, value, path)
            else:
                raise ExperimentError(f"{path} = {value!r} names no {key}. Available: {', '.join(kinds)}")
        case None if isinstance(part.type, type) and is_dataclass(part.type):
            if not rest:
                raise ExperimentError(f"{path} is a table; set one of its fields: {', '.join(parts(part.type))}")
            _put(node[key], part.type, rest, value, path)
        case None:
            if rest:
                raise ExperimentError(
                    f"{path[: -len('.'.join(rest)) - 1]} is a single value; it has no field '{rest[0]}'"
                )
            node[key] = _rows(value, part.columns, path) if part.columns and isinstance(value, str) else value


def _rows(file: str, columns: tuple[str, ...], path: str) -> list[list[float]]:
    """The rows of a CSV file: its content becomes part of the experiment, so that a log flies without the file."""
    line = 1
    try:
        with Path(file).open(encoding="utf-8-sig", newline="") as text:
            table = csv.DictReader(text, skipinitialspace=True, strict=True)
            missing = [column for column in columns if column not in (table.fieldnames or ())]
            if missing:
                raise ExperimentError(
                    f"{path}: {file} has no column {missing[0]}; its first line has to name {', '.join(columns)}"
                )
            rows: list[list[float]] = []
            for row in table:
                line = table.line_num
                rows.append([float(row[column] or "") for column in columns])
    except OSError as error:
        raise ExperimentError(f"{path}: cannot read {Path(file).absolute()}: {error.strerror}") from None
    except (ValueError, csv.Error) as error:
        raise ExperimentError(f"{path}: {file}, line {line} is not a row of numbers: {error}") from None
    return rows


def _put_each(node: Tree, family: EachOf, keys: list[str], value: Any, path: str) -> None:
    kinds = members(family.package)
    if not keys:
        raise ExperimentError(f"{path} is a table; set one of its fields: {', '.join(kinds)}")
    kind, *rest = keys
    if kind not in kinds:
        raise ExperimentError(f"unknown {path.split('.')[0]} {_instead(kind, kinds)}")
    if rest:
        node.setdefault(kind, _table(kinds[kind]()))
        _put(node[kind], kinds[kind], rest, value, path)
    elif value == "off":
        node.pop(kind, None)
    elif value == "on":
        node.setdefault(kind, _table(kinds[kind]()))
    else:
        raise ExperimentError(
            f"{path} = {value!r}: write on, off, or one of its fields: {', '.join(parts(kinds[kind]))}"
        )


def _instead(wrong: Any, known: Iterable[str]) -> str:
    """`'wrong': did you mean 'right'? Available: ...`."""
    known = list(known)
    near = get_close_matches(str(wrong), known, n=1, cutoff=0.5)
    return f"'{wrong}': " + (f"did you mean '{near[0]}'? " if near else "") + f"Available: {', '.join(known)}"


def tree_of(experiment: Experiment) -> Tree:
    """An experiment as nested tables of plain values."""
    return _table(experiment)


def _table(spec: Any) -> Tree:
    table: Tree = {}
    for name, part in parts(type(spec)).items():
        value = getattr(spec, name)
        if isinstance(part.family, EachOf):
            table[name] = {member.kind: _table(member) for member in value}
        elif part.adapter is None:
            table[name] = _table(value)
        else:
            table[name] = _listed(value)
    return table


def _listed(value: Any) -> Any:
    return [_listed(v) for v in value] if isinstance(value, tuple) else value


def experiment_of(tree: Tree) -> Experiment:
    """A validated experiment from a whole tree.

    Raises:
        ExperimentError: Names the field, its value, the limit and the default.
    """
    return _spec(Experiment, tree, "")


def spec_of(spec: type, tree: Any) -> Any:
    """A validated spec of another kind from a tree, a study for one; fields left out keep their defaults.

    Raises:
        ExperimentError: Names the field, its value, the limit and the default.
    """
    return _spec(spec, tree, "")


def _spec(spec: type, tree: Any, here: str) -> Any:
    if not isinstance(tree, dict):
        raise ExperimentError(f"{here[:-1]} = {tree!r} is not a table")
    known = parts(spec)
    unknown = next((key for key in tree if key not in known), None)
    if unknown is not None:
        raise ExperimentError(f"unknown field {_instead(here + unknown, [here + k for k in known])}")
    values = {}
    for name, value in tree.items():
        part, path = known[name], here + name
        if part.adapter is not None:
            values[name] = _value(part, value, path, spec)
            continue
        if not isinstance(value, dict):
            raise ExperimentError(f"{path} = {value!r} is not a table")
        if part.family is None:
            values[name] = _spec(part.type, value, f"{path}.")
            continue
        kinds = members(part.family.package)
        tables = value if isinstance(part.family, EachOf) else {str(value.get("kind")): value}
        for kind in tables:
            if kind not in kinds:
                raise ExperimentError(f"unknown {name} {_instead(kind, kinds)}")
        each = isinstance(part.family, EachOf)
        specs = tuple(
            _spec(kinds[kind], table, f"{path}.{kind}." if each else f"{path}.")
            for kind, table in sorted(tables.items())
        )
        values[name] = specs if each else specs[0]
    try:
        return spec(**values)
    except ValueError as error:
        raise ExperimentError(f"{here}{error}") from None


def _value(part: Part, value: Any, path: str, spec: type) -> Any:
    assert part.adapter is not None
    if any(isinstance(v, float) and not math.isfinite(v) for v in _leaves_of(value)):
        raise ExperimentError(f"{path} = {reprlib.repr(value)} is not a finite number; {_default(part, spec, path)}")
    try:
        return part.adapter.validate_json(json.dumps(value, default=str), strict=True)
    except ValidationError as errors:
        error = errors.errors()[0]
        where = path + "".join(f"[{i}]" for i in error["loc"])
        message = error["msg"][:1].lower() + error["msg"][1:]
        if error["type"] == "literal_error":
            options = [str(option) for option in get_args(part.type)]
            raise ExperimentError(f"{path} = {_instead(value, options)}") from None
        unit = f" {part.unit}" if part.unit and "ctx" in error else ""
        message = message.replace("input should be", "it must be") + unit
        raise ExperimentError(
            f"{where} = {reprlib.repr(error['input'])}: {message}; {_default(part, spec, path)}"
        ) from None


def _leaves_of(value: Any) -> Iterator[Any]:
    if isinstance(value, list):
        for inner in value:
            yield from _leaves_of(inner)
    else:
        yield value


def _default(part: Part, spec: type, path: str) -> str:
    if part.columns:
        return f"each row is {', '.join(part.columns)}"
    value = getattr(spec(), path.split(".")[-1])
    return f"the default is {json.dumps(value)} {part.unit}".rstrip()


def canonical_json(experiment: Experiment) -> str:
    """The one text of an experiment, for logs, digests and ids."""
    return json.dumps(tree_of(experiment), sort_keys=True, separators=(",", ":"), allow_nan=False)


def from_json(text: str) -> Experiment:
    """The experiment that `canonical_json` wrote.

    Raises:
        ExperimentError: The text is no experiment of this version.
    """
    try:
        tree = json.loads(text)
    except (json.JSONDecodeError, RecursionError) as error:
        raise ExperimentError(f"the experiment is not valid JSON: {error}") from None
    if not isinstance(tree, dict):
        raise ExperimentError("the experiment is not a JSON object")
    return experiment_of(tree)


def toml_of(experiment: Experiment) -> str:
    """An experiment as a TOML file that teaches: every field with its unit and what it means."""
    return "\n".join(_toml(experiment, "")).strip() + "\n"


def _toml(spec: Any, here: str) -> Iterator[str]:
    tables: list[tuple[str, str, Any]] = []
    for name, part in parts(type(spec)).items():
        value = getattr(spec, name)
        if isinstance(part.family, EachOf):
            tables.append((name, part.doc, value))
        elif part.adapter is None:
            tables.append((name, part.doc, value))
        else:
            text = f"{name} = {json.dumps(value)}"
            if part.columns:
                text = "\n".join([f"{name} = [", *(f"  {json.dumps(row)}," for row in value), "]"])
            meaning = ": ".join(filter(None, [part.unit, part.doc]))
            if get_args(part.type) and all(isinstance(o, str) for o in get_args(part.type)) and name != "kind":
                meaning += f" ({' | '.join(get_args(part.type))})"
            yield f"{text:<32}  # {meaning}" if meaning else text
    for name, text, value in tables:
        yield ""
        yield f"[{here}{name}]" + (f"  # {text}" if text else "")
        if not isinstance(value, tuple):
            yield from _toml(value, f"{here}{name}.")
            continue
        present = {member.kind: member for member in value}
        family = parts(type(spec))[name].family
        assert family is not None
        yield from (f'{kind} = "off"' for kind in members(family.package) if kind not in present)
        for kind, member in present.items():
            yield ""
            yield f"[{here}{name}.{kind}]"
            yield from _toml(member, f"{here}{name}.{kind}.")
