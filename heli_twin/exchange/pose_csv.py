"""A motion-capture recording as a CSV file: read row by row, and every mistake named by its line and column."""

import csv
import math
from array import array
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from controllers.signals import Array, nanoseconds
from heli_twin.errors import HeliTwinError
from heli_twin.recording.log import Times

POSITION, QUATERNION, COMMANDS = ("x", "y", "z"), ("qw", "qx", "qy", "qz"), ("ux", "uy", "uz", "uyaw")
FIELDS = ("time", "arrival", *POSITION, *QUATERNION, "yaw", *COMMANDS)
"""What a column can be: s, m, unit quaternion body to world, rad, fraction of full stick."""
MAX_ROWS = 4_000_000
"""Rows of the longest recording that is read."""
FARTHEST = 100.0
"""m: the farthest that cameras in a room can see."""
MAX_SECONDS = 36_000.0
"""s: the longest flight that an experiment can describe."""
FASTEST, SLOWEST = 1e-4, 1.0
"""s: between two frames of cameras; anything else is a clock in another unit."""


class ImportRefused(HeliTwinError):
    """A recording that cannot be imported; the message names the line and the column."""


class Column(NamedTuple):
    """Where a field stands in the file."""

    name: str
    factor: float = 1.0
    """From the file's unit to ours."""


class Recording(NamedTuple):
    """A motion-capture recording; times in ns from its first row on."""

    arrival: Times
    """(n,) when each pose reached the ground station, in order."""
    stamp: Times
    """(n,) when the cameras saw it."""
    position: Array
    """(n, 3) world, m."""
    quat_wxyz: Array
    """(n, 4)."""
    command_time: Times
    """(m,)."""
    u: Array
    """(m, 4) fraction of full stick."""
    lost: int
    """Rows without a pose: frames in which the cameras lost the helicopter, or commands between two frames."""
    refused: int = 0
    """Poses that the estimator took for outliers."""


def parse_map(text: str) -> dict[str, Column]:
    """Which column is which field.

    Args:
        text: `field=column` or `field=column*factor`, separated by commas: `time=t,x=px*0.001,yaw=heading`.

    Raises:
        ImportRefused: The text is not of this form.
    """
    columns: dict[str, Column] = {}
    for part in filter(None, (part.strip() for part in text.split(","))):
        field, equals, column = part.partition("=")
        if field not in FIELDS or not equals or not column:
            raise ImportRefused(f"'{part}' maps no column: write field=column, the fields are {', '.join(FIELDS)}")
        if field in columns:
            raise ImportRefused(f"'{part}': {field} is column '{columns[field].name}' already, name it once")
        name, star, factor = column.rpartition("*")
        try:
            columns[field] = Column(name, float(factor)) if star else Column(column)
        except ValueError:
            raise ImportRefused(f"'{part}': '{factor}' is not a number to multiply '{name}' by") from None
        if not math.isfinite(columns[field].factor) or columns[field].factor == 0.0:
            raise ImportRefused(f"'{part}': multiply '{columns[field].name}' by a number that is finite and not 0")
    return columns


