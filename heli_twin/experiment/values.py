"""Validation of single values of an experiment: numbers, texts and lists of them, against the bounds of their field."""

import json
import math
import reprlib
from collections.abc import Iterable, Iterator
from dataclasses import MISSING, fields
from functools import cache
from typing import Any, get_args

import numpy as np
from pydantic import ValidationError

from heli_twin.errors import HeliTwinError
from heli_twin.experiment.fields import FieldInfo, is_ours
from heli_twin.terminal_text import clean, instead


class ExperimentError(HeliTwinError):
    """An experiment that cannot be flown: a value is wrong, or values do not fit together."""


def listing(known: Iterable[str]) -> str:
    """Return `Available: ...` cut to a readable length."""
    return f"Available: {clean(', '.join(known), 260)}"


def check_size(value: Any) -> None:
    """Refuse nested tables and lists that no experiment needs.

    Raises:
        ValueError: They are nested deeper than `DEEPEST`, or an integer has more than 64 bits.
    """
    level = [value]
    for _ in range(DEEPEST):
        if any(type(inner) is int and abs(inner) >= 2**63 for inner in level):
            raise ValueError("an integer has more than 64 bits")
        level = [x for v in level if isinstance(v, dict | list) for x in (v.values() if isinstance(v, dict) else v)]
        if not level:
            return
    raise ValueError(f"it is nested deeper than {DEEPEST} levels")


LARGEST = 1e12
"""Largest size of a number of an experiment, in its unit: squares and products of such numbers are finite."""
SMALLEST = 1e-30
"""Smallest size of a number of an experiment that is not 0, in its unit: its inverse is finite."""
DEEPEST = 40
"""Largest number of levels of tables and lists; an experiment has about eight."""


def plain(value: Any) -> Any:
    """Return a value with lists in place of tuples and arrays, and Python's numbers in place of NumPy's."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return [plain(inner) for inner in value] if isinstance(value, list | tuple) else value


def checked_value(info: FieldInfo, value: Any, path: str, spec: type) -> Any:
    """Return a value, converted to the type of its field and checked against the field's bounds.

    Args:
        info: The field.
        value: Numbers, texts, and lists of them.
        path: Dotted path of the field, for the error message.
        spec: The class that has the field.

    Raises:
        ExperimentError: Names the field, its value, the limit and the default.
    """
    if _is_default(value, path.rpartition(".")[2], spec):
        return value
    if any(type(v) is int and abs(v) >= 2**63 for v in _leaves_of(value)):
        raise ExperimentError(f"{path} has an integer of more than 64 bits; {_default(info, spec, path)}")
    if any(isinstance(v, float) and not math.isfinite(v) for v in _leaves_of(value)):
        raise ExperimentError(f"{path} = {reprlib.repr(value)} is not a finite number; {_default(info, spec, path)}")
    try:
        adapter = info.adapter
        assert adapter is not None
        checked = adapter.validate_json(json.dumps(value, default=str), strict=True)
    except ValidationError as errors:
        error = errors.errors()[0]
        where = path + "".join(f"[{i}]" for i in error["loc"] if isinstance(i, int))
        message = error["msg"][:1].lower() + error["msg"][1:]
        if error["type"] == "literal_error":
            options = [str(option) for option in get_args(info.type)]
            raise ExperimentError(f"{path} = {instead(value, options)}") from None
        unit = f" {info.unit}" if info.unit and "ctx" in error else ""
        message = message.replace("input should be", "it must be") + unit
        raise ExperimentError(
            f"{where} = {reprlib.repr(error['input'])}: {message}; {_default(info, spec, path)}"
        ) from None
    sizes = [abs(v) for v in _leaves_of(value) if isinstance(v, float | int) and info.type is not int]
    if any(size > LARGEST or 0 < size < SMALLEST for size in sizes):
        limit = f"at most {LARGEST:g}" if max(sizes) > LARGEST else f"0 or at least {SMALLEST:g} in size"
        raise ExperimentError(f"{path} = {reprlib.repr(value)}: it must be {limit}; {_default(info, spec, path)}")
    return checked


def _is_default(value: Any, name: str, spec: type) -> bool:
    """Return whether a value is what a class of ours has as its default: there is nothing to check."""
    default = _defaults(spec).get(name, MISSING)
    return type(value) is type(default) and value == default


@cache
def _defaults(spec: type) -> dict[str, Any]:
    """The numbers and texts among the defaults of a class of ours; none of a class of a user's own."""
    defaults = {f.name: f.default for f in fields(spec)} if is_ours(spec) else {}
    return {name: default for name, default in defaults.items() if type(default) in (bool, int, float, str)}


def _leaves_of(value: Any) -> Iterator[Any]:
    if isinstance(value, list):
        for inner in value:
            yield from _leaves_of(inner)
    else:
        yield value


def _default(info: FieldInfo, spec: type, path: str) -> str:
    if info.columns:
        return f"each row is {', '.join(info.columns)}"
    field = next(f for f in fields(spec) if f.name == path.rpartition(".")[2])
    value = field.default if field.default_factory is MISSING else field.default_factory()
    return (
        "it has no default" if value is MISSING else f"the default is {json.dumps(plain(value))} {info.unit}".rstrip()
    )
