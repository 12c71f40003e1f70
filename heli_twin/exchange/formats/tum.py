"""The trajectory format of TUM's RGB-D benchmark and of evo.

A line is `time x y z qx qy qz qw` in s and m, with blanks between; lines that begin with # are comments.

Source: Sturm et al., A Benchmark for the Evaluation of RGB-D SLAM Systems, IROS 2012; TUM, file formats.
"""

from pathlib import Path

from heli_twin.exchange.formats import Options, Take
from heli_twin.exchange.formats.cells import numbers, rows_of

TITLE = "TUM trajectory"
COLUMNS = ("time", "x", "y", "z", "qx", "qy", "qz", "qw")


def recognises(head: list[str]) -> bool:
    """Return whether every line except comments is eight numbers."""
    rows = [line.split() for line in head if line.strip() and not line.startswith("#")]
    return bool(rows) and all(len(row) == 8 and all(map(_is_number, row)) for row in rows)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def read(path: Path, options: Options) -> Take:
    """Read a trajectory.

    Raises:
        ImportRefused: A cell is not a number.
    """
    cells, lines = numbers(path, rows_of(path, " "), [(name, i) for i, name in enumerate(COLUMNS)])
    return Take(TITLE, cells[:, 0], cells[:, 1:4], cells[:, [7, 4, 5, 6]], lines=lines)
