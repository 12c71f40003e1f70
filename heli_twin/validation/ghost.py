"""The ghost: what a twin predicts of a flight, as a log that can be shown beside it."""

from dataclasses import replace

import numpy as np

from controllers.signals import Array
from heli_twin.errors import HeliTwinError
from heli_twin.experiment.text import load
from heli_twin.recording import Log
from heli_twin.recording.records import Messages
from heli_twin.recording.schema import LAYOUTS
from heli_twin.validation.forecast import BIN_S, HORIZON_BINS, Forecast, forecast, held_fit
from heli_twin.validation.twins import noise_in, twin_of
from heli_twin.validation.validate import pieces_of
from heli_twin.viewing.show import Shown, ShownFlights, with_truth


def with_ghost(shown: Shown, source: str) -> ShownFlights:
    """Return a flight with the ghost of a twin beside it.

    Args:
        shown: One flight.
        source: File or preset of the twin.

    Raises:
        HeliTwinError: There are two flights, the twin cannot be read, or the log has no usable flight.
    """
    if not isinstance(shown, ShownFlights) or len(shown.logs) != 1:
        raise HeliTwinError("--ghost stands beside one flight: give one log, or of several helicopters one, RUN.mcap#a")
    experiment = load(source)
    twin = twin_of("ghost", experiment, noise_in(source, experiment))
    (log,), (name,) = shown.logs, shown.names
    whole, pieces = pieces_of(log, name, twin)
    ghost = ghost_log(with_truth(log), forecast(pieces, twin, held_fit(whole, twin)))
    return ShownFlights([log, ghost], [*shown.experiments] * 2, [name, f"{name}, predicted by {source}"], source)


def ghost_log(log: Log, predicted: Forecast) -> Log:
    """Return predictions, one after the other, as the truth of a log with the plan of another.

    Args:
        log: With the times at which the ghost is wanted.
        predicted: Of which each begins where the one before it ends.
    """
    times = log.truth.time
    t, chosen = 1e-9 * times, _chosen(predicted)
    rows = np.searchsorted(predicted.begin[chosen], t, side="right") - 1
    middles, kept, poses = BIN_S * (np.arange(HORIZON_BINS) + 0.5), list[int](), list[Array]()
    for i, row in enumerate(rows.tolist()):
        path = predicted.predicted[chosen[row]]
        seen = np.isfinite(path[:, 0])
        since = t[i] - predicted.begin[chosen[row]]
        if row >= 0 and seen.any() and since <= middles[seen][-1] + 0.5 * BIN_S:
            kept.append(i)
            poses.append(np.array([np.interp(since, middles[seen], column) for column in path[seen].T]))
    velocity, unknown = np.zeros(3), np.zeros(4)
    data = LAYOUTS["/truth"].pack(
        [
            (int(times[i]), pose[:3], _quat_wxyz(pose[3:]), velocity, velocity, pose[3], 0.0, unknown, False)
            for i, pose in zip(kept, poses, strict=True)
        ]
    )
    messages = {"/truth": Messages([int(times[i]) for i in kept], data)}
    plans = {topic: log.messages[topic] for topic in ("/reference", "/view/reference_path") if topic in log.messages}
    return replace(log, messages=messages | plans)


def _chosen(predicted: Forecast) -> list[int]:
    """Predictions that follow each other without an overlap."""
    chosen, end = list[int](), -np.inf
    for i, begin in enumerate(predicted.begin.tolist()):
        if begin >= end - 0.5 * BIN_S:
            chosen.append(i)
            end = begin + HORIZON_BINS * BIN_S
    return chosen


def _quat_wxyz(angles: Array) -> Array:
    """Attitude (4,) of yaw, pitch and roll."""
    (cy, cp, cr), (sy, sp, sr) = np.cos(0.5 * angles), np.sin(0.5 * angles)
    return np.array(
        [
            cy * cp * cr + sy * sp * sr,
            cy * cp * sr - sy * sp * cr,
            cy * sp * cr + sy * cp * sr,
            sy * cp * cr - cy * sp * sr,
        ]
    )
