"""Ranges of the plots' y axes, chosen so that every plot of a small window has at least two numbers at its axis."""

from collections.abc import Iterator, Mapping, Sequence
from math import ceil, floor, log10

import numpy as np

from controllers.signals import Array
from heli_twin.recording.log import Log
from heli_twin.viewing.entities import tracking
from heli_twin.viewing.style import INPUTS, POSITIONS

ROW_PX, TILE_PX = 100, 190
"""Heights of a plot among others in a column, and of one of four in a window of 900 x 600 pixels."""
LABEL_PX = 25
"""Distance of two numbers at an axis below which Rerun leaves them out; it writes multiples of powers of ten."""
MARGIN = 0.05
"""Share of the values' span that is left free above and below."""

Range = tuple[float, float]


def labelled(low: float, high: float, height: int) -> Range:
    """The least range around values in which an axis of this height (pixels) shows two numbers."""
    pad = MARGIN * (high - low) or 0.5
    low, high = low - pad, high + pad
    step = 10.0 ** ceil(log10((high - low) * LABEL_PX / height) - 1e-9)
    while floor(high / step) - ceil(low / step) < 1:
        above, below = step * (floor(high / step) + 1), step * (ceil(low / step) - 1)
        # A number at the very end of the axis is cut off.
        low, high = (low, above + 0.1 * step) if above - high <= low - below else (below - 0.1 * step, high)
    return low, high


def ranges(logs: Sequence[Log]) -> Mapping[str, Range]:
    """The range of the plot of each entity, over all of these flights."""
    values: dict[str, list[Array]] = {}
    for log in logs:
        for entity, shown in _values(log):
            values.setdefault(entity, []).append(shown[np.isfinite(shown)])
    found: dict[str, Range] = {}
    for entity, parts in values.items():
        every = np.concatenate(parts)
        if len(every):
            is_tile = entity.startswith("/position") or entity.endswith("/sent")
            height = TILE_PX if is_tile else ROW_PX
            found[entity] = labelled(float(every.min()), float(every.max()), height)
    return found


def _values(log: Log) -> Iterator[tuple[str, Array]]:
    """What the plots show, in the units of the plots."""
    error = tracking(log)[1]
    yield "/error/position", 100 * error[:, :3].ravel()
    yield "/error/yaw", np.degrees(error[:, 3])
    yield "/tracking/position", 100 * np.append(np.linalg.norm(error[:, :3], axis=1), [0.0] * bool(len(error)))
    yield "/tracking/yaw", np.degrees(error[:, 3])
    yield "/input/all", log.sent.u.ravel()
    for i, name in enumerate(INPUTS):
        yield f"/input/{name}/sent", log.sent.u[:, i]
    true = np.column_stack([log.truth.position, np.degrees(log.truth.yaw)])
    wanted = np.column_stack([log.reference.position, np.degrees(log.reference.yaw)])
    for i, name in enumerate(POSITIONS):
        yield f"/position/{name}", np.concatenate([true[:, i], wanted[:, i]])
    air = log.disturbance
    yield "/air/wind", air.wind.ravel()
    yield "/air/push", air.acceleration.ravel()
    yield "/air/thrust", air.thrust_factor
