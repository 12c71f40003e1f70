"""Converts an experiment to nested tables of plain values, JSON and TOML, and back, with validation.

In a tree, `kind` says which member of its family a part is. Disturbances and faults are tables by name; the default
name is the kind.
"""

import json
import reprlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from difflib import get_close_matches
from typing import Any, get_args

from controllers.markers import EachOf, Named, by_name, checked_name
from heli_twin.experiment import Experiment
from heli_twin.experiment.families import members
from heli_twin.experiment.fields import FieldInfo, fields_of
from heli_twin.experiment.own import OWN, own_class, refuse_commands, with_program_at_hand, without_mark
from heli_twin.experiment.past import PHYSICS_VERSION, Tree, add_past, leave_out_past
from heli_twin.experiment.values import ExperimentError, check_size, checked_value, listing, plain
from heli_twin.terminal_text import clean, instead


def tree_of(experiment: Experiment) -> Tree:
    """Return an experiment as nested tables of plain values."""
    return table_of(experiment)


def table_of(spec: Any) -> Tree:
    """Return a spec as nested tables of plain values.

    Raises:
        ExperimentError: Two disturbances or faults have the same name.
    """
    table: Tree = {}
    for name, info in fields_of(type(spec)).items():
        value = getattr(spec, name)
        if isinstance(info.family, EachOf):
            table[name] = {key: _marked_table(member, info) for key, member in several(value, name).items()}
        elif not info.is_plain:
            table[name] = _marked_table(value, info)
        else:
            table[name] = plain(value)
    return table


def _marked_table(part: Any, info: FieldInfo) -> Tree:
    mark = own_class(part, info)
    return table_of(part) | ({OWN: mark} if mark else {})


def several(members: Any, path: str) -> dict[str, Any]:
    """Return the disturbances or faults of an experiment by name.

    Args:
        members: A tuple of them.
        path: Dotted path of their field, for the error message.

    Raises:
        ExperimentError: Two have the same name, or one is not a disturbance or fault.
    """
    try:
        return by_name(members)
    except (TypeError, ValueError) as error:
        raise ExperimentError(f"{path}: {error}") from None


def experiment_of(tree: Tree) -> Experiment:
    """Make a validated experiment from a tree; fields left out keep their default values.

    Raises:
        ExperimentError: Names the field, its value, the limit and the default.
    """
    return _spec(Experiment, tree, "")


def spec_of(spec: type, tree: Any) -> Any:
    """Make a validated spec of any class, such as a study, from a tree; fields left out keep their default values.

    Raises:
        ExperimentError: Names the field, its value, the limit and the default.
    """
    return _spec(spec, tree, "")


def _spec(spec: type, tree: Any, here: str) -> Any:
    if not isinstance(tree, dict):
        raise ExperimentError(f"{here[:-1]} = {reprlib.repr(tree)} is not a table")
    known = fields_of(spec)
    unknown = next((key for key in tree if key not in known), None)
    if unknown is not None:
        raise unknown_field(here + unknown, known)
    values = {}
    for name, value in tree.items():
        info, path = known[name], here + name
        if info.is_plain:
            values[name] = checked_value(info, value, path, spec)
            continue
        if not isinstance(value, dict):
            raise ExperimentError(f"{path} = {reprlib.repr(value)} is not a table")
        value = without_mark(value, path, info.family.package if info.family else None)
        if info.family is None:
            values[name] = _spec(info.type, value, f"{path}.")
            continue
        package = info.family.package
        kinds = members(package)
        if isinstance(info.family, EachOf):
            values[name] = tuple(_each(package, key, table, f"{path}.{key}") for key, table in sorted(value.items()))
        else:
            values[name] = _spec(kinds[_known(value.get("kind"), kinds, name)], value, f"{path}.")
    try:
        return spec(**values)
    except ValueError as error:
        raise ExperimentError(f"{here}{error}") from None


def unknown_field(path: str, known: Iterable[str], elsewhere: Sequence[str] = ()) -> ExperimentError:
    """Make the error for a path that names no field.

    Args:
        path: Dotted path.
        known: Names of the fields in its table.
        elsewhere: Dotted paths of fields of this name in other tables.
    """
    table, _, name = path.rpartition(".")
    here = f"{table}." if table else ""
    near = [here + k for k in get_close_matches(clean(name, 80), known, n=1, cutoff=0.5)]
    hint = f"did you mean '{[*elsewhere, *near][0]}'? " if near or elsewhere else ""
    return ExperimentError(f"unknown field '{clean(path, 100)}': {hint}{listing(known)}")


def _each(package: str, name: str, table: Any, path: str) -> Any:
    """Make one of several members; it is `Named` unless its name is its kind."""
    if not isinstance(table, dict):
        raise ExperimentError(f"{path} = {reprlib.repr(table)} is not a table")
    table, kinds = without_mark(table, path, package), members(package)
    kind = kind_under(name, table.get("kind", name), kinds, path)
    member = _spec(kinds[kind], table, f"{path}.")
    return member if name == kind else Named(name, member)


