"""A flight in Rerun: the same picture from a finished log and while it flies.

Only this module and the layout import Rerun, and nothing imports them before a viewer is asked for. A viewer that is
missing, or that dies, costs its pictures and nothing else.
"""

import logging
import socket
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import rerun as rr

from controllers.signals import Array
from heli_twin.recording.layout import CONTACT, INPUTS, POSITIONS, TIMELINE, Scales, layout, send_static
from heli_twin.recording.log import Log, Messages, Times
from heli_twin.recording.schema import LogError

APPLICATION = "heli_twin"
HOST = "127.0.0.1"
SLICE = 500_000_000
"""Simulated ns that are sent at once while flying."""
TRAIL_STEP = 0.02
"""Length in time of one piece of the flown trail, s: one control period."""
WIND_ARROW = 0.1
"""Length of the wind's arrow, m per m/s."""
ROTOR_RATE = 1.7
"""How fast the drawn rotors turn, rev/s: slow enough to see which way."""

_LOGGER = logging.getLogger(__name__)

Rows = tuple[str, Times, Iterable[rr.ComponentColumn]]
"""Entity, times (n,) and columns of n rows."""


class Sink(NamedTuple):
    """Where pictures go: to a file, to a viewer on this machine, or to both."""

    file: Path | None = None
    """`NAME.rrd`."""
    port: int | None = None
    """Of the viewer."""
    spawn: bool = False
    """Whether to start a viewer if none listens."""


def show(log: Log, sink: Sink, scales: Scales) -> None:
    """Show a whole flight.

    Raises:
        LogError: No viewer listens, or the file cannot be written.
    """
    if scales.path is None and log.reference_paths:
        scales = scales._replace(path=log.reference_paths[0][1])
    stream = _open(sink, scales)
    if stream is None:
        raise LogError(f"no viewer listens on port {sink.port}: start one with `rerun --port {sink.port}`")
    send(stream, log, scales)
    _close(stream)


