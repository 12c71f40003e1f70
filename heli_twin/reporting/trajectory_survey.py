"""The demands of a trajectory on the helicopter, and its sketch in text."""

from typing import NamedTuple

import numpy as np

from controllers.errors import InfeasibleTrajectory
from controllers.flatness import feed_forward, state
from controllers.reference import check_feasible
from controllers.signals import Array
from controllers.trajectories import fitted
from heli_twin.experiment import Experiment
from heli_twin.terminal_text import clean

SKETCH_SIZE = (20, 9)
"""Columns and rows of text."""
BRAILLE = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])
"""Bits of the dots of U+2800, two wide and four high."""
DEMANDS = (
    ("pitch", "stick"),
    ("roll", "stick"),
    ("thrust", "stick"),
    ("yaw", "stick"),
    ("forward", "m/s"),
    ("sideward", "m/s"),
    ("vertical", "m/s"),
    ("yaw rate", "rad/s"),
)
"""Inputs and velocities, in the order of (28) and (29)."""


class Survey(NamedTuple):
    """The demands of one trajectory on the believed helicopter."""

    peak: Array
    """(8,) `DEMANDS`, the largest magnitudes."""
    limit: Array
    """(8,) the believed limits."""
    complaint: str
    """The reason why it cannot be flown; empty if it can."""
    path: Array
    """(n, 4) x y z (m) and yaw (rad) over the flight."""


def survey(experiment: Experiment) -> Survey:
    """Compute the demands of an experiment's trajectory on the helicopter that its controller believes in."""
    model, period = experiment.controller.model, experiment.controller.period
    trajectory = fitted(experiment.trajectory, model)
    flat = trajectory.flat(np.arange(0.0, experiment.duration + 0.5 * period, period))
    peak = np.abs(np.hstack([feed_forward(model, flat), state(flat)[:, 4:]])).max(axis=0)
    try:
        check_feasible(trajectory, model, experiment.duration, period)
        complaint = ""
    except InfeasibleTrajectory as error:
        complaint = str(error)
    return Survey(peak, np.array([*model.u_max, *model.v_max]), complaint, flat.z)


def show(kind: str, summary: str, result: Survey) -> None:
    """Print a trajectory for a person."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    lines, caption = sketch(result.path)
    demands = Table.grid(padding=(0, 1))
    for justify in ("left", "right", "left", "left", "right"):
        demands.add_column(justify=justify, no_wrap=True)
    for (name, unit), peak, limit in zip(DEMANDS, result.peak.tolist(), result.limit.tolist(), strict=True):
        share = peak / limit
        bar = "█" * min(16, round(16 * share)) if np.isfinite(share) else ""
        colour = "red" if not share <= 1.0 + 1e-9 else "green"
        demands.add_row(name, f"{peak:.2f}", f"of {limit:g} {unit}", f"[{colour}]{bar:<16}[/]", f"{100 * share:.0f} %")
    both = Table.grid(padding=(0, 2))
    both.add_row("\n".join(lines), demands)
    console = Console()
    console.print(Text(clean(kind), "bold"), Text(f" {clean(summary)}"), soft_wrap=True)
    console.print(both, highlight=False)
    verdict = Text(clean(result.complaint), "red") if result.complaint else Text("feasible", "green")
    console.print(Text(f"{caption:<{SKETCH_SIZE[0]}} "), verdict, end="\n\n", soft_wrap=True)


def sketch(path: Array) -> tuple[list[str], str]:
    """Draw a flight in Braille dots.

    From above, north is up and west is left, with short lines to where the nose points; a flight in an upright plane
    is drawn from the side.

    Args:
        path: (n, 4) x y z (m) and yaw (rad).

    Returns:
        Lines of text, and a caption.
    """
    path = path[np.isfinite(path).all(axis=1)]
    spread, axes = np.linalg.eigh(np.cov(path[:, :2], rowvar=False))
    upright = path[:, 2].std() > 0.02 + np.sqrt(max(float(spread[0]), 0.0))
    if upright:
        across = axes[:, 1] * np.sign(axes[:, 1].sum() or 1.0)
        curve = np.column_stack([path[:, :2] @ across, path[:, 2]])
    else:
        curve = np.column_stack([-path[:, 1], path[:, 0]])
    size = np.ptp(curve, axis=0)
    middle, extent = curve.min(axis=0) + 0.5 * size, max(*size.tolist(), 0.3)
    dots = [curve]
    if not upright:
        at = np.linspace(0, len(path) - 1, 16).astype(int)
        nose = np.column_stack([-np.sin(path[at, 3]), np.cos(path[at, 3])])
        dots += [curve[at] + length * extent * nose for length in np.linspace(0.0, 0.12, 8)]
    caption = f"{'side' if upright else 'top'}, {size[0]:.1f} x {size[1]:.1f} m"
    return _braille((np.vstack(dots) - middle) / extent), caption


def _braille(points: Array) -> list[str]:
    """Points (n, 2), right and up, in about the unit square around 0, as lines of text."""
    columns, rows = SKETCH_SIZE
    wide, high = 2 * columns, 4 * rows
    scale = 0.78 * min(wide, high)
    column = np.rint(0.5 * (wide - 1) + scale * points[:, 0]).astype(int)
    row = np.rint(0.5 * (high - 1) - scale * points[:, 1]).astype(int)
    inside = (column >= 0) & (column < wide) & (row >= 0) & (row < high)
    cells = np.full((rows, columns), 0x2800)
    np.bitwise_or.at(cells, (row[inside] // 4, column[inside] // 2), BRAILLE[row[inside] % 4, column[inside] % 2])
    return ["".join(map(chr, line)) for line in cells.tolist()]
