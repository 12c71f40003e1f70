"""A motion-capture recording of a real flight as a log, for replay, estimation and identification.

There is no truth in such a log, and no reference unless a trajectory is given: what needs them says so.
"""

import heapq
from collections.abc import Sequence
from dataclasses import replace
from itertools import count, repeat
from pathlib import Path
from typing import NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from controllers.reference import ReferencePreview
from controllers.signals import Array, Command, Pose, nanoseconds
from controllers.trajectories.hover import Hover
from heli_twin.exchange.cleaning import Blemish, Clean, clean
from heli_twin.exchange.commands_file import with_commands
from heli_twin.exchange.formats import Format, ImportRefused, Options, Take, formats, head_of
from heli_twin.exchange.frames import FRAMES, LENGTH_UNITS_M
from heli_twin.exchange.plausibility import check_plausible
from heli_twin.experiment import Experiment
from heli_twin.experiment.text import assignment, load
from heli_twin.logbook import begin_log, planned_path
from heli_twin.recording import LogError, Recorder
from heli_twin.recording.log import Times
from heli_twin.recording.records import ORIGIN_KEY
from heli_twin.terminal_text import instead


class Reading(NamedTuple):
    """Instructions for reading a recording, beyond the contents of its file."""

    options: Options = Options()
    frame: str = ""
    """Axes, a key of `FRAMES`; empty for the file's own, or z up."""
    unit: str = ""
    """Of lengths, a key of `LENGTH_UNITS_M`; empty for the file's own, or metres."""
    rate: float = 0.0
    """Hz, where the time column counts frames."""
    is_checked: bool = True
    """Refuse a recording that cannot be of a helicopter in a room."""
    commands: Path | None = None
    """A file with the sent commands, where the recording has none."""


AS_EXPORTED = Reading()
"""The file says everything."""


class Imported(NamedTuple):
    """A recording that has become a log."""

    take: Take
    recording: Clean
    refused: int
    """Poses that the estimator took for outliers."""

    @property
    def blemishes(self) -> tuple[Blemish, ...]:
        """Everything that was wrong with the recording."""
        return self.recording.blemishes


def import_poses(path: Path, out: Path, reading: Reading = AS_EXPORTED, overrides: Sequence[str] = ()) -> Imported:
    """Write a recording as a log: its poses, its commands, and what the estimator makes of them.

    Args:
        path: The recording, in any of `formats`.
        out: Where the log shall be, `NAME.mcap`.
        reading: How to read it.
        overrides: What is known of that flight, `path.to.field=value`: `controller.model.*`, `estimator.*`,
            `mocap.latency`, `trajectory.*`; without a trajectory it hovers where the recording starts.

    Raises:
        HeliTwinError: The file cannot be imported or the log cannot be written.
    """
    fields = {assignment(text)[0].split(".")[0] for text in overrides}
    if out.suffix != ".mcap":
        raise LogError(f"the log cannot be called {out}: give it a name that ends in .mcap")
    if "duration" in fields:
        raise ImportRefused("duration follows from the recording: leave it out")
    experiment = load(None, overrides)
    take, recording = read_recording(path, reading)
    wires = _Wires.of(recording, nanoseconds(getattr(experiment.mocap, "latency", 0.0)))
    if "trajectory" not in fields:
        x, y, z = recording.position[0].tolist()
        experiment = replace(experiment, trajectory=Hover(x=x, y=y, height=max(z, 0.01)))
    experiment = replace(experiment, duration=max(wires.end / 1e9, experiment.controller.period))
    is_planned = "trajectory" in fields
    recorder = begin_log(out, experiment, metadata={ORIGIN_KEY: "import", "source": path.name, "format": take.title})
    with recorder, threadpool_limits(limits=1):
        told = f"{len(wires.stamp)} poses of {take.title}, {recording.lost} rows without one"
        recorder.event(0, "info", "import", told)
        for blemish in sorted(recording.blemishes, key=lambda blemish: blemish.first_s):
            recorder.event(nanoseconds(blemish.first_s), "warning", blemish.name, f"{blemish.rows} {blemish.text}")
        if is_planned:
            recorder.reference_path(0, planned_path(experiment))
        refused = _estimate(wires, experiment, recorder, is_planned)
        recorder.close("imported", wires.end, text=f"{1e-9 * wires.end:.2f} s of poses from {path.name}")
    if recorder.trouble:
        raise LogError(recorder.trouble)
    return Imported(take, recording, refused)


