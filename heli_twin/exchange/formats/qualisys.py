"""Qualisys Track Manager's TSV export of rigid bodies (6D).

The header has a name and a value a line (`FREQUENCY`, `BODY_NAMES`, ...); the last line of it names the columns:
`Frame`, `Time`, and for each body X Y Z (mm), three Euler angles (degrees), the residual and the rotation matrix
`Rot[0]` to `Rot[8]`, column by column. A body that the cameras lost has zeros or empty cells.

Source: Qualisys, QTM user manual, 6DOF data (.tsv). That the matrix stands column by column is seen in published files,
in which `Rot[1]` is plus the sine of the yaw and `Rot[2]` minus that of the pitch.
"""

from pathlib import Path

import numpy as np

from controllers.signals import Array
from heli_twin.exchange.formats import ImportRefused, Options, Take, chosen_body
from heli_twin.exchange.formats.cells import numbers, rows_of

TITLE = "Qualisys 6D TSV"


def recognises(head: list[str]) -> bool:
    """Return whether the header is Qualisys' and announces bodies."""
    return any(line.startswith("DATA_INCLUDED\t6D") for line in head) or any(
        line.startswith("BODY_NAMES") for line in head
    )


def read(path: Path, options: Options) -> Take:
    """Read a measurement.

    Raises:
        ImportRefused: The header is damaged, or the body is not in it.
    """
    rows = rows_of(path, "\t")
    facts: dict[str, list[str]] = {}
    line = 0
    names: list[str] = []
    for line, row in enumerate(rows, 1):
        if row and row[0].strip() == "Frame":
            names = [cell.strip() for cell in row]
            break
        if row:
            facts[row[0].strip()] = [cell.strip() for cell in row[1:] if cell.strip()]
        if line > 100:
            break
    if not names:
        raise ImportRefused(f"{path} has no line that begins with Frame: export it with its header")
    bodies = facts.get("BODY_NAMES", [])
    body = chosen_body(path, bodies, options.body)
    first = [i for i, name in enumerate(names) if name.split(" ")[-1] == "X"]
    matrix = [i for i, name in enumerate(names) if name == "Rot[0]"]
    if len(first) != len(bodies) or len(matrix) != len(bodies):
        raise ImportRefused(f"{path} names {len(bodies)} bodies, and columns of {len(matrix)}: export it again")
    which = bodies.index(body)
    position, rotation = first[which], matrix[which]
    columns = [("Time", 1), *((names[i], i) for i in (*range(position, position + 3), *range(rotation, rotation + 9)))]
    cells, lines = numbers(path, rows, columns, line=line)
    return Take(
        title=TITLE,
        time=cells[:, 0],
        position=1e-3 * cells[:, 1:4],
        quat_wxyz=_quaternions(cells[:, 4:]),
        length_unit="mm",
        lines=lines,
        body=body,
        bodies=tuple(bodies),
    )


def _quaternions(columns: Array) -> Array:
    """Attitudes (n, 4) of rotation matrices (n, 9) that stand column by column; NaN for what is no rotation."""
    from scipy.spatial.transform import Rotation

    matrices = columns.reshape(-1, 3, 3).transpose(0, 2, 1)
    quaternions = np.full((len(matrices), 4), np.nan)
    known = np.asarray(np.isfinite(matrices).all(axis=(1, 2)))
    determinant = np.linalg.det(np.where(known[:, None, None], matrices, 0.0))
    known &= np.abs(determinant - 1.0) < 0.01
    if known.any():
        quaternions[known] = Rotation.from_matrix(matrices[known]).as_quat(scalar_first=True)
    return quaternions
