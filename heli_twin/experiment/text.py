"""Reads an experiment from a preset or a TOML file and applies overrides, `path.to.field=value`.

`part = "kind"` is short for a table with that `kind`: the member of the family, with its default values. There can be
several disturbances and faults: `"on"` adds the one of that kind with its default values, `"off"` removes it, and
`disturbances.second = "gust"` adds another gust under the name `second`.
"""

import csv
import re
import reprlib
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import is_dataclass
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

from controllers.detailed_model import DetailedModel
from controllers.markers import EachOf, FileContent, OneOf
from controllers.programs import beside
from heli_twin.experiment import Experiment
from heli_twin.experiment.families import is_reference, members, own_member_in
from heli_twin.experiment.fields import FieldInfo, fields_of
from heli_twin.experiment.own import OWN, require_own, with_commands, without_mark
from heli_twin.experiment.past import PHYSICS_VERSION, Tree, restore_past
from heli_twin.experiment.tree import experiment_of, kind_under, table_of, tree_of, unknown_field
from heli_twin.experiment.values import DEEPEST, ExperimentError, check_size, listing
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


def load(source: str | None = None, overrides: Iterable[str] = ()) -> Experiment:
    """Read an experiment from a preset or a TOML file and change it.

    Args:
        source: Name of a preset or path of a TOML file; None for `lab`.
        overrides: Changes, each `path.to.field=value`; changes of a `kind` are applied before the others.

    Returns:
        The experiment. Fields that the file leaves out have their default values; if the file names an older physics
        version, they have the values of that version.

    Raises:
        ExperimentError: The source or an override is wrong; the message names the nearest valid choice.
    """
    tree = tree_of(Experiment())
    file = _read(source or "lab")
    leaves = dict(leaves_of(file.tree))
    for path, value in leaves.items():
        if not (file.is_calibration and _is_of_another_law(tree, path)):
            put(tree, path, value)
    restore_past(Experiment, tree, file.version, leaves)
    is_own = source is not None and source not in presets()
    return _changed(tree, overrides, {path: v for path, v in leaves.items() if is_own and path.startswith(_BELIEFS)})


def changed(experiment: Experiment, overrides: Iterable[str]) -> Experiment:
    """Return an experiment with some fields changed.

    Args:
        experiment: It stays as it is.
        overrides: Changes, each `path.to.field=value`; changes of a `kind` are applied before the others.

    Raises:
        ExperimentError: An override is wrong; the message names the nearest valid choice.
    """
    return _changed(tree_of(experiment), overrides)


_BELIEFS = ("controller.model.", "estimator.command_delay", "estimator.gust_time")
"""Begins of the paths of what a file may say of the helicopter as any law or estimator believes it."""


def _is_of_another_law(tree: Tree, path: str) -> bool:
    """Return whether a path is of a belief that the law or estimator of a tree has no place for, but others have.

    A calibration says what any law may believe of its helicopter, and each takes what its model has.
    """
    *tables, name = path.split(".")
    known: dict[tuple[str, ...], Iterable[str]] = {
        ("controller", "model"): fields_of(DetailedModel),
        ("estimator",): ("command_delay", "gust_time"),
    }
    here: Any = tree
    for table in tables:
        here = here.get(table, {}) if isinstance(here, dict) else {}
    return name in known.get(tuple(tables), ()) and name not in here


def _changed(tree: Tree, overrides: Iterable[str], believed: Mapping[str, Any] | None = None) -> Experiment:
    """Apply overrides; a law or an estimator that is selected by its kind alone believes what is `believed`."""
    for path, value in sorted(map(override_of, overrides), key=lambda change: not names_a_kind(*change)):
        put_part(tree, path, value)
        part = path.removesuffix(".kind")
        if not isinstance(value, str) or part not in ("controller", "estimator"):
            continue
        for belief, its in (believed or {}).items():
            if belief.startswith(f"{part}.") and not _is_of_another_law(tree, belief):
                put(tree, belief, its)
    return experiment_of(tree)


def names_a_kind(path: str, value: Any) -> bool:
    """Return whether a change selects the member of a family at its path."""
    is_member = isinstance(value, str | dict) and value not in ("on", "off") and bool(family_at(path))
    return path.endswith(".kind") or is_member or (_is_content(value) and _content_field(Experiment, path) is not None)


