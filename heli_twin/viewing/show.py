"""Show recorded flights: in a viewer, in a Rerun file, or as a picture of one moment."""

import subprocess
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np

from controllers.laws import extra_states
from controllers.rotations import yaw_of
from heli_twin.errors import HeliTwinError
from heli_twin.experiment import Experiment
from heli_twin.experiment.differences import differences
from heli_twin.lab.plant.airframe import shape_of
from heli_twin.logbook import planned_path, viewed_experiment
from heli_twin.recording import Log, read_log
from heli_twin.recording.records import Messages
from heli_twin.recording.schema import LAYOUTS
from heli_twin.requirements import Requirement, requirements_of
from heli_twin.viewing.blueprint import Scales
from heli_twin.viewing.live import Destination, show
from heli_twin.viewing.requirements import Judged, judged
from heli_twin.viewing.ships import show_ships
from heli_twin.viewing.two_flights import ComparedFlight, show_both
from heli_twin.viewing.viewer_process import picture, web_viewer
from heli_twin.whole_file import write_whole

VIEWER_PORT = 9876
"""Port of Rerun's viewer."""


def scales_of(experiment: Experiment) -> Scales:
    """Limits, deadline, planned path and the helicopter's shape: what an experiment tells its pictures."""
    controller = experiment.controller
    limits = controller.model.u_min, controller.model.u_max
    states, shape = extra_states(experiment.estimator), shape_of(experiment.plant)
    return Scales(*limits, controller.period, planned_path(experiment), states=states, shape=shape)


def destination(where: str) -> Destination:
    """Read where pictures go: `spawn` a viewer, `connect` to one, or a Rerun file.

    Raises:
        HeliTwinError: It is none of these.
    """
    if where in ("spawn", "connect"):
        return Destination(port=VIEWER_PORT, spawn=where == "spawn")
    if where.endswith(".rrd"):
        return Destination(file=Path(where))
    raise HeliTwinError(f"'{where}' is no place for pictures: give spawn, connect, or a file that ends in .rrd")


class ShownFlights(NamedTuple):
    """One or two flights to show, with what they need to be shown."""

    logs: Sequence[Log]
    experiments: Sequence[Experiment]
    names: Sequence[str]
    ghost: str = ""
    """What predicted the second flight; empty if it was flown."""
    requirements: tuple[Requirement, ...] = ()
    """By which they are judged, a predicted one excepted."""

    @property
    def duration(self) -> float:
        """The longer flight's, s."""
        return 1e-9 * max(int(log.truth.time[-1]) if len(log.truth.time) else 0 for log in map(with_truth, self.logs))

    def show(self, where: Destination, tab: str = "") -> None:
        """Show one, or two in one scene, with the plots of a tab in front.

        Raises:
            LogError: No viewer listens or answers, or the file cannot be written.
        """
        flights = [
            ComparedFlight(with_truth(log), scales_of(experiment).for_source(log), name, found=self._judged(log))
            for log, experiment, name in zip(self.logs, self.experiments, self.names, strict=True)
        ]
        first, *others = flights
        if others:
            predicted = [("poses", "flown", f"predicted by {self.ghost}")] if self.ghost else None
            rival = others[0]._replace(is_ghost=bool(self.ghost))
            show_both(first, rival, predicted or differences(*self.experiments), where, tab)
        else:
            show(first.log, where, first.scales, tab, first.found)

    def _judged(self, log: Log) -> Sequence[Judged]:
        is_predicted = bool(self.ghost) and log is not self.logs[0]
        return judged(self.requirements, log) if self.requirements and not is_predicted else ()


class ShownShips(NamedTuple):
    """Several helicopters that flew in one room, to show."""

    log: Log

    @property
    def duration(self) -> float:
        """The longest flight's, s."""
        return 1e-9 * self.log.ending.time

    def show(self, where: Destination, tab: str = "") -> None:
        """Show all in one scene, with the plots of a tab in front.

        Raises:
            LogError: No viewer listens or answers, or the file cannot be written.
        """
        ships = {name: viewed_experiment(self.log.ship(name)) for name in self.log.ships}
        show_ships(self.log, {name: (e, scales_of(e)) for name, e in ships.items()}, where, tab)


Shown = ShownFlights | ShownShips


def flights(paths: Sequence[Path], requirements: str | None = None) -> Shown:
    """Read logs to show.

    Args:
        paths: Of one or two logs.
        requirements: A file, or the name of a shipped one; None for none.

    Raises:
        LogError: A log cannot be read.
        RequirementError: The requirements cannot be read.
        ExperimentError: It was flown by another version, whose experiment this one does not know.
    """
    required = () if requirements is None else requirements_of(requirements)
    logs = [read_log(path) for path in paths]
    if len(logs) == 1 and logs[0].ships:
        if required:
            raise HeliTwinError(f"--require is for one helicopter: give {paths[0]}#{next(iter(logs[0].ships))}")
        return ShownShips(logs[0])
    names = [path.name for path in paths]
    return ShownFlights(logs, [viewed_experiment(log) for log in logs], names, requirements=required)


def with_truth(log: Log) -> Log:
    """A log without truth, such as an import, with the poses of the cameras in its place; any other log as it is."""
    if len(log.truth.time) or not len(log.pose.time):
        return log
    stamps, first = np.unique(log.pose.stamp, return_index=True)
    position, quat_wxyz = log.pose.position[first], log.pose.quat_wxyz[first]
    yaw = np.unwrap(yaw_of(quat_wxyz))
    velocity = np.gradient(position, 1e-9 * stamps, axis=0) if len(stamps) > 1 else np.zeros_like(position)
    unknown = np.zeros(4)
    data = LAYOUTS["/truth"].pack(
        [
            (t, position[i], quat_wxyz[i], velocity[i], unknown[:3], yaw[i], 0.0, unknown, False)
            for i, t in enumerate(stamps.tolist())
        ]
    )
    return replace(log, messages={**log.messages, "/truth": Messages(stamps.tolist(), data)})


@contextmanager
def in_browser(shown: Shown, port: int, tab: str = "") -> Generator[subprocess.Popen[bytes]]:
    """Serve flights to browsers while the block lasts, from this machine to this machine alone.

    Args:
        shown: What to show.
        port: Of the page, see `web_address`; the data have the next one.
        tab: Name of the plots in front; empty for the first.

    Raises:
        LogError: A port is taken, or the server failed.
    """
    with TemporaryDirectory() as folder:
        file = Path(folder) / "flights.rrd"
        shown.show(Destination(file=file), tab)
        with web_viewer(str(file), port) as server:
            yield server


def snapshot(shown: Shown, file: Path, at: float | None, size: tuple[int, int], tab: str = "") -> None:
    """Write a picture of flights at one moment, without a screen.

    Args:
        shown: What to show.
        file: `NAME.png`, written whole or not at all.
        at: Simulated time, s; None for the end.
        size: Width and height, pixels.
        tab: Name of the plots in front; empty for the first.

    Raises:
        HeliTwinError: There is no such moment or tab, nothing to draw with, or the file cannot be written.
    """
    if file.suffix != ".png":
        raise HeliTwinError(f"cannot write {file}: give the picture a name that ends in .png")
    end = shown.duration
    at = end if at is None else at
    if not 0 <= at <= end:
        raise HeliTwinError(f"nothing was recorded at {at:g} s: give --at a time from 0 to {end:g} s")
    png = picture(lambda port: shown.show(Destination(port=port), tab), at, size)
    try:
        write_whole(file, png)
    except OSError as error:
        raise HeliTwinError(f"cannot write {file}: {error.strerror}") from None
