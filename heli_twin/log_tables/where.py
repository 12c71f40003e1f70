"""A filter of rows: comparisons of a field with a value, joined by `and`."""

import re
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from operator import ge, gt, le, lt
from typing import Any, NamedTuple

from heli_twin.errors import HeliTwinError
from heli_twin.experiment.text import assignment
from heli_twin.log_tables.rows import LogRow, metric_names
from heli_twin.terminal_text import clean, instead

_COMPARISON = re.compile(r"\s*([A-Za-z_][\w.]*)\s*(<=|>=|!=|==|=|<|>)\s*(.+?)\s*", re.DOTALL)
_WITH_UNIT = re.compile(r"([-+]?[\d.]+(?:e[-+]?\d+)?)\s*(cm|mm|m|deg|rad|ms|s|g|kg)", re.IGNORECASE)
PER_UNIT = {"cm": 100.0, "mm": 1000.0, "deg": 57.29577951308232, "ms": 1000.0, "g": 1000.0}
"""How many make one of the SI unit; a division gives the number that a person would write in it."""
EXAMPLE = "'plant.mass>0.03 and rmse.position<5cm'"


class Comparison(NamedTuple):
    """`field operator value`."""

    field: str
    operator: str
    value: Any


def comparisons(text: str) -> list[Comparison]:
    """Read a filter.

    Raises:
        HeliTwinError: It is none.
    """
    found: list[Comparison] = []
    for part in re.split(r"\s+and\s+", text.strip()):
        match = _COMPARISON.fullmatch(part)
        if match is None:
            raise HeliTwinError(f"'{clean(part, 80)}' is no comparison: write where {EXAMPLE}")
        field, operator, value = match.groups()
        found.append(Comparison(field, "==" if operator == "=" else operator, _value(field, value)))
    return found


def _value(field: str, text: str) -> Any:
    """A value as an override has it; a number may have a unit."""
    found = _WITH_UNIT.fullmatch(text)
    if found is not None:
        number, unit = found[1], found[2].lower()
        # Computing times are kept in ms.
        per_unit = {"s": 1e-3}.get(unit, 1.0) if "_ms" in field else PER_UNIT.get(unit, 1.0)
        with suppress(ValueError):
            return float(number) / per_unit
    return assignment(f"{field}={text}")[1]


def value_of(row: LogRow, field: str) -> Any:
    """The value of a fact, a metric or a field of the experiment; None if the row has none."""
    if field in row.facts and field not in ("trajectory", "controller"):
        return row.facts[field]
    node: Any = row.experiment
    for key in field.split("."):
        node = node.get(key) if isinstance(node, dict) else None
    return node.get("kind") if isinstance(node, dict) else node if node is not None else row.facts.get(field)


def matching(rows: Iterable[LogRow], wanted: Sequence[Comparison]) -> list[LogRow]:
    """The rows for which every comparison holds.

    Raises:
        HeliTwinError: No row has such a field, or a value cannot be compared with it.
    """
    rows = list(rows)
    for each in wanted:
        check_field(rows, each.field)
    return [row for row in rows if all(_holds(row, each) for each in wanted)]


def check_field(rows: Sequence[LogRow], field: str) -> None:
    """Refuse a field that no row has.

    Raises:
        HeliTwinError: Suggests the right one.
    """
    if any(field in row.facts for row in rows):
        return
    readable = [row for row in rows if row.text]
    if readable and all(value_of(row, field) is None for row in readable):
        known = {name: None for row in readable for name in (*row.facts, *metric_names(), *_paths(row.experiment))}
        raise HeliTwinError(f"no log has a field {instead(field, known)}")


def _paths(tree: Any, here: str = "") -> list[str]:
    paths: list[str] = []
    for key, value in tree.items():
        paths.append(f"{here}{key}")
        if isinstance(value, dict):
            paths += _paths(value, f"{here}{key}.")
    return paths


def _holds(row: LogRow, wanted: Comparison) -> bool:
    found, value = value_of(row, wanted.field), wanted.value
    if found is None:
        return False
    if wanted.operator in ("==", "!="):
        return (found == value) == (wanted.operator == "==")
    numbers = isinstance(found, int | float) and isinstance(value, int | float)
    if not numbers and not (isinstance(found, str) and isinstance(value, str)):
        able = "a number" if isinstance(found, int | float) else "a text, with = or !="
        raise HeliTwinError(
            f"{wanted.field} is {clean(repr(found), 60)}, which {wanted.operator} cannot compare with"
            f" {clean(repr(value), 60)}: give {able}"
        )
    return _ORDER[wanted.operator](found, value)


_ORDER: dict[str, Callable[[Any, Any], bool]] = {"<": lt, "<=": le, ">": gt, ">=": ge}
