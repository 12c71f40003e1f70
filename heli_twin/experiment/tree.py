"""Specs as trees of plain values and back: what an experiment looks like as JSON and TOML, and what is refused.

As a tree, an experiment is nested tables. A part's `kind` says which member of its family it is; disturbances and
faults are tables by their name, which is their kind where nothing else is said.
"""

import json
import math
import reprlib
from collections.abc import Iterable, Iterator
from difflib import get_close_matches
from typing import Any, get_args

from pydantic import ValidationError

from controllers.markers import EachOf, Named, by_name, checked_name
from heli_twin.errors import HeliTwinError
from heli_twin.experiment import Experiment
from heli_twin.experiment.families import members
from heli_twin.experiment.fields import FieldInfo, fields_of
from heli_twin.experiment.past import PHYSICS_VERSION, Tree, add_past, leave_out_past


class ExperimentError(HeliTwinError):
    """An experiment that cannot be flown as it was written."""


def instead(wrong: Any, known: Iterable[str]) -> str:
    """`'wrong': did you mean 'right'? Available: ...`."""
    known = list(known)
    near = get_close_matches(str(wrong), known, n=1, cutoff=0.5)
    return f"'{wrong}': " + (f"did you mean '{near[0]}'? " if near else "") + f"Available: {', '.join(known)}"


def tree_of(experiment: Experiment) -> Tree:
    """An experiment as nested tables of plain values."""
    return table_of(experiment)


def table_of(spec: Any) -> Tree:
    """A spec as nested tables of plain values.

    Raises:
        ExperimentError: Two disturbances or faults have the same name.
    """
    table: Tree = {}
    for name, info in fields_of(type(spec)).items():
        value = getattr(spec, name)
        if isinstance(info.family, EachOf):
            table[name] = {key: table_of(member) for key, member in _several(value, name).items()}
        elif info.adapter is None:
            table[name] = table_of(value)
        else:
            table[name] = _listed(value)
    return table


def _several(members: Any, path: str) -> dict[str, Any]:
    try:
        return by_name(members)
    except (TypeError, ValueError) as error:
        raise ExperimentError(f"{path}: {error}") from None


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
    known = fields_of(spec)
    unknown = next((key for key in tree if key not in known), None)
    if unknown is not None:
        raise ExperimentError(f"unknown field {instead(here + unknown, [here + k for k in known])}")
    values = {}
    for name, value in tree.items():
        info, path = known[name], here + name
        if info.adapter is not None:
            values[name] = _value(info, value, path, spec)
            continue
        if not isinstance(value, dict):
            raise ExperimentError(f"{path} = {value!r} is not a table")
        if info.family is None:
            values[name] = _spec(info.type, value, f"{path}.")
            continue
        kinds = members(info.family.package)
        if isinstance(info.family, EachOf):
            values[name] = tuple(_each(kinds, key, table, f"{path}.{key}") for key, table in sorted(value.items()))
        else:
            values[name] = _spec(kinds[_known(value.get("kind"), kinds, name)], value, f"{path}.")
    try:
        return spec(**values)
    except ValueError as error:
        raise ExperimentError(f"{here}{error}") from None


def _each(kinds: dict[str, type], name: str, table: Any, path: str) -> Any:
    """One of several members; it is `Named` unless its name is its kind."""
    if not isinstance(table, dict):
        raise ExperimentError(f"{path} = {reprlib.repr(table)} is not a table")
    kind = kind_under(name, table.get("kind", name), kinds, path)
    member = _spec(kinds[kind], table, f"{path}.")
    return member if name == kind else Named(name, member)


def kind_under(name: str, kind: Any, kinds: dict[str, type], path: str) -> str:
    """The kind of a disturbance or fault under a name: any, but the name of a kind is for a member of that kind.

    Raises:
        ExperimentError: There is no such kind, or the name is not one or means another kind.
    """
    table = path.rpartition(".")[0]
    kind = _known(kind, kinds, table)
    if name == kind:
        return kind
    if name in kinds:
        raise ExperimentError(
            f"{path} is where a {name} stands: give the {kind} another name, such as {table}.{kind}_2 = '{kind}'"
        )
    try:
        checked_name(name)
    except ValueError as error:
        raise ExperimentError(f"{table}: {error}") from None
    return kind


