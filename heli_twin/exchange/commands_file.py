"""Commands in a file of their own, for recordings of cameras that know no commands: a CSV on the cameras' clock."""

from pathlib import Path

import numpy as np

from controllers.signals import Array
from heli_twin.exchange.cleaning import Clean
from heli_twin.exchange.formats import ImportRefused
from heli_twin.exchange.formats.cells import is_comment, numbers, rows_of
from heli_twin.terminal_text import clean

FIELDS = ("ux", "uy", "uz", "uyaw")


def with_commands(recording: Clean, path: Path) -> Clean:
    """Return a recording with the commands of a file; each counts from its time on.

    Args:
        recording: Its first row is at `recording.start` on the clock of the file.
        path: Columns `time` (s) and some of ux uy uz uyaw, fraction of full stick, named in the first line.

    Raises:
        ImportRefused: The file cannot be read, has other columns, or its times are in no order or beyond the recording.
    """
    if len(recording.command_time):
        raise ImportRefused(f"the recording has commands of its own: leave out --commands {path}")
    time, u = read_commands(path)
    since = time - recording.start
    last = float(recording.time[-1])
    if since[0] > last or since[-1] < 0.0:
        raise ImportRefused(
            f"{path}: commands from {time[0]:.9g} to {time[-1]:.9g} s, and poses from {recording.start:.9g} to"
            f" {recording.start + last:.9g} s: both have to be on one clock, in s"
        )
    # Of the commands before the first row, the last one still holds.
    first = max(int(np.searchsorted(since, 0.0, side="right")) - 1, 0)
    return recording._replace(command_time=np.maximum(since[first:], 0.0), u=u[first:])


def read_commands(path: Path) -> tuple[Array, Array]:
    """Return times (m,), s, and commands (m, 4), NaN for an input that the file does not have.

    Raises:
        ImportRefused: See `with_commands`.
    """
    rows = rows_of(path, ",")
    header = [cell.strip().lower() for cell in next((row for row in rows if not is_comment(row)), [])]
    known = [name for name in FIELDS if name in header]
    if "time" not in header or not known:
        told = ", ".join(header)
        raise ImportRefused(
            f"{path}: its first line is '{clean(told, 60)}': name the columns time (s) and ux, uy, uz, uyaw"
        )
    columns = [("time", header.index("time")), *((name, header.index(name)) for name in known)]
    values, lines = numbers(path, rows, columns, line=1)
    for i, (name, _) in enumerate(columns):
        wrong = np.flatnonzero(~(np.abs(values[:, i]) <= 1.0) if i else ~np.isfinite(values[:, 0]))
        if len(wrong):
            right = "a fraction of full stick, -1 to 1" if i else "a time in s"
            raise ImportRefused(f"{path}, line {lines[wrong[0]]}: {name} = {values[wrong[0], i]:.4g} is not {right}")
    late = np.flatnonzero(np.diff(values[:, 0]) < 0.0)
    if len(late):
        raise ImportRefused(f"{path}, line {lines[late[0] + 1]}: its time is before that of the line above")
    u = np.full((len(values), len(FIELDS)), np.nan)
    for i, name in enumerate(known, 1):
        u[:, FIELDS.index(name)] = values[:, i]
    return values[:, 0], u
