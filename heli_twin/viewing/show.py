"""What a viewer needs to know of an experiment, what tells two apart, and where pictures go."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import starmap
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from heli_twin.errors import HeliTwinError
from heli_twin.experiment import Experiment
from heli_twin.experiment.differences import differences
from heli_twin.experiment.tree import from_json
from heli_twin.logbook import planned_path
from heli_twin.recording import Log, read_log
from heli_twin.recording.log import Messages
from heli_twin.recording.schema import LAYOUTS

if TYPE_CHECKING:
    from heli_twin.viewing.blueprint import Scales
    from heli_twin.viewing.live import Sink

VIEWER_PORT = 9876
"""Where Rerun's viewer listens."""


def scales(experiment: Experiment) -> "Scales":
    """Limits and deadline that the plots compare with."""
    from heli_twin.viewing.blueprint import Scales

    controller = experiment.controller
    return Scales(controller.model.u_min, controller.model.u_max, controller.period, planned_path(experiment))


def sink(where: str) -> "Sink":
    """Where pictures go: `spawn` a viewer, `connect` to one, or a Rerun file.

    Raises:
        HeliTwinError: It is none of these.
    """
    from heli_twin.viewing.live import Sink

    if where in ("spawn", "connect"):
        return Sink(port=VIEWER_PORT, spawn=where == "spawn")
    if where.endswith(".rrd"):
        return Sink(file=Path(where))
    raise HeliTwinError(f"'{where}' is no place for pictures: give spawn, connect, or a file that ends in .rrd")


class Flights(NamedTuple):
    """One or two flights to show, with what they need to be shown."""

    logs: Sequence[Log]
    experiments: Sequence[Experiment]
    names: Sequence[str]

    @property
    def duration(self) -> float:
        """Of the longest, s."""
        return 1e-9 * max(int(log.truth.time[-1]) if len(log.truth.time) else 0 for log in self.logs)

    def show(self, where: "Sink") -> None:
        """Show one, or two in one scene.

        Raises:
            LogError: Nothing is there to show it.
        """
        from heli_twin.viewing.live import show
        from heli_twin.viewing.two_flights import Difference, Run, show_both

        if len(self.logs) == 1:
            show(self.logs[0], where, scales(self.experiments[0]))
        else:
            a, b = (Run(log, scales(e), name) for log, e, name in zip(*self, strict=True))
            show_both(a, b, [*starmap(Difference, differences(*self.experiments))], where)


def flights(paths: Sequence[Path]) -> Flights:
    """Read logs to show.

    Raises:
        LogError: A log cannot be read.
        ExperimentError: It was flown by another version, whose experiment this one does not know.
    """
    logs = [flown_as_seen(read_log(path)) for path in paths]
    return Flights(logs, [from_json(log.experiment) for log in logs], [path.name for path in paths])


def flown_as_seen(log: Log) -> Log:
    """A log in which nobody knows the truth, with what the cameras saw in its place; any other as it is."""
    if len(log.truth.time) or not len(log.pose.time):
        return log
    stamps, first = np.unique(log.pose.stamp, return_index=True)
    position, quat_wxyz = log.pose.position[first], log.pose.quat_wxyz[first]
    w, x, y, z = quat_wxyz.T
    yaw = np.unwrap(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))
    velocity = np.gradient(position, 1e-9 * stamps, axis=0) if len(stamps) > 1 else np.zeros_like(position)
    none = np.zeros(4)
    data = LAYOUTS["/truth"].pack(
        [
            (t, position[i], quat_wxyz[i], velocity[i], none[:3], yaw[i], 0.0, none, False)
            for i, t in enumerate(stamps.tolist())
        ]
    )
    return replace(log, messages={**log.messages, "/truth": Messages(stamps.tolist(), data)})


def snapshot(shown: Flights, file: Path, at: float | None, size: tuple[int, int]) -> None:
    """Write a picture of flights at one moment (s), by default the end, without a screen; size in pixels.

    Raises:
        HeliTwinError: There is no such moment, nothing to draw with, or the file cannot be written.
    """
    from heli_twin.viewing.live import Sink
    from heli_twin.viewing.viewer_process import picture

    if file.suffix != ".png":
        raise HeliTwinError(f"cannot write {file}: give the picture a name that ends in .png")
    end = shown.duration
    at = end if at is None else at
    if not 0 <= at <= end:
        raise HeliTwinError(f"nothing was recorded at {at:g} s: give --at a time from 0 to {end:g} s")
    png = picture(lambda port: shown.show(Sink(port=port)), at, size)
    try:
        file.write_bytes(png)
    except OSError as error:
        raise HeliTwinError(f"cannot write {file}: {error.strerror}") from None
