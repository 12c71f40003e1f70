"""Rows and cells of text files of recordings, under limits on their size."""

import csv
import math
from array import array
from collections.abc import Iterable, Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from controllers.signals import Array
from heli_twin.exchange.formats import MAX_LINE_CHARACTERS, MAX_ROWS, ImportRefused
from heli_twin.terminal_text import clean


def rows_of(path: Path, delimiter: str) -> Iterator[list[str]]:
    """The rows of a table of cells.

    Args:
        path: A text file in UTF-8.
        delimiter: One character; a blank stands for any run of blanks.

    Raises:
        ImportRefused: The file cannot be read, or is longer than `MAX_ROWS`.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as text:
            lines = _bounded(path, text)
            if delimiter == " ":
                yield from (line.split() for line in lines)
            else:
                yield from csv.reader(lines, delimiter=delimiter, skipinitialspace=True, strict=True)
    except OSError as error:
        raise ImportRefused(f"{path} cannot be opened: {error.strerror or error}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise ImportRefused(f"{path} is not a table in UTF-8: {error}") from error


def _bounded(path: Path, text: Iterable[str]) -> Iterator[str]:
    for count, line in enumerate(text):
        if count >= MAX_ROWS:
            raise ImportRefused(f"{path} has more than {MAX_ROWS} lines: import it in parts")
        if len(line) > MAX_LINE_CHARACTERS:
            raise ImportRefused(f"{path}, line {count + 1} has more than {MAX_LINE_CHARACTERS} characters: is it text?")
        yield line.replace("\0", "\N{REPLACEMENT CHARACTER}")


def is_comment(row: Sequence[str]) -> bool:
    """Return whether a row is a comment: its first cell begins with # or %."""
    return bool(row) and row[0].lstrip().startswith(("#", "%"))


class Numbers(NamedTuple):
    """The numbers of some columns."""

    values: Array
    """(n, columns), NaN for an empty or missing cell."""
    lines: NDArray[np.int64]
    """(n,) the line of each row in its file, from 1 on."""


def numbers(path: Path, rows: Iterable[Sequence[str]], columns: Sequence[tuple[str, int]], line: int = 0) -> Numbers:
    """The numbers of some columns; empty rows and comments are left out.

    Args:
        path: For the message.
        rows: Cells.
        columns: Name and index in a row of each; the first is the time, which may be an ISO date.
        line: Number of the line before the first row, for the message.

    Raises:
        ImportRefused: A cell is neither empty nor a number, or there is no row.
    """
    values, lines = array("d"), array("q")
    for row in rows:
        line += 1
        if is_comment(row) or not any(cell.strip() for cell in row):
            continue
        lines.append(line)
        for place, (name, column) in enumerate(columns):
            cell = row[column].strip() if column < len(row) else ""
            try:
                values.append(_number(cell, is_time=place == 0))
            except ValueError as error:
                raise ImportRefused(f"{path}, line {line}, column '{clean(name)}': {error}") from None
    if not values:
        raise ImportRefused(f"{path} has no rows of numbers: there is nothing to import")
    return Numbers(np.frombuffer(values, float).reshape(-1, len(columns)).copy(), np.frombuffer(lines, np.int64))


def _number(cell: str, is_time: bool) -> float:
    if not cell:
        return math.nan
    try:
        # Python takes 1_000 for a number.
        number = float(cell.replace("_", "?"))
    except ValueError:
        if is_time and (moment := _moment(cell)) is not None:
            return moment
        hint = ": write a decimal point" if "," in cell else ""
        raise ValueError(f"'{clean(cell, 40)}' is not a number{hint}") from None
    if math.isinf(number):
        raise ValueError(f"'{clean(cell, 40)}' is not a finite number")
    return number


def _moment(cell: str) -> float | None:
    """Seconds since 1970 of an ISO date; None for anything else."""
    try:
        moment = datetime.fromisoformat(cell)
    except ValueError:
        return None
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()


def quaternions_of_euler(path: Path, angles: Array, order: str, *, degrees: bool) -> Array:
    """Attitudes (n, 4), scalar first, of Euler angles (n, 3) about the moving axes; NaN where an angle is NaN.

    Args:
        path: For the message.
        angles: About x, y and z, in that order of columns.
        order: Of the turns, such as `XYZ`.
        degrees: Whether the angles are in degrees, not rad.

    Raises:
        ImportRefused: The order is none of three axes.
    """
    from scipy.spatial.transform import Rotation

    order = order.upper()
    if sorted(order) != ["X", "Y", "Z"]:
        raise ImportRefused(
            f"{path}: rotations are of type '{order[:20]}': export quaternions, or Euler angles such as XYZ"
        )
    result = np.full((len(angles), 4), np.nan)
    known = np.isfinite(angles).all(axis=1)
    if known.any():
        in_order = angles[known][:, ["XYZ".index(axis) for axis in order]]
        result[known] = Rotation.from_euler(order, in_order, degrees=degrees).as_quat(scalar_first=True)
    return result
