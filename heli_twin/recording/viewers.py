"""The flight once more for viewers that know nothing of heli_twin: a URDF that moves, point clouds and plots.

Opened in Rerun, Foxglove or PlotJuggler the bare log shows the helicopter, its path and its plan. All of it follows
from the wires and is thinned out, so it costs little.
"""

from collections.abc import Callable

import numpy as np
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.timestamp_pb2 import Timestamp

from controllers.signals import Array
from heli_twin.plant import Truth, physical_state
from heli_twin.recording import cdr
from heli_twin.recording.schema import FRAME, LAYOUTS, plan_layout
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

Write = Callable[[str, int, bytes], None]


class Viewers:
    """Derives what viewers draw from the messages it is told of, and writes it by and by.

    It takes the bytes of the messages and does its work for many of them at once: between two control steps, whose
    matrices have pushed everything else out of the processor's caches, the same work takes three times as long.
    """

    def __init__(self, write: Write) -> None:
        self._write = write
        self._tf_due = self._horizon_due = self._plot_due = 0
        self._truth = self._reference = b""
        self._bodies: list[tuple[int, bytes]] = []
        self._plots: list[tuple[int, bytes, bytes, bytes]] = []
        self._plans: list[tuple[int, bytes, int]] = []

    def start(self) -> None:
        """Write what is there before anything moves."""
        self._write("/robot_description", 0, cdr.string(_URDF))

    def reference_path(self, t: int, points: Array) -> None:
        """Draw the whole path to fly, (n, 3) world, m."""
        self._write("/view/reference_path", t, _cloud(t, points, WANTED))

    def truth(self, t: int, data: bytes) -> None:
        """Move the body."""
        self._truth = data
        if t >= self._tf_due:
            self._tf_due = t + TF_PERIOD
            self._bodies.append((t, data))

    def reference(self, data: bytes) -> None:
        """Remember where the helicopter should be."""
        self._reference = data

    def sent(self, t: int, data: bytes) -> None:
        """Plot, as joints: the error in position and velocity (yaw frame) of x y z yaw, and as effort the inputs."""
        if self._truth and self._reference and t >= self._plot_due:
            self._plot_due = t + PLOT_PERIOD
            self._plots.append((t, self._truth, self._reference, data))

    def plan(self, t: int, data: bytes, horizon: int) -> None:
        """Draw the predicted positions."""
        if t >= self._horizon_due:
            self._horizon_due = t + HORIZON_PERIOD
            self._plans.append((t, data, horizon))

    def flush(self) -> None:
        """Write everything that it was told of."""
        for t, data in self._bodies:
            self._write("/tf", t, _transform(t, _read("/truth", data)))
        for t, truth, reference, sent in self._plots:
            error = _error(_read("/truth", truth), _read("/reference", reference)["x"])
            u = _read("/command/sent", sent)["u"]
            self._write("/view/error_and_input", t, _AXES.pack(t, error[:4], error[4:], u))
        for t, data, horizon in self._plans:
            points = np.frombuffer(data, plan_layout(horizon).dtype)[0]["x"][:, :3]
            self._write("/view/horizon", t, _cloud(t, points, PLANNED))
        self._bodies, self._plots, self._plans = [], [], []


def _read(topic: str, data: bytes) -> np.void:
    return np.frombuffer(data, LAYOUTS[topic].dtype)[0]


def _transform(t: int, truth: np.void) -> bytes:
    (x, y, z), (qw, qx, qy, qz) = truth["position"].tolist(), truth["quat_wxyz"].tolist()
    message = FrameTransform(
        timestamp=timestamp(t),
        parent_frame_id=FRAME,
        child_frame_id=BODY,
        translation=Vector3(x=x, y=y, z=z),
        rotation=Quaternion(x=qx, y=qy, z=qz, w=qw),
    )
    return message.SerializeToString()


def _error(truth: np.void, x_ref: Array) -> Array:
    """Truth minus reference (8,), the yaw in [-pi, pi)."""
    with np.errstate(invalid="ignore"):
        error = physical_state(Truth(*truth)) - x_ref
        error[3] = (error[3] + np.pi) % (2 * np.pi) - np.pi
    return error


def timestamp(t: int) -> Timestamp:
    """Simulated time as protobuf writes it."""
    return Timestamp(seconds=t // 1_000_000_000, nanos=t % 1_000_000_000)


_FLOAT32, _UINT8 = PackedElementField.NumericType.FLOAT32, PackedElementField.NumericType.UINT8
_FIELDS = [
    *(PackedElementField(name=axis, offset=4 * i, type=_FLOAT32) for i, axis in enumerate("xyz")),
    *(
        PackedElementField(name=name, offset=12 + i, type=_UINT8)
        for i, name in enumerate(("red", "green", "blue", "alpha"))
    ),
]
_POINT = np.dtype([("position", "<f4", 3), ("colour", ">u4")])


def _cloud(t: int, points: Array, colour: int) -> bytes:
    cloud = np.empty(len(points), _POINT)
    cloud["position"], cloud["colour"] = points, colour
    pose = Pose(position=Vector3(), orientation=Quaternion(w=1.0))
    message = PointCloud(
        timestamp=timestamp(t),
        frame_id=FRAME,
        pose=pose,
        point_stride=_POINT.itemsize,
        fields=_FIELDS,
        data=cloud.tobytes(),
    )
    return message.SerializeToString()
