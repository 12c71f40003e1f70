"""Any table of cells: CSV, TSV or columns between blanks, with comments, several header lines and a row of units.

Its columns are found by their names, or by their numbers from 1 on; the first row of numbers begins the data.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import NamedTuple

import numpy as np

from controllers.signals import Array
from heli_twin.exchange.formats import ImportRefused, Options, Take
from heli_twin.exchange.formats.cells import is_comment, numbers, rows_of
from heli_twin.exchange.frames import LENGTH_UNITS_M
from heli_twin.recording.log import Times

TITLE = "table of columns"
POSITION, QUATERNION, COMMANDS = ("x", "y", "z"), ("qw", "qx", "qy", "qz"), ("ux", "uy", "uz", "uyaw")
FIELDS = ("time", "arrival", *POSITION, *QUATERNION, "yaw", *COMMANDS)
"""The fields of a table: s, m, unit quaternion body to world, rad, fraction of full stick."""
MAX_HEADER_ROWS = 60


class Source(NamedTuple):
    """The column or the constant of a field."""

    column: str = ""
    """Name, or number from 1 on; empty for a constant."""
    factor: float = 1.0
    """From the file's unit to ours; the value of a constant."""


def parse_map(text: str) -> dict[str, Source]:
    """Which column is which field.

    Args:
        text: `field=column`, `field=column*factor`, or `field=value` for a constant (0, or with a decimal point),
            separated by commas: `time=t,x=px*0.001,yaw=heading,ux=0`.

    Raises:
        ImportRefused: The text is not of this form.
    """
    sources: dict[str, Source] = {}
    for part in filter(None, (part.strip() for part in text.split(","))):
        field, equals, column = part.partition("=")
        if field not in FIELDS or not equals or not column:
            raise ImportRefused(f"'{part}' maps no column: write field=column, the fields are {', '.join(FIELDS)}")
        if field in sources:
            raise ImportRefused(f"'{part}': {field} is column '{sources[field].column}' already, name it once")
        sources[field] = _source(part, column)
    return sources


def _source(part: str, column: str) -> Source:
    name, star, factor = column.rpartition("*")
    if not star and not (column.isdecimal() and int(column)):
        try:
            constant = float(column)
        except ValueError:
            return Source(column)
        if not math.isfinite(constant):
            raise ImportRefused(f"'{part}': {column} is not a finite number")
        return Source(factor=constant)
    try:
        source = Source(name, float(factor)) if star else Source(column)
    except ValueError:
        raise ImportRefused(f"'{part}': '{factor}' is not a number to multiply '{name}' by") from None
    if not math.isfinite(source.factor) or source.factor == 0.0:
        raise ImportRefused(f"'{part}': multiply '{source.column}' by a number that is finite and not 0")
    return source


def recognises(head: list[str]) -> bool:
    """Any text may be a table."""
    return bool(head) and not any("\N{REPLACEMENT CHARACTER}" in line for line in head)


class _Header(NamedTuple):
    rows: list[list[str]]
    first: list[str]
    """The first row of numbers; empty where there is none."""
    lines: int


def read(path: Path, options: Options) -> Take:
    """Read a table.

    Raises:
        ImportRefused: A column is missing or named twice, or a cell is not a number.
    """
    sources = parse_map(options.columns)
    rows = rows_of(path, _delimiter(path))
    header = _header(rows)
    names = _names(header.rows, sources)
    places = _places(path, names, sources, len(header.first))
    columns = {field: place for field, place in places.items() if isinstance(place, int)}
    named = [(names[i] if i < len(names) else str(i + 1), i) for i in columns.values()]
    cells, lines = numbers(path, chain([header.first], rows), named, line=header.lines)
    values: dict[str, Array] = {}
    for field, place in places.items():
        if isinstance(place, int):
            values[field] = cells[:, list(columns).index(field)] * sources.get(field, Source()).factor
        else:
            values[field] = np.full(len(cells), place)
    unit = _length_unit(header.rows, columns)
    has_unit = unit != "unknown" and not any(field in sources for field in POSITION)
    is_mapped = any(source.factor != 1.0 and source.column for f, source in sources.items() if f in POSITION)
    position = np.column_stack([values[field] for field in POSITION]) * (LENGTH_UNITS_M[unit] if has_unit else 1.0)
    return Take(
        title=TITLE,
        time=values["time"],
        position=position,
        quat_wxyz=_attitude(values),
        time_unit="s" if sources.get("time", Source()).factor != 1.0 else "unknown",
        length_unit="mapped" if is_mapped else unit if has_unit else "m",
        arrival=values.get("arrival"),
        u=_commands(path, values, lines),
        lines=lines,
    )


