"""The ground truth of the EuRoC datasets: a CSV of time (ns), position (m) and quaternion, scalar first.

Source: Burri et al., The EuRoC micro aerial vehicle datasets, IJRR 2016.
"""

from pathlib import Path

from heli_twin.exchange.formats import Options, Take
from heli_twin.exchange.formats.cells import numbers, rows_of

TITLE = "EuRoC ground truth"
COLUMNS = ("time", "x", "y", "z", "qw", "qx", "qy", "qz")


def recognises(head: list[str]) -> bool:
    """Return whether the first line names EuRoC's columns."""
    first = head[0].replace(" ", "") if head else ""
    return first.startswith("#timestamp") and "p_" in first and "q_" in first


def read(path: Path, options: Options) -> Take:
    """Read a ground truth.

    Raises:
        ImportRefused: A cell is not a number.
    """
    cells, lines = numbers(path, rows_of(path, ","), [(name, i) for i, name in enumerate(COLUMNS)])
    return Take(TITLE, 1e-9 * cells[:, 0], cells[:, 1:4], cells[:, 4:8], lines=lines)
