"""OptiTrack Motive's CSV export of rigid bodies, format versions 1.2x with the header of Motive 1.10 to 3.

Line 1 holds names and values in turn (`Format Version`, `Rotation Type`, `Length Units`, ...). Above the row that
begins with `Frame` stand, for each column, the type of the asset, its name, its id and the component; Motive 1.x leaves
the first two cells of these rows empty, later versions write `Type`, `Name`, `ID` and `Parent` into the second.
A body that the cameras lost has empty cells. World and body are x left, y up, z forward.

Source: OptiTrack, Motive documentation, Data Export: CSV.
"""

from pathlib import Path

import numpy as np

from heli_twin.exchange.formats import ImportRefused, Options, Take, chosen_body
from heli_twin.exchange.formats.cells import numbers, rows_of
from heli_twin.exchange.frames import LENGTH_UNITS_M

TITLE = "OptiTrack Motive CSV"
_UNITS = {"millimeters": "mm", "centimeters": "cm", "meters": "m", "inches": "in", "feet": "ft"}


def recognises(head: list[str]) -> bool:
    """Return whether the first line is Motive's."""
    return bool(head) and head[0].startswith("Format Version,")


def read(path: Path, options: Options) -> Take:
    """Read a take.

    Raises:
        ImportRefused: The header is damaged, or the body is not in it.
    """
    rows = rows_of(path, ",")
    first = next(rows)
    facts = dict(zip(first[::2], first[1::2], strict=False))
    header: list[list[str]] = []
    for row in rows:
        if row and row[0].strip() == "Frame":
            break
        header.append(row)
        if len(header) > 20:
            raise ImportRefused(
                f"{path} has no line that begins with Frame: export it from Motive again, with its header"
            )
    else:
        raise ImportRefused(f"{path} ends before the line that begins with Frame: export it from Motive again")
    header_rows, header = header, [row for row in header if any(cell.strip() for cell in row)]
    if len(header) < 3:
        raise ImportRefused(f"{path} does not name its bodies: export it from Motive again, with its header")
    types, names, components, axes = header[0], header[1], header[-1], row
    width = min(len(types), len(names), len(components), len(axes))
    columns = [i for i in range(2, width) if types[i].strip().lower() in ("rigid body", "rigidbody")]
    bodies = list(dict.fromkeys(names[i].strip() for i in columns))
    body = chosen_body(path, bodies, options.body)
    at = {
        (components[i].strip().lower(), axes[i].strip().upper()): i
        for i in reversed(columns)
        if names[i].strip() == body
    }
    rotation = facts.get("Rotation Type", "Quaternion").strip()
    is_quaternion = rotation.lower() == "quaternion"
    turning = [("rotation", axis) for axis in ("WXYZ" if is_quaternion else "XYZ")]
    wanted = [*turning, *(("position", axis) for axis in "XYZ")]
    missing = next((" ".join(name) for name in wanted if name not in at), None)
    if missing:
        raise ImportRefused(f"{path} has no column '{missing}' for {body}: export its rotation and position")
    cells, lines = numbers(
        path, rows, [("Time", 1), *((" ".join(name), at[name]) for name in wanted)], line=len(header_rows) + 2
    )
    unit = facts.get("Length Units", "Meters").strip().lower()
    if unit not in _UNITS:
        raise ImportRefused(f"{path}: Length Units is '{unit}', it must be one of {', '.join(_UNITS)}")
    notes: tuple[str, ...] = ()
    attitude = cells[:, 1 : 1 + len(turning)]
    if not is_quaternion:
        from heli_twin.exchange.formats.cells import quaternions_of_euler

        attitude = quaternions_of_euler(path, attitude, rotation, degrees=True)
        notes = (f"rotations are taken as Euler angles about the moving axes, in the order {rotation}",)
    return Take(
        title=f"{TITLE} {facts.get('Format Version', '')}".strip(),
        time=cells[:, 0],
        position=LENGTH_UNITS_M[_UNITS[unit]] * cells[:, -3:],
        quat_wxyz=np.ascontiguousarray(attitude),
        frame="yup",
        length_unit=_UNITS[unit],
        lines=lines,
        body=body,
        bodies=tuple(bodies),
        notes=notes,
    )