def recognised(path: Path) -> Format:
    """The format of a file, by its content.

    Raises:
        ImportRefused: It cannot be opened, or is of no format that is read here.
    """
    head = head_of(path)
    for member in formats().values():
        if member.recognises(head):
            return member
    titles = ", ".join(member.TITLE for member in formats().values())
    raise ImportRefused(f"{path} is no recording that can be read: it has to be one of {titles}")


def read_recording(path: Path, reading: Reading) -> tuple[Take, Clean]:
    """A recording as its file has it, and cleaned in our axes.

    Raises:
        ImportRefused: One sentence that names the file and what would be right.
    """
    for value, known, flag in ((reading.frame, FRAMES, "--frame"), (reading.unit, LENGTH_UNITS_M, "--units")):
        if value and value not in known:
            raise ImportRefused(f"{flag} {instead(value, known)}")
    take = recognised(path).read(path, reading.options)
    try:
        recording = clean(take, frame=reading.frame, unit=reading.unit, rate=reading.rate)
        if reading.is_checked:
            check_plausible(take, recording, reading.frame, reading.unit, reading.rate)
    except ImportRefused as error:
        raise ImportRefused(f"{path}: {error}") from None
    return take, with_commands(recording, reading.commands) if reading.commands else recording


class _Wires(NamedTuple):
    """A recording as it crosses the wires: times in ns from its first row on, poses in the order of their arrival."""

    arrival: Times
    stamp: Times
    position: Array
    quat_wxyz: Array
    command_time: Times
    u: Array
    end: int

    @classmethod
    def of(cls, recording: Clean, latency: int) -> "_Wires":
        """The wires of a recording; `latency` ns from the picture to the ground station where the file tells none."""
        stamp, command_time = _ns(recording.time), _ns(recording.command_time)
        told = np.isfinite(recording.arrival)
        arrival = np.where(told, _ns(np.where(told, recording.arrival, 0.0)), stamp + latency)
        arrival = np.maximum(arrival, stamp)
        order = np.argsort(arrival, kind="stable")
        end = int(max(arrival.max(), command_time.max(initial=0)))
        return cls(
            arrival[order],
            stamp[order],
            recording.position[order],
            recording.quat_wxyz[order],
            command_time,
            recording.u,
            end,
        )


def _ns(seconds: Array) -> Times:
    return np.round(1e9 * seconds).astype(np.int64)


def _estimate(wires: _Wires, experiment: Experiment, recorder: Recorder, is_planned: bool) -> int:
    """Record poses, commands and, at control steps, estimates and the plan, in the order in which they were known.

    An input that the recording does not have is NaN in the log; the estimator takes it to be at hover.

    Returns:
        How many poses the estimator refused.
    """
    law = experiment.controller
    period = nanoseconds(law.period)
    estimator = experiment.estimator.start(law.model)
    preview = ReferencePreview(experiment.trajectory, law.model, period, 0)
    refused = 0
    times = (wires.arrival, range(0, wires.end + 1, period), wires.command_time)
    # At equal times: poses first, then the control step, then the command.
    moments = heapq.merge(*(zip(map(int, column), repeat(rank), count()) for rank, column in enumerate(times)))
    for t, rank, i in moments:
        if rank == 0:
            pose = Pose(int(wires.stamp[i]), wires.position[i], wires.quat_wxyz[i])
            recorder.pose(t, pose)
            estimator.receive(t, pose)
        elif rank == 1:
            if is_planned:
                recorder.reference(t, preview(t, 1))
            estimate = estimator.estimate(t)
            if estimate is not None:
                recorder.estimate(t, estimate)
                refused = estimate.rejected
        else:
            u = wires.u[i]
            recorder.sent(t, Command(t, u))
            estimator.command_sent(t, np.where(np.isfinite(u), u, law.model.u_hover))
    return refused
