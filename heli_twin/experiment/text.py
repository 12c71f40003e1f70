"""The edge where text becomes an experiment: presets, TOML files and dotted overrides.

`part = "kind"` is short for that member of a family with its defaults; of disturbances and faults, `"off"` leaves one
out and `"on"` adds one with its defaults.
"""

import csv
import tomllib
from collections.abc import Iterable, Iterator
from dataclasses import is_dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

from heli_twin.experiment import Experiment
from heli_twin.experiment.families import EachOf, OneOf, members
from heli_twin.experiment.tree import ExperimentError, Tree, experiment_of, instead, parts, table_of, tree_of


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
        raise ExperimentError(f"unknown preset {instead(source, known)}; a file of your own ends in .toml")
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
            f"unknown field {instead('.'.join([*table, key]), ['.'.join([*table, k]) for k in known])}"
        )
    part = known[key]
    match part.family:
        case EachOf():
            _put_each(node[key], part.family, rest, value, path)
        case OneOf():
            kinds = members(part.family.package)
            if rest == ["kind"] or (not rest and isinstance(value, str)):
                if not isinstance(value, str) or value not in kinds:
                    raise ExperimentError(f"unknown {key} {instead(value, kinds)}")
                if node[key]["kind"] != value:
                    node[key] = table_of(kinds[value]())
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
        raise ExperimentError(f"unknown {path.split('.')[0]} {instead(kind, kinds)}")
    if rest:
        node.setdefault(kind, table_of(kinds[kind]()))
        _put(node[kind], kinds[kind], rest, value, path)
    elif value == "off":
        node.pop(kind, None)
    elif value == "on":
        node.setdefault(kind, table_of(kinds[kind]()))
    else:
        raise ExperimentError(
            f"{path} = {value!r}: write on, off, or one of its fields: {', '.join(parts(kinds[kind]))}"
        )