def _delimiter(path: Path) -> str:
    from heli_twin.exchange.formats import head_of

    lines = [line for line in head_of(path) if line.strip() and not line.startswith(("#", "%"))]
    counts = {delimiter: sum(line.count(delimiter) for line in lines) for delimiter in ",;\t"}
    best = max(counts, key=lambda delimiter: counts[delimiter])
    return best if counts[best] else " "


def _header(rows: Iterator[list[str]]) -> _Header:
    header: list[list[str]] = []
    lines = 0
    for row in rows:
        cells = [cell.strip() for cell in row if cell.strip()]
        if cells and not is_comment(row):
            if 2 * sum(map(_is_number, cells)) >= len(cells):
                return _Header(header, row, lines)
            header.append([cell.strip() for cell in row])
        lines += 1
        if lines > MAX_HEADER_ROWS:
            break
    return _Header(header, [], lines)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _names(header: Sequence[Sequence[str]], sources: Mapping[str, Source]) -> list[str]:
    """The header row that names the most of the wanted columns; the first of equals."""
    wanted = {sources[field].column if field in sources else field for field in FIELDS}
    return list(max(header, key=lambda row: len(wanted.intersection(row)), default=[]))


def _places(path: Path, names: Sequence[str], sources: Mapping[str, Source], width: int) -> dict[str, int | float]:
    """The column (from 0 on) or the constant of each field."""
    places: dict[str, int | float] = {}
    known = ", ".join(names[:30]) or "none"
    for field in FIELDS:
        source = sources.get(field, Source(field))
        if not source.column:
            places[field] = float(source.factor)
        elif names.count(source.column) > 1:
            raise ImportRefused(
                f"{path} names '{source.column}' twice: rename one of these columns, or give its number"
            )
        elif source.column in names:
            places[field] = names.index(source.column)
        elif source.column.isdecimal() and field in sources:
            if int(source.column) > width:
                raise ImportRefused(f"{path} has {width} columns, {field} cannot be column {source.column}")
            places[field] = int(source.column) - 1
        elif field in sources:
            raise ImportRefused(f"{path}, line 1 names no column '{source.column}': its columns are {known}")
    if "yaw" in sources and not any(field in sources for field in QUATERNION):
        places = {field: place for field, place in places.items() if field not in QUATERNION}
    attitude = ("yaw",) if "yaw" in places and "qw" not in places else QUATERNION
    for field in ("time", *POSITION, *attitude):
        if field not in places:
            near = next((name for name in names if name.lower() == field), "COLUMN")
            raise ImportRefused(
                f"{path}, line 1 names no column for {field}: its columns are {known}; say which it is with"
                f" --map {field}={near}"
            )
    return places


def _length_unit(header: Sequence[Sequence[str]], columns: Mapping[str, int]) -> str:
    """The unit below or above the names of the positions, or in their names: `x [mm]`."""
    for row in header:
        cells = {
            row[columns[field]].strip("[]() ").lower() for field in POSITION if columns.get(field, len(row)) < len(row)
        }
        if len(cells) == 1 and (unit := cells.pop()) in LENGTH_UNITS_M:
            return unit
    return "unknown"


def _attitude(values: Mapping[str, Array]) -> Array:
    if "qw" in values:
        return np.column_stack([values[field] for field in QUATERNION])
    half, zero = 0.5 * values["yaw"], np.zeros_like(values["yaw"])
    return np.column_stack([np.cos(half), zero, zero, np.sin(half)])


def _commands(path: Path, values: Mapping[str, Array], lines: Times) -> Array | None:
    if not any(field in values for field in COMMANDS):
        return None
    missing = np.full_like(values["time"], np.nan)
    for field in filter(values.__contains__, COMMANDS):
        beyond = np.flatnonzero(np.abs(values[field]) > 1.0)
        if len(beyond):
            raise ImportRefused(
                f"{path}, line {lines[beyond[0]]}: {field} = {values[field][beyond[0]]:.4g} is beyond full stick, which"
                f" is 1: is it in percent? Then map {field}=COLUMN*0.01"
            )
    return np.column_stack([values.get(field, missing) for field in COMMANDS])