def with_content(path: str, value: Any, folder: Path) -> Any:
    """Return a value with the content of each file that it names, where a field holds the content of a file.

    So an experiment is complete before it is flown, and a path in a log or a store is followed by nobody.

    Args:
        path: Dotted path of a field or a table; empty for a whole experiment.
        value: The value, a table, or a list of values, as for an axis of a study.
        folder: Where the files are.

    Raises:
        ExperimentError: A file cannot be read, or its content is refused.
    """
    if isinstance(value, dict):
        return {key: with_content(f"{path}.{key}".lstrip("."), inner, folder) for key, inner in value.items()}
    if isinstance(value, list):
        return [with_content(path, inner, folder) for inner in value]
    if not isinstance(value, str) or not _CONTENT_FILE.fullmatch(value):
        return value
    field = _content_field(Experiment, path)
    return value if field is None else _content(folder / value, field, path)


def with_members(path: str, value: Any, folder: Path) -> Any:
    """Return a value with the kind of each class of a user's own that it names by a file or an import path.

    The classes are loaded here, where the user names them, and nowhere else: code that a log or a store names is
    loaded by nobody.

    Args:
        path: Dotted path of a field or a table; empty for a whole experiment.
        value: The value, a table, or a list of values, as for an axis of a study.
        folder: Where the files are.

    Raises:
        FamilyError: A class cannot be loaded, or its kind belongs to another member.
    """
    if isinstance(value, dict):
        return {key: with_members(f"{path}.{key}".lstrip("."), inner, folder) for key, inner in value.items()}
    if isinstance(value, list):
        return [with_members(path, inner, folder) for inner in value]
    if not isinstance(value, str) or not is_reference(value) or not (family := _family_at(Experiment, path)):
        return value
    return own_member_in(folder, family, value)


def _family_at(spec: type, path: str) -> str | None:
    """Return the family of the member at a path, for any kinds of the members above it; None if there is none."""
    key, _, rest = path.partition(".")
    info = fields_of(spec).get(key)
    if info is None or info.is_plain:
        return None
    if info.family is None:
        return _family_at(info.type, rest)
    if isinstance(info.family, EachOf):
        name, _, rest = rest.partition(".")
        if not name:
            return None
    if rest in ("", "kind"):
        return info.family.package
    found = (_family_at(kind, rest) for kind in members(info.family.package).values())
    return next(filter(None, found), None)


_CONTENT_FILE = re.compile(r"[^<>\n]+\.xml")


def _is_content(value: Any) -> bool:
    return isinstance(value, str) and value.lstrip().startswith("<")


def _content_field(spec: type, path: str) -> FileContent | None:
    """Return the mark of the field that a path leads to for some kinds of the members above it, if it has one."""
    key, _, rest = path.partition(".")
    info = fields_of(spec).get(key)
    if info is None or info.is_plain:
        return info.content if info and not rest else None
    if info.family is None:
        return _content_field(info.type, rest)
    if isinstance(info.family, EachOf):
        _, _, rest = rest.partition(".")
    found = (_content_field(kind, rest) for kind in members(info.family.package).values())
    return next(filter(None, found), None)


def family_at(path: str, spec: type = Experiment) -> str:
    """Return the family's package of the member at a dotted path, for any kinds of the members above it.

    Args:
        path: Dotted path.
        spec: Class of the table in which it begins.

    Returns:
        The package; empty if no member stands there.
    """
    key, _, rest = path.partition(".")
    info = fields_of(spec).get(key)
    if info is None or info.is_plain:
        return ""
    if info.family is None:
        return family_at(rest, info.type)
    if isinstance(info.family, EachOf):
        _, is_deeper, rest = rest.partition(".")
    else:
        is_deeper = rest
    package = info.family.package
    if not is_deeper:
        return package
    return next(filter(None, (family_at(rest, kind) for kind in members(package).values())), "")


class _File(NamedTuple):
    """A preset or a TOML file."""

    tree: Tree
    """Its tables, without those of `NOT_FLOWN`."""
    version: int
    """Physics version that they were written for."""
    is_calibration: bool
    """True if it says what flights have covered."""


NOT_FLOWN = ("envelope", "noise")
"""Tables of a calibration that say no field of an experiment."""


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


