"""A motion-capture recording of a real flight as a log, for replay, estimation and identification.

There is no truth in such a log, and no reference unless a trajectory is given: what needs them says so.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from controllers.reference import ReferencePreview
from controllers.signals import Command, Pose, nanoseconds
from controllers.trajectories.hover import Hover
from heli_twin.exchange.pose_csv import Column, ImportRefused, Recording, read_recording
from heli_twin.experiment import Experiment
from heli_twin.experiment.text import load
from heli_twin.logbook import ORIGIN, begin_log, planned_path
from heli_twin.recording import LogError, Recorder


def import_poses(path: Path, columns: Mapping[str, Column], out: Path, overrides: Sequence[str] = ()) -> Recording:
    """Write a recording as a log: its poses, its commands, and what the estimator makes of them.

    Args:
        path: The CSV file.
        columns: See `read_recording`.
        out: Where the log shall be, `NAME.mcap`.
        overrides: What is known of that flight, `path.to.field=value`: `controller.model.*`, `estimator.*`,
            `mocap.latency`, `trajectory.*`; without a trajectory it hovers where the recording starts.

    Raises:
        HeliTwinError: The file cannot be imported or the log cannot be written.
    """
    fields = {text.partition("=")[0].strip().split(".")[0] for text in overrides}
    if out.suffix != ".mcap":
        raise LogError(f"the log cannot be called {out}: give it a name that ends in .mcap")
    if "duration" in fields:
        raise ImportRefused("duration follows from the recording: leave it out")
    experiment = load(None, overrides)
    recording = read_recording(path, columns, getattr(experiment.mocap, "latency", 0.0))
    end = int(max(recording.arrival[-1], recording.command_time.max(initial=0)))
    planned = "trajectory" in fields
    if not planned:
        x, y, z = recording.position[0].tolist()
        experiment = replace(experiment, trajectory=Hover(x=x, y=y, height=max(z, 0.01)))
    experiment = replace(experiment, duration=max(end / 1e9, experiment.controller.period))
    recorder = begin_log(out, experiment, metadata={ORIGIN: "import", "source": path.name})
    with recorder, threadpool_limits(limits=1):
        recorder.event(0, "info", "import", f"{len(recording.stamp)} poses, {recording.lost} rows without one")
        if planned:
            recorder.reference_path(0, planned_path(experiment))
        refused = _estimate(recording, experiment, recorder, end, planned)
        recorder.close("imported", end, text=f"{1e-9 * end:.2f} s of poses from {path.name}")
    if recorder.trouble:
        raise LogError(recorder.trouble)
    return recording._replace(refused=refused)


def _estimate(recording: Recording, experiment: Experiment, recorder: Recorder, end: int, planned: bool) -> int:
    """Record poses, commands and, at control steps, estimates and the plan, in the order in which they were known.

    Returns:
        How many poses the estimator refused.
    """
    law = experiment.controller
    period = nanoseconds(law.period)
    estimator = experiment.estimator.start(law.model)
    preview = ReferencePreview(experiment.trajectory, law.model, period, 0)
    refused = 0
    times = (recording.arrival, np.arange(0, end + 1, period), recording.command_time)
    # At one time: poses first, then the control step, then the command.
    moments = [(int(t), rank, i) for rank, column in enumerate(times) for i, t in enumerate(column)]
    for t, rank, i in sorted(moments):
        if rank == 0:
            pose = Pose(int(recording.stamp[i]), recording.position[i], recording.quat_wxyz[i])
            recorder.pose(t, pose)
            estimator.receive(t, pose)
        elif rank == 1:
            if planned:
                recorder.reference(t, preview(t, 1))
            estimate = estimator.estimate(t)
            if estimate is not None:
                recorder.estimate(t, estimate)
                refused = estimate.rejected
        else:
            recorder.sent(t, Command(t, recording.u[i]))
            estimator.command_sent(t, recording.u[i])
    return refused
