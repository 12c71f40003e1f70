"""Vicon's CSV export: objects of Tracker, segments of Nexus.

Line 1 is the title of the section, line 2 the rate in Hz, line 3 the names of the bodies above their first column,
line 4 the components, line 5 their units. `RX RY RZ` are Euler angles about the moving axes in the order XYZ, or a
rotation vector, by the settings of the export, which the file does not tell; `RX RY RZ RW` are a quaternion.

Source: Vicon Tracker user guide, exporting CSV; the layout as read by published importers (AG6GR/Vicon_CSV).
"""

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from controllers.signals import Array
from heli_twin.exchange.formats import ImportRefused, Options, Take, chosen_body
from heli_twin.exchange.formats.cells import numbers, quaternions_of_euler, rows_of
from heli_twin.exchange.frames import LENGTH_UNITS_M

TITLE = "Vicon CSV"
SECTIONS = ("Objects", "Segments", "Global Segments")


def recognises(head: list[str]) -> bool:
    """Return whether the file begins with a title, a rate and Vicon's components."""
    return len(head) > 3 and head[0].strip(" ,\t") in SECTIONS and "Sub Frame" in head[3]


def read(path: Path, options: Options) -> Take:
    """Read the first section of a file.

    Raises:
        ImportRefused: The header is damaged, or the body is not in it.
    """
    rows = rows_of(path, "\t" if "\t" in _line(path, 3) else ",")
    _, rate, names, components, units = (next(rows, []) for _ in range(5))
    try:
        frequency = float(rate[0])
    except (IndexError, ValueError):
        raise ImportRefused(f"{path}, line 2 is not the rate in Hz: export it from Vicon again") from None
    if not 0 < frequency < np.inf:
        raise ImportRefused(f"{path}, line 2: {frequency:g} Hz is no rate of cameras")
    starts = {name.strip(): i for i, name in enumerate(names) if name.strip()}
    body = chosen_body(path, list(starts), options.body)
    end = min([i for i in starts.values() if i > starts[body]], default=len(components))
    at = {components[i].strip().upper(): i for i in reversed(range(starts[body], min(end, len(components))))}
    at["FRAME"] = 0
    turning = ["RW", "RX", "RY", "RZ"] if "RW" in at else ["RX", "RY", "RZ"]
    missing = next((name for name in (*turning, "TX", "TY", "TZ") if name not in at), None)
    if missing:
        raise ImportRefused(f"{path} has no column {missing} for {body}: export its rotation and translation")
    length = units[at["TX"]].strip().lower() if at["TX"] < len(units) else ""
    if length not in LENGTH_UNITS_M:
        raise ImportRefused(f"{path}, line 5: TX is in '{length}', it must be one of {', '.join(LENGTH_UNITS_M)}")
    section = _until_empty(rows)
    cells, lines = numbers(path, section, [(name, at[name]) for name in ("FRAME", *turning, "TX", "TY", "TZ")], line=5)
    frame = cells[:, 0]
    rotation = cells[:, 1 : 1 + len(turning)]
    notes: tuple[str, ...] = ()
    if len(turning) == 3:
        degrees = at["RX"] < len(units) and units[at["RX"]].strip().lower() in ("deg", "degrees")
        kind = options.rotation or "euler"
        rotation, note = _attitude(path, rotation, kind, degrees)
        notes = (note,) if not options.rotation else ()
    return Take(
        title=f"{TITLE}, {_line(path, 0).strip(' ,')}",
        time=(frame - frame[np.isfinite(frame)][:1].sum()) / frequency,
        position=LENGTH_UNITS_M[length] * cells[:, -3:],
        quat_wxyz=np.ascontiguousarray(rotation),
        length_unit=length,
        lines=lines,
        body=body,
        bodies=tuple(starts),
        notes=notes,
    )


def _attitude(path: Path, rotation: Array, kind: str, degrees: bool) -> tuple[Array, str]:
    if kind == "euler":
        return quaternions_of_euler(path, rotation, "XYZ", degrees=degrees), (
            "RX RY RZ are taken as Euler angles about the moving axes, in the order XYZ; --rotation vector takes them"
            " as a rotation vector"
        )
    from scipy.spatial.transform import Rotation

    known = np.isfinite(rotation).all(axis=1)
    quaternions = np.full((len(rotation), 4), np.nan)
    if known.any():
        quaternions[known] = Rotation.from_rotvec(rotation[known], degrees=degrees).as_quat(scalar_first=True)
    return quaternions, ""


def _until_empty(rows: Iterable[list[str]]) -> Iterator[list[str]]:
    """The rows of the first section: another one may follow behind an empty line."""
    for row in rows:
        if not any(cell.strip() for cell in row):
            return
        yield row


def _line(path: Path, number: int) -> str:
    from heli_twin.exchange.formats import head_of

    head = head_of(path)
    return head[number] if number < len(head) else ""