class Live:
    """A listener of the recorder that shows the flight while it lasts, slice by slice.

    Whatever goes wrong with the picture is told once, and the flight goes on.
    """

    def __init__(self, sink: Sink, scales: Scales) -> None:
        """Open the pictures; without a viewer there are none.

        Raises:
            LogError: The file cannot be written.
        """
        self._scales = scales
        self._stream = _open(sink, scales)
        self._slice: dict[str, tuple[list[int], list[bytes]]] = {}
        self._due = SLICE

    def __call__(self, topic: str, t: int, data: bytes) -> None:
        """Take a message of the flight."""
        if t >= self._due:
            self._due = (t // SLICE + 1) * SLICE
            self._send()
        times, messages = self._slice.setdefault(topic, ([], []))
        times.append(t)
        messages.append(data)

    def close(self) -> None:
        """Show the rest."""
        self._send()
        if self._stream is not None:
            _close(self._stream)

    def _send(self) -> None:
        taken, self._slice = self._slice, {}
        if self._stream is None:
            return
        try:
            send(self._stream, Log({topic: Messages(*columns) for topic, columns in taken.items()}), self._scales)
        except Exception:
            _LOGGER.exception("the flight goes on without its picture")
            self._stream = None


def send(stream: rr.RecordingStream, log: Log, scales: Scales) -> None:
    """Send a log or a slice of one."""
    for entity, times, columns in (*_scene(log), *_plots(log, scales)):
        if len(times):
            stream.send_columns(entity, [rr.TimeColumn(TIMELINE, duration=times.astype("m8[ns]"))], columns)


def _scene(log: Log) -> Iterator[Rows]:
    truth, reference, plan = log.truth, log.reference, log.plan
    xyzw = [1, 2, 3, 0]
    yield (
        "world/helicopter",
        truth.time,
        rr.Transform3D.columns(translation=truth.position, quaternion=truth.quat_wxyz[:, xyzw]),
    )
    half_turn = np.pi * ROTOR_RATE * 1e-9 * truth.time
    for name, half_angle in ("rotor_lower", half_turn), ("rotor_upper", -half_turn):
        zero = np.zeros_like(half_angle)
        spin = np.stack([zero, zero, np.sin(half_angle), np.cos(half_angle)], axis=1)
        yield f"world/helicopter/{name}", truth.time, rr.Transform3D.columns(quaternion=spin)
    half_step = 0.5 * TRAIL_STEP * truth.velocity
    pieces = np.stack([truth.position - half_step, truth.position + half_step], axis=1)
    yield "world/trail", truth.time, rr.LineStrips3D.columns(strips=pieces.astype(np.float32))
    floor = truth.position * [1.0, 1.0, 0.0]
    plumb_line = np.stack([truth.position, floor], axis=1).astype(np.float32)
    yield "world/plumb_line", truth.time, rr.LineStrips3D.columns(strips=plumb_line)
    both, here, blowing = np.intersect1d(truth.time, log.disturbance.time, return_indices=True)
    wind = rr.Arrows3D.columns(origins=truth.position[here], vectors=WIND_ARROW * log.disturbance.wind[blowing])
    yield "world/wind", both, wind
    for t, points in log.reference_paths:
        yield "world/reference_path", np.array([t]), rr.LineStrips3D.columns(strips=points[None].astype(np.float32))
    yield "world/reference", reference.time, rr.Points3D.columns(positions=reference.x[:, :3])
    yield "world/horizon", plan.time, rr.LineStrips3D.columns(strips=plan.x[:, :, :3])
    yield "world/mocap", log.pose.time, rr.Points3D.columns(positions=log.pose.position)


def _plots(log: Log, scales: Scales) -> Iterator[Rows]:
    truth, reference, estimate, pose = log.truth, log.reference, log.estimate, log.pose
    true_x = np.column_stack([truth.position, truth.yaw])
    both, now, wanted = np.intersect1d(truth.time, reference.time, return_indices=True)
    error = true_x[now] - reference.x[wanted, :4]
    yield "error/position", both, _scalars(100 * error[:, :3])
    yield "error/yaw", both, _scalars((np.degrees(error[:, 3]) + 180) % 360 - 180)
    unit = np.array([1, 1, 1, 180 / np.pi])
    for i, name in enumerate(POSITIONS):
        yield f"position/{name}/truth", truth.time, _scalars(unit[i] * true_x[:, i])
        yield f"position/{name}/reference", reference.time, _scalars(unit[i] * reference.x[:, i])
        yield f"position/{name}/estimate", estimate.stamp, _scalars(unit[i] * estimate.x[:, i])
        if name != "yaw":
            yield f"position/{name}/mocap", pose.stamp, _scalars(pose.position[:, i])
    yield "input/all", log.sent.time, _scalars(log.sent.u)
    for i, name in enumerate(INPUTS):
        yield f"input/{name}/sent", log.sent.time, _scalars(log.sent.u[:, i])
        yield f"input/{name}/acting", log.acting.time, _scalars(log.acting.u[:, i])
        limits = np.tile([scales.u_min[i], scales.u_max[i]], (len(log.sent.time), 1))
        yield f"input/{name}/limits", log.sent.time, _scalars(limits)
    yield from _computing(log, scales)


def _computing(log: Log, scales: Scales) -> Iterator[Rows]:
    timing, air = log.timing, log.disturbance
    deadline = np.full(len(timing.time), 1e9 * scales.period)
    yield (
        "computing",
        timing.time,
        _scalars(1e-6 * np.stack([timing.control_step_ns, timing.solve_ns, deadline], axis=1)),
    )
    yield "air/wind", air.time, _scalars(air.wind)
    yield "air/push", air.time, _scalars(air.acceleration)
    yield "air/thrust", air.time, _scalars(air.thrust_factor)
    yield "state/controller", log.qp.time, rr.StateChange.columns(state=log.qp.status.tolist())
    in_the_air, on_the_floor = CONTACT
    contact = np.where(log.truth.touching, on_the_floor, in_the_air).tolist()
    yield "state/contact", log.truth.time, rr.StateChange.columns(state=contact)
    times = np.array([event.time for event in log.events], np.int64)
    text = [f"{event.name}: {event.text}" for event in log.events]
    level = [_LEVELS[event.severity] for event in log.events]
    yield "events", times, rr.TextLog.columns(text=text, level=level)


_LEVELS = {
    "unknown": "TRACE",
    "debug": "DEBUG",
    "info": "INFO",
    "warning": "WARN",
    "error": "ERROR",
    "fatal": "CRITICAL",
}
"""Our severities as Rerun calls them."""


def _scalars(values: Array) -> rr.ComponentColumnList:
    """One row of numbers a moment, (n,) or (n, k)."""
    columns = rr.Scalars.columns(scalars=values.ravel())
    return columns if values.ndim == 1 else columns.partition([values.shape[1]] * len(values))


def _open(sink: Sink, scales: Scales) -> rr.RecordingStream | None:
    """A stream to all of the sink that is there; None if nothing is."""
    sinks: list[rr.FileSink | rr.GrpcSink] = []
    if sink.file is not None:
        sinks.append(rr.FileSink(str(sink.file)))
    if sink.port is not None and (_listens(sink.port) or (sink.spawn and _spawn(sink.port))):
        sinks.append(rr.GrpcSink(f"rerun+http://{HOST}:{sink.port}/proxy"))
    if not sinks:
        return None
    stream = rr.RecordingStream(APPLICATION)
    try:
        stream.set_sinks(*sinks, default_blueprint=layout(scales))
    except RuntimeError as error:
        raise LogError(f"pictures cannot be written to {sink.file}: {error}") from error
    send_static(stream)
    return stream


def _listens(port: int) -> bool:
    try:
        with socket.create_connection((HOST, port), timeout=0.2):
            return True
    except OSError:
        return False


def _spawn(port: int) -> bool:
    """Start a viewer of its own that only this machine can reach, and wait until it listens."""
    command = [sys.executable, "-m", "rerun", "--port", str(port), "--bind", HOST, "--expect-data-soon"]
    viewer = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)
    deadline = time.monotonic() + 15
    while time.monotonic() < deadline and viewer.poll() is None:
        if _listens(port):
            return True
        time.sleep(0.1)
    return False


def _close(stream: rr.RecordingStream) -> None:
    """Wait until everything is delivered, but not for a viewer that has died."""
    try:
        stream.flush(timeout_sec=5)
    except RuntimeError as error:
        _LOGGER.warning("the viewer is gone, its picture is incomplete: %s", error)
    stream.disconnect()