def kind_under(name: str, kind: Any, kinds: Mapping[str, type], path: str) -> str:
    """Return the kind of a disturbance or fault, after a check that it may have its name.

    Args:
        name: Its name. The name of a kind is reserved for the members of that kind.
        kind: Its kind.
        kinds: The classes of its family by kind.
        path: Dotted path of the member, for the error message.

    Raises:
        ExperimentError: There is no such kind, or the name is not valid or reserved for another kind.
    """
    table = path.rpartition(".")[0]
    kind = _known(kind, kinds, table)
    if name == kind:
        return kind
    if name in kinds:
        raise ExperimentError(
            f"{path}: the name {name} is for the kind {name}: give the {kind} another, such as"
            f" {table}.{kind}_2 = '{kind}'"
        )
    try:
        checked_name(name)
    except ValueError as error:
        raise ExperimentError(f"{table}: {error}") from None
    return kind


def _known(kind: Any, kinds: Mapping[str, type], family: str) -> str:
    if not isinstance(kind, str) or kind not in kinds:
        raise ExperimentError(f"unknown {clean(family, 80)} {instead(kind, kinds)}")
    return kind


def canonical_json(experiment: Experiment) -> str:
    """Return the unique JSON text of an experiment; new fields with their past values are left out."""
    tree = tree_of(experiment)
    leave_out_past(Experiment, tree)
    return json.dumps(tree, sort_keys=True, separators=(",", ":"), allow_nan=False)


def parsed(text: str) -> Tree:
    """Parse canonical JSON of this version or an older one to a tree; its values are not validated.

    Raises:
        ExperimentError: The text is not a JSON object.
    """
    try:
        tree = json.loads(text)
        check_size(tree)
    except (ValueError, RecursionError) as error:
        raise ExperimentError(f"the experiment is not valid JSON: {error}") from None
    if not isinstance(tree, dict):
        raise ExperimentError("the experiment is not a JSON object")
    refuse_commands(tree)
    add_past(Experiment, tree)
    return tree


def from_json(text: str) -> Experiment:
    """Return the experiment that `canonical_json` of this version or an older one wrote.

    A program that is not here is the one that `--with` supplied, if it supplied one.

    Raises:
        ExperimentError: The text is not an experiment that this version can read.
    """
    return with_program_at_hand(experiment_of(parsed(text)))


def toml_of(experiment: Experiment) -> str:
    """Return an experiment as the text of a TOML file: every field with its unit and meaning."""
    return "\n".join([physics_line(), *toml_lines(experiment, "")]).strip() + "\n"


def physics_line() -> str:
    """Return the line with today's physics version, for a TOML file with an experiment or a part of one."""
    return f"{f'physics = {PHYSICS_VERSION}':<32}  # physics version; missing fields get their values of this version"


def toml_lines(spec: Any, here: str) -> Iterator[str]:
    """Yield the lines of a TOML file that say a spec.

    Args:
        spec: The spec.
        here: Dotted path of its table, with a dot at its end; empty for the whole file.
    """
    tables: list[tuple[str, FieldInfo, Any]] = []
    for name, info in fields_of(type(spec)).items():
        value = getattr(spec, name)
        if not info.is_plain:
            tables.append((name, info, value))
        else:
            value = plain(value)
            text = f"{name} = {toml_text(value) if isinstance(value, str) else json.dumps(value)}"
            if info.columns:
                text = "\n".join([f"{name} = [", *(f"  {json.dumps(row)}," for row in value), "]"])
            meaning = ": ".join(filter(None, [info.unit, info.doc]))
            if get_args(info.type) and all(isinstance(o, str) for o in get_args(info.type)) and name != "kind":
                meaning += f" ({' | '.join(get_args(info.type))})"
            yield f"{text:<32}  # {meaning}" if meaning else text
    for name, info, value in tables:
        yield ""
        yield f"[{here}{name}]" + (f"  # {info.doc}" if info.doc else "")
        if not isinstance(info.family, EachOf):
            yield from _toml_of_part(value, info, f"{here}{name}")
            continue
        present = several(value, f"{here}{name}")
        yield from (f'{kind} = "off"' for kind in members(info.family.package) if kind not in present)
        for key, member in present.items():
            yield ""
            yield f"[{here}{name}.{key}]"
            yield from _toml_of_part(member, info, f"{here}{name}.{key}")


def toml_text(text: str) -> str:
    """A text as TOML writes it, over several lines where it has them; what is not printable is escaped."""
    if "\n" not in text:
        return json.dumps(text)
    escaped = text.replace("\\", "\\\\").replace('"""', '""\\"')
    return '"""\n' + "".join(c if c.isprintable() or c == "\n" else f"\\U{ord(c):08x}" for c in escaped) + '"""'


def _toml_of_part(part: Any, info: FieldInfo, path: str) -> Iterator[str]:
    if mark := own_class(part, info):
        yield f"{OWN} = {json.dumps(mark)}  # a class of the user's own: this file does not describe it"
    yield from toml_lines(part, f"{path}.")