def read_recording(path: Path, columns: Mapping[str, Column], latency: float) -> Recording:
    """Read a recording.

    Args:
        path: A CSV file whose first line names its columns, separated by comma, semicolon or tab.
        columns: Where the fields stand that are not called as in `FIELDS`.
        latency: From the picture to the ground station, s, where no column says when a pose arrived.

    Raises:
        ImportRefused: One sentence that names the line and the column.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as text:
            head = text.readline(100_000)
            text.seek(0)
            table = csv.reader(text, delimiter=max(",;\t", key=head.count), skipinitialspace=True, strict=True)
            places = _places(path, [name.strip() for name in next(table, [])], columns)
            return _Rows(path, places).read(table, lambda: table.line_num).recording(latency)
    except OSError as error:
        raise ImportRefused(f"{path} cannot be opened: {error.strerror or error}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise ImportRefused(f"{path} is not a CSV file in UTF-8: {error}") from error


class _Place(NamedTuple):
    at: int
    column: Column


def _places(path: Path, header: Sequence[str], columns: Mapping[str, Column]) -> dict[str, _Place]:
    """Where each field stands in a row."""
    places: dict[str, _Place] = {}
    known = ", ".join(header[:30]) or "none"
    for field in FIELDS:
        column = columns.get(field, Column(field))
        if header.count(column.name) > 1:
            raise ImportRefused(f"{path}, line 1 names '{column.name}' twice: rename one of these columns")
        if column.name in header:
            places[field] = _Place(header.index(column.name), column)
        elif field in columns:
            raise ImportRefused(f"{path}, line 1 names no column '{column.name}': its columns are {known}")
    if "yaw" in columns and not any(field in columns for field in QUATERNION):
        places = {field: place for field, place in places.items() if field not in QUATERNION}
    attitude = ("yaw",) if "yaw" in places and "qw" not in places else QUATERNION
    commands = COMMANDS if any(field in places for field in COMMANDS) else ()
    for field in ("time", *POSITION, *attitude, *commands):
        if field not in places:
            near = next((name for name in header if name.lower() == field), "COLUMN")
            raise ImportRefused(
                f"{path}, line 1 names no column for {field}: its columns are {known}; say which it is with"
                f" --map {field}={near}"
            )
    return places


class _Rows:
    """The rows of a recording, checked one by one."""

    def __init__(self, path: Path, places: Mapping[str, _Place]) -> None:
        self._path, self._places, self._line = path, places, 1
        self._attitude = QUATERNION if "qw" in places else ("yaw",)
        self._start, self._last, self._lost = math.nan, -math.inf, 0
        self._poses, self._commands = array("d"), array("d")

    def read(self, table: Iterable[list[str]], line: Callable[[], int]) -> "_Rows":
        """Take in every row; `line` counts the lines."""
        for row in table:
            self._line = line()
            if self._line > MAX_ROWS:
                raise ImportRefused(f"{self._path} has more than {MAX_ROWS} lines: import it in parts")
            if row:
                self._row(row)
        if not self._poses:
            raise ImportRefused(f"{self._path}, line {self._line}: there is not a single pose up to here")
        return self

    def _row(self, row: Sequence[str]) -> None:
        time = self._number(row, "time", needed=True)
        if math.isnan(self._start):
            self._start = time
        if time <= self._last:
            raise self._refused(
                "time", f"{time:.9g} s does not come after {self._last:.9g} s, the row before: sort the rows by time"
            )
        if time - self._start > MAX_SECONDS:
            raise self._refused(
                "time",
                f"{time - self._start:.9g} s after the first row, {MAX_SECONDS:g} s at most: is it in ns? Then map"
                " time=COLUMN*1e-9",
            )
        self._last = time
        arrival = self._number(row, "arrival") if "arrival" in self._places else math.nan
        if arrival < time or arrival - time > MAX_SECONDS:
            raise self._refused("arrival", f"{arrival:.9g} s does not follow the picture, {time:.9g} s")
        pose = [self._number(row, field) for field in (*POSITION, *self._attitude)]
        far = next((field for field, p in zip(POSITION, pose, strict=False) if abs(p) > FARTHEST), None)
        if far is not None:
            raise self._refused(far, f"more than {FARTHEST:g} m away: is it in mm? Then map {far}=COLUMN*0.001")
        unknown = [math.isnan(number) for number in pose]
        if any(unknown) and not all(unknown) and len(row) <= max(place.at for place in self._places.values()):
            raise self._refused(POSITION[0], f"the row ends after {len(row)} columns, in the middle of a pose")
        if any(unknown):
            self._lost += 1
        else:
            self._poses.extend((time - self._start, arrival - self._start, *pose[:3], *self._quaternion(pose[3:])))
        if "ux" in self._places:
            u = [self._number(row, field) for field in COMMANDS]
            if not any(math.isnan(number) for number in u):
                self._commands.extend((time - self._start, *map(self._stick, COMMANDS, u)))

    def _number(self, row: Sequence[str], field: str, needed: bool = False) -> float:
        """The number of a field in our unit; NaN for an empty one."""
        at, column = self._places[field]
        text = row[at].strip() if at < len(row) else ""
        try:
            # Python takes 1_000 for a number.
            number = float(text.replace("_", "?")) * column.factor if text else math.nan
        except ValueError:
            hint = ": write a decimal point" if "," in text else ""
            raise self._refused(field, f"'{text[:40]}' is not a number{hint}") from None
        if math.isinf(number) or (needed and math.isnan(number)):
            raise self._refused(field, f"'{text[:40]}' is not a finite number")
        return number

    def _quaternion(self, attitude: Sequence[float]) -> Sequence[float]:
        if len(attitude) == 1:
            return math.cos(0.5 * attitude[0]), 0.0, 0.0, math.sin(0.5 * attitude[0])
        norm = math.hypot(*attitude)
        if not 0.9 < norm < 1.1:
            raise self._refused("qw", f"the quaternion has length {norm:.3g}, not 1")
        return [number / norm for number in attitude]

    def _stick(self, field: str, u: float) -> float:
        if abs(u) > 1.0:
            raise self._refused(
                field, f"{u:.4g} is beyond full stick, which is 1: is it in percent? Then map {field}=COLUMN*0.01"
            )
        return u

    def _refused(self, field: str, what: str) -> ImportRefused:
        return ImportRefused(f"{self._path}, line {self._line}, column '{self._places[field].column.name}': {what}")

    def recording(self, latency: float) -> Recording:
        """All rows, poses in order of arrival."""
        poses = np.frombuffer(self._poses, float).reshape(-1, 9)
        commands = np.frombuffer(self._commands, float).reshape(-1, 5)
        apart = float(np.median(np.diff(poses[:, 0]))) if len(poses) > 1 else SLOWEST
        if not FASTEST <= apart <= SLOWEST:
            unit = "ms? Then map time=COLUMN*0.001" if apart > SLOWEST else "s?"
            raise ImportRefused(
                f"{self._path}, column '{self._places['time'].column.name}': frames are {apart:g} s apart,"
                f" {FASTEST:g} to {SLOWEST:g} s is possible: is it in {unit}"
            )
        stamp = _ns(poses[:, 0])
        arrival = np.where(np.isnan(poses[:, 1]), stamp + nanoseconds(latency), _ns(np.nan_to_num(poses[:, 1])))
        order = np.argsort(arrival, kind="stable")
        return Recording(
            arrival[order],
            stamp[order],
            poses[order, 2:5],
            poses[order, 5:9],
            _ns(commands[:, 0]),
            commands[:, 1:],
            self._lost,
        )


def _ns(seconds: Array) -> Times:
    return np.round(1e9 * seconds).astype(np.int64)