def _read(source: str) -> _File:
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
    return _File(with_commands(tree, partial(beside, path.parent)), version, is_calibration)


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
        tree = _toml(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ExperimentError(f"cannot read {clean(path, 200)}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise ExperimentError(f"cannot read {clean(path, 200)}: it is not UTF-8 text") from None
    except _NOT_TOML as error:
        # Python's own sentence about integers of more than 4300 digits is for programmers.
        reason = "an integer has too many digits" if "set_int_max_str_digits" in str(error) else clean(error, 200)
        raise ExperimentError(f"{clean(path, 200)} is not valid TOML: {reason}") from None
    return path, tree


_NOT_TOML = (ValueError, RecursionError)
"""Errors of the TOML parser: its own, and those of Python for a number of 5000 digits or a thousand brackets."""


def _toml(text: str) -> Tree:
    tree = tomllib.loads(text)
    check_size(tree)
    return tree


def leaves_of(tree: Tree, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield every value of a tree with its dotted path; what selects the kind comes first, as it resets the others."""
    for key, value in sorted(
        tree.items(), key=lambda item: (item[0] != OWN, item[0] != "kind", not _is_content(item[1]))
    ):
        if isinstance(value, dict) and value:
            yield from leaves_of(value, f"{path}{key}.")
        elif not isinstance(value, dict):
            yield f"{path}{key}", value


def assignment(text: str, example: str = "path.to.field=value, such as plant.mass=0.03") -> tuple[str, Any]:
    """Parse an override, `path.to.field=value`.

    Args:
        text: The override.
        example: A valid override, for the error message.

    Returns:
        The dotted path, and the value: read as TOML, or the text itself if it is not valid TOML, so that names need no
        quotes.

    Raises:
        ExperimentError: There is no `=`, there is nothing before it, or the path has too many levels.
    """
    path, equals, value = (word.strip() for word in text.partition("="))
    if not equals or not path:
        raise ExperimentError(f"'{clean(text, 80)}' is not an override: write {example}")
    if path.count(".") >= DEEPEST:
        raise ExperimentError(f"'{clean(path, 80)}' is nested deeper than {DEEPEST} levels")
    try:
        return path, _toml(f"v = {value}")["v"]
    except _NOT_TOML:
        return path, value


def override_of(text: str) -> tuple[str, Any]:
    """Parse an override, also `part=FILE.toml`; return its path and its value."""
    path, value = assignment(text)
    value = with_content(path, with_members(path, value, Path()), Path())
    return path, part_in(value, path) if isinstance(value, str) and value.endswith(".toml") else value


def part_in(file: str, path: str) -> Tree:
    """Return the table at a dotted path in a TOML file; `physics` in it is the version of an older file.

    Raises:
        ExperimentError: The file cannot be read, or has no such table.
    """
    tree, version, _ = _read(file)
    table: Any = tree
    for key in path.split("."):
        table = table.get(key) if isinstance(table, dict) else None
    if not isinstance(table, dict):
        raise ExperimentError(f"{clean(file, 200)} has no table [{clean(path, 80)}]")
    return table | {"physics": version} if version < PHYSICS_VERSION else table


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


def _read_value(value: Any, info: FieldInfo, path: str) -> Any:
    """The value that a text is short for: a CSV file for its rows, a text for a list with this text."""
    if isinstance(value, str) and info.columns:
        return _rows(value, info.columns, path)
    return [value] if isinstance(value, str) and info.type == tuple[str, ...] else value


def _kind_by_content(kinds: Mapping[str, type], now: str, rest: list[str], value: Any) -> str | None:
    """Return the kind with a field for such a content, if that of now has none: the content selects the member."""
    if not _is_content(value) or len(rest) != 1:
        return None
    takers = [kind for kind, spec in kinds.items() if (info := fields_of(spec).get(rest[0])) and info.content]
    return takers[0] if takers and now not in takers else None


def _content(file: Path, field: FileContent, path: str) -> str:
    try:
        return field.read(file)
    except OSError as error:
        reason = "there is no such file" if isinstance(error, FileNotFoundError) else error.strerror
        raise ExperimentError(
            f"{path}: cannot read {clean(error.filename or file.absolute(), 200)}: {reason}"
        ) from None
    except ValueError as error:
        raise ExperimentError(f"{path}: {error}") from None


def _rows(file: str, columns: tuple[str, ...], path: str) -> list[list[float]]:
    """Read a CSV file: its rows become part of the experiment, so that a log can be flown without the file."""
    line = 1
    if not Path(file).is_file():
        raise ExperimentError(f"{path}: cannot read {clean(Path(file).absolute(), 200)}: there is no such file")
    try:
        with Path(file).open(encoding="utf-8-sig", newline="") as text:
            table = csv.DictReader(text, skipinitialspace=True, strict=True)
            missing = [column for column in columns if column not in (table.fieldnames or ())]
            if missing:
                raise ExperimentError(
                    f"{path}: {clean(file, 200)} has no column {missing[0]}; its first line has to name"
                    f" {', '.join(columns)}"
                )
            rows: list[list[float]] = []
            for row in table:
                line = table.line_num
                rows.append([float(row[column] or "") for column in columns])
    except OSError as error:
        raise ExperimentError(f"{path}: cannot read {clean(Path(file).absolute(), 200)}: {error.strerror}") from None
    except (ValueError, csv.Error) as error:
        raise ExperimentError(
            f"{path}: {clean(file, 200)}, line {line} is not a row of numbers: {clean(error, 100)}"
        ) from None
    return rows


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