def _known(kind: Any, kinds: dict[str, type], family: str) -> str:
    if not isinstance(kind, str) or kind not in kinds:
        raise ExperimentError(f"unknown {family} {instead(kind, kinds)}")
    return kind


def _value(info: FieldInfo, value: Any, path: str, spec: type) -> Any:
    assert info.adapter is not None
    if any(isinstance(v, float) and not math.isfinite(v) for v in _leaves_of(value)):
        raise ExperimentError(f"{path} = {reprlib.repr(value)} is not a finite number; {_default(info, spec, path)}")
    try:
        return info.adapter.validate_json(json.dumps(value, default=str), strict=True)
    except ValidationError as errors:
        error = errors.errors()[0]
        where = path + "".join(f"[{i}]" for i in error["loc"])
        message = error["msg"][:1].lower() + error["msg"][1:]
        if error["type"] == "literal_error":
            options = [str(option) for option in get_args(info.type)]
            raise ExperimentError(f"{path} = {instead(value, options)}") from None
        unit = f" {info.unit}" if info.unit and "ctx" in error else ""
        message = message.replace("input should be", "it must be") + unit
        raise ExperimentError(
            f"{where} = {reprlib.repr(error['input'])}: {message}; {_default(info, spec, path)}"
        ) from None


def _leaves_of(value: Any) -> Iterator[Any]:
    if isinstance(value, list):
        for inner in value:
            yield from _leaves_of(inner)
    else:
        yield value


def _default(info: FieldInfo, spec: type, path: str) -> str:
    if info.columns:
        return f"each row is {', '.join(info.columns)}"
    value = getattr(spec(), path.split(".")[-1])
    return f"the default is {json.dumps(value)} {info.unit}".rstrip()


def canonical_json(experiment: Experiment) -> str:
    """The one text of an experiment, for logs, digests and ids; new fields that have their past value are left out."""
    tree = tree_of(experiment)
    leave_out_past(Experiment, tree)
    return json.dumps(tree, sort_keys=True, separators=(",", ":"), allow_nan=False)


def parsed(text: str) -> Tree:
    """The whole tree of canonical JSON, also of an older version; its values are not validated.

    Raises:
        ExperimentError: The text is not a JSON object.
    """
    try:
        tree = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ExperimentError(f"the experiment is not valid JSON: {error}") from None
    if not isinstance(tree, dict):
        raise ExperimentError("the experiment is not a JSON object")
    add_past(Experiment, tree)
    return tree


def from_json(text: str) -> Experiment:
    """The experiment that `canonical_json` wrote, in this version or in an older one.

    Raises:
        ExperimentError: The text is not an experiment that this version knows.
    """
    return experiment_of(parsed(text))


def toml_of(experiment: Experiment) -> str:
    """An experiment as a TOML file that teaches: every field with its unit and what it means."""
    version = f"{f'physics = {PHYSICS_VERSION}':<32}  # version: fields that come later get what describes it"
    return "\n".join([version, *_toml(experiment, "")]).strip() + "\n"


def _toml(spec: Any, here: str) -> Iterator[str]:
    tables: list[tuple[str, str, Any]] = []
    for name, info in fields_of(type(spec)).items():
        value = getattr(spec, name)
        if info.adapter is None:
            tables.append((name, info.doc, value))
        else:
            text = f"{name} = {json.dumps(value)}"
            if info.columns:
                text = "\n".join([f"{name} = [", *(f"  {json.dumps(row)}," for row in value), "]"])
            meaning = ": ".join(filter(None, [info.unit, info.doc]))
            if get_args(info.type) and all(isinstance(o, str) for o in get_args(info.type)) and name != "kind":
                meaning += f" ({' | '.join(get_args(info.type))})"
            yield f"{text:<32}  # {meaning}" if meaning else text
    for name, text, value in tables:
        yield ""
        yield f"[{here}{name}]" + (f"  # {text}" if text else "")
        if not isinstance(value, tuple):
            yield from _toml(value, f"{here}{name}.")
            continue
        present = _several(value, f"{here}{name}")
        family = fields_of(type(spec))[name].family
        assert family is not None
        yield from (f'{kind} = "off"' for kind in members(family.package) if kind not in present)
        for key, member in present.items():
            yield ""
            yield f"[{here}{name}.{key}]"
            yield from _toml(member, f"{here}{name}.{key}.")
