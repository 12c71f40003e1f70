"""Topics for viewers that know nothing of heli_twin: a URDF that moves, point clouds and plots.

Rerun, Foxglove and PlotJuggler show the helicopter, its path and its plan from the log alone. These topics are computed
from the others at a lower rate, so they cost little.
"""

import struct
from collections.abc import Iterator, Sequence
from math import cos, isfinite, nan, sin

import numpy as np
from google.protobuf.timestamp_pb2 import Timestamp

from controllers.rotations import wrap_angle
from controllers.signals import Array
from heli_twin.lab.plant.shape import Primitive
from heli_twin.recording import cdr
from heli_twin.recording.foxglove import FrameTransform, PackedElementField, PointCloud, Pose, Quaternion, Vector3
from heli_twin.recording.packing import Layout
from heli_twin.recording.schema import FRAME, LAYOUTS
from heli_twin.recording.shape import urdf

BODY = "helicopter"
"""Name of the body's frame and of the URDF's only moving link."""

WANTED, PLANNED = 0xD8DCE3FF, 0xFFA62BFF
"""Colours of the reference and the plan, RGBA."""

_AXES = cdr.JointStates("x / pitch", "y / roll", "z / thrust", "yaw")

_MILLISECOND = 1_000_000  # ns
TF_PERIOD_NS, HORIZON_PERIOD_NS, PLOT_PERIOD_NS = 40 * _MILLISECOND, 100 * _MILLISECOND, 60 * _MILLISECOND
"""Least simulated time between two messages."""

Timed = tuple[str, int, bytes]
"""Topic, log time (ns) and bytes of a message."""


class Viewers:
    """Computes the messages for viewers from those of the other topics.

    Message objects are reused: protobuf takes five times as long to make a new one as to serialise it.
    """

    def __init__(self, shape: Sequence[Primitive] = (), name: str = "") -> None:
        """Begin a flight.

        Args:
            shape: Of the helicopter; empty for the mCX2.
            name: Of the helicopter, if it is one of several: its frame is `NAME/helicopter`.
        """
        body = f"{name}/{BODY}".lstrip("/")
        self._urdf = urdf(body, FRAME, tuple(shape))
        self._tf_due = self._horizon_due = self._plot_due = 0
        self._truth = self._reference = b""
        self._transform = FrameTransform(parent_frame_id=FRAME, child_frame_id=body)
        pose = Pose(position=Vector3(), orientation=Quaternion(w=1.0))
        self._cloud = PointCloud(frame_id=FRAME, pose=pose, point_stride=_POINT.itemsize, fields=_FIELDS)
        self.plan: Layout | None = None
        """The layout of this flight's plans; None before the first plan."""

    def description(self) -> Timed:
        """The message with the URDF of the helicopter."""
        return "/robot_description", 0, cdr.string(self._urdf)

    def reference_path(self, t: int, points: Array) -> Timed:
        """The message with the whole reference path, (n, 3) world, m."""
        return "/view/reference_path", t, _drawn(self._cloud, t, points, WANTED)

    def messages(self, batch: Sequence[Timed]) -> Iterator[Timed]:
        """The messages for viewers that follow from the next messages of a flight."""
        for topic, t, data in batch:
            if topic == "/truth":
                self._truth = data
            # The log of a real flight has no truth: there the cameras' pose stands for it.
            if t >= self._tf_due and (topic == "/truth" or (topic == "/mocap/pose" and not self._truth)):
                self._tf_due = t + TF_PERIOD_NS
                yield "/tf", t, _moved(self._transform, t, topic, data)
            elif topic == "/reference":
                self._reference = data
            elif topic == "/command/sent":
                if self._truth and self._reference and t >= self._plot_due:
                    self._plot_due = t + PLOT_PERIOD_NS
                    yield "/view/error_and_input", t, _error_and_input(t, self._truth, self._reference, data)
            elif topic == "/mpc/plan" and self.plan and t >= self._horizon_due:
                self._horizon_due = t + HORIZON_PERIOD_NS
                (plan,) = np.frombuffer(data, self.plan.dtype)
                yield "/view/horizon", t, _drawn(self._cloud, t, plan["x"][:, :3], PLANNED)


def _doubles(topic: str, *names: str) -> struct.Struct:
    """A struct that reads these fields of a topic's messages, all doubles, in the order of the message."""
    form, at = "<", 0
    for name, (kind, offset, *_) in (LAYOUTS[topic].dtype.fields or {}).items():
        if name in names:
            form += f"{offset - at}x{kind.itemsize // 8}d"
            at = offset + kind.itemsize
    return struct.Struct(form)


_PLACE = {topic: _doubles(topic, "position", "quat_wxyz") for topic in ("/truth", "/mocap/pose")}
_MOTION = _doubles("/truth", "position", "velocity", "yaw", "yaw_rate")
_WANTED = _doubles("/reference", "x")
_SENT = _doubles("/command/sent", "u")


def _moved(message: FrameTransform, t: int, topic: str, data: bytes) -> bytes:
    """The serialised pose of the body."""
    _stamp(message.timestamp, t)
    place, turn = message.translation, message.rotation
    place.x, place.y, place.z, turn.w, turn.x, turn.y, turn.z = _PLACE[topic].unpack_from(data)
    return message.SerializeToString()


def _error_and_input(t: int, truth: bytes, reference: bytes, command: bytes) -> bytes:
    """Joint states of x y z yaw: errors in position and velocity (yaw frame), and the inputs as effort."""
    x, y, z, vx, vy, vz, yaw, rate = _MOTION.unpack_from(truth)
    # A flight that diverged may have any yaw.
    c, s = (cos(yaw), sin(yaw)) if isfinite(yaw) else (nan, nan)
    state = (x, y, z, yaw, c * vx + s * vy, c * vy - s * vx, vz, rate)
    error = [real - wanted for real, wanted in zip(state, _WANTED.unpack_from(reference), strict=True)]
    error[3] = wrap_angle(error[3])
    return _AXES.pack(t, error[:4], error[4:], _SENT.unpack_from(command))


def timestamp(t: int) -> Timestamp:
    """Simulated time (ns) as a protobuf message."""
    return _stamp(Timestamp(), t)


def _stamp(stamp: Timestamp, t: int) -> Timestamp:
    stamp.seconds, stamp.nanos = divmod(t, 1_000_000_000)
    return stamp


_FLOAT32, _UINT8 = PackedElementField.NumericType.FLOAT32, PackedElementField.NumericType.UINT8
_FIELDS = [
    *(PackedElementField(name=axis, offset=4 * i, type=_FLOAT32) for i, axis in enumerate("xyz")),
    *(
        PackedElementField(name=name, offset=12 + i, type=_UINT8)
        for i, name in enumerate(("red", "green", "blue", "alpha"))
    ),
]
_POINT = np.dtype([("position", "<f4", 3), ("colour", ">u4")])


def _drawn(message: PointCloud, t: int, points: Array, colour: int) -> bytes:
    """A serialised cloud of points (n, 3), world, m. `message` is a cloud without points."""
    coloured = np.empty(len(points), _POINT)
    coloured["position"], coloured["colour"] = points, colour
    _stamp(message.timestamp, t)
    # A message never frees the memory of its fields, so the points, its last field, are appended as bytes.
    return message.SerializeToString() + PointCloud(data=coloured.tobytes()).SerializeToString()
