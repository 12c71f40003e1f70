"""The flight once more for viewers that know nothing of heli_twin: a URDF that moves, point clouds and plots.

Opened in Rerun, Foxglove or PlotJuggler the bare log shows the helicopter, its path and its plan. All of it follows
from the wires and is thinned out, so it costs little.
"""

import struct
from collections.abc import Iterator, Sequence
from math import cos, isfinite, nan, pi, sin

import numpy as np
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.timestamp_pb2 import Timestamp

from controllers.signals import Array
from heli_twin.recording import cdr
from heli_twin.recording.packing import Layout
from heli_twin.recording.schema import FRAME, LAYOUTS
from heli_twin.recording.shape import urdf

BODY = "helicopter"
"""Name of the body's frame and of the URDF's only moving link."""
_URDF = urdf(BODY, FRAME)

WANTED, PLANNED = 0xD8DCE3FF, 0xFFA62BFF
"""Colours of the reference and the plan, RGBA."""

_AXES = cdr.JointStates("x / pitch", "y / roll", "z / thrust", "yaw")

_MILLISECOND = 1_000_000
TF_PERIOD, HORIZON_PERIOD, PLOT_PERIOD = 40 * _MILLISECOND, 100 * _MILLISECOND, 60 * _MILLISECOND
"""Least simulated time between two messages, ns."""

Timed = tuple[str, int, bytes]
"""Topic, log time (ns) and bytes of a message."""


class Viewers:
    """Derives what viewers draw from the messages of the wires.

    Messages are used again, since making a new one takes protobuf five times as long as writing it.
    """

    def __init__(self) -> None:
        self._tf_due = self._horizon_due = self._plot_due = 0
        self._truth = self._reference = b""
        self._transform = FrameTransform(parent_frame_id=FRAME, child_frame_id=BODY)
        pose = Pose(position=Vector3(), orientation=Quaternion(w=1.0))
        self._cloud = PointCloud(frame_id=FRAME, pose=pose, point_stride=_POINT.itemsize, fields=_FIELDS)
        self.plan: Layout | None = None
        """How the plans of this flight are packed, once there is one."""

    def description(self) -> Timed:
        """The helicopter, before anything moves."""
        return "/robot_description", 0, cdr.string(_URDF)

    def reference_path(self, t: int, points: Array) -> Timed:
        """The whole path to fly, (n, 3) world, m."""
        return "/view/reference_path", t, _drawn(self._cloud, t, points, WANTED)

    def messages(self, batch: Sequence[Timed]) -> Iterator[Timed]:
        """What there is to draw of the next messages of a flight."""
        for topic, t, data in batch:
            if topic == "/truth":
                self._truth = data
            # Where nobody knows the truth, as of a real flight, the cameras say where the helicopter is.
            if t >= self._tf_due and (topic == "/truth" or (topic == "/mocap/pose" and not self._truth)):
                self._tf_due = t + TF_PERIOD
                yield "/tf", t, _moved(self._transform, t, topic, data)
            elif topic == "/reference":
                self._reference = data
            elif topic == "/command/sent":
                if self._truth and self._reference and t >= self._plot_due:
                    self._plot_due = t + PLOT_PERIOD
                    yield "/view/error_and_input", t, _error_and_input(t, self._truth, self._reference, data)
            elif topic == "/mpc/plan" and self.plan and t >= self._horizon_due:
                self._horizon_due = t + HORIZON_PERIOD
                (plan,) = np.frombuffer(data, self.plan.dtype)
                yield "/view/horizon", t, _drawn(self._cloud, t, plan["x"][:, :3], PLANNED)


def _doubles(topic: str, *names: str) -> struct.Struct:
    """Reads some fields of a topic's messages, all doubles, in the order in which they lie there."""
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
    """Where the body is."""
    _stamp(message.timestamp, t)
    place, turn = message.translation, message.rotation
    place.x, place.y, place.z, turn.w, turn.x, turn.y, turn.z = _PLACE[topic].unpack_from(data)
    return message.SerializeToString()


def _error_and_input(t: int, truth: bytes, reference: bytes, command: bytes) -> bytes:
    """As joints: the error in position and velocity (yaw frame) of x y z yaw, and as effort the inputs."""
    x, y, z, vx, vy, vz, yaw, rate = _MOTION.unpack_from(truth)
    # A flight that diverged may have any yaw.
    c, s = (cos(yaw), sin(yaw)) if isfinite(yaw) else (nan, nan)
    state = (x, y, z, yaw, c * vx + s * vy, c * vy - s * vx, vz, rate)
    off = [real - wanted for real, wanted in zip(state, _WANTED.unpack_from(reference), strict=True)]
    off[3] = (off[3] + pi) % (2 * pi) - pi
    return _AXES.pack(t, off[:4], off[4:], _SENT.unpack_from(command))


def timestamp(t: int) -> Timestamp:
    """Simulated time as protobuf writes it."""
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
    """A cloud of points (n, 3), world, m; the message is one without any."""
    coloured = np.empty(len(points), _POINT)
    coloured["position"], coloured["colour"] = points, colour
    _stamp(message.timestamp, t)
    # What was once put into a message stays in its memory as long as it lives. The points are its last field.
    return message.SerializeToString() + PointCloud(data=coloured.tobytes()).SerializeToString()
