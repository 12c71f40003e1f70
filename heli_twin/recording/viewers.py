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

from controllers.signals import Array, Plan, Reference
from heli_twin.plant import Truth
from heli_twin.recording.schema import FRAME, cdr_numbers, cdr_string

BODY = "helicopter"
"""Name of the body's frame and of the URDF's only moving link."""

URDF = """<robot name="mCX2">
  <link name="world"/>
  <joint name="flight" type="floating"><parent link="world"/><child link="helicopter"/></joint>
  <link name="helicopter">
    <visual><geometry><box size="0.1 0.04 0.05"/></geometry></visual>
  </link>
</robot>
"""

_MILLISECOND = 1_000_000
TF_PERIOD, HORIZON_PERIOD, PLOT_PERIOD = 40 * _MILLISECOND, 100 * _MILLISECOND, 40 * _MILLISECOND
"""Least simulated time between two messages, ns."""

Write = Callable[[str, int, bytes], None]


class Viewers:
    """Derives what viewers draw from the wires it is told of and writes it."""

    def __init__(self, write: Write) -> None:
        self._write = write
        self._tf_due = self._horizon_due = self._error_due = self._input_due = 0
        self._truth: Truth | None = None

    def start(self) -> None:
        """Write what is there before anything moves."""
        self._write("/robot_description", 0, cdr_string(URDF))

    def reference_path(self, t: int, points: Array) -> None:
        """Draw the whole path to fly, (n, 3) world, m."""
        self._write("/view/reference_path", t, _cloud(t, points))

    def truth(self, t: int, truth: Truth) -> None:
        """Move the body."""
        self._truth = truth
        if t < self._tf_due:
            return
        self._tf_due = t + TF_PERIOD
        (x, y, z), (qw, qx, qy, qz) = truth.position.tolist(), truth.quat_wxyz.tolist()
        message = FrameTransform(
            timestamp=timestamp(t),
            parent_frame_id=FRAME,
            child_frame_id=BODY,
            translation=Vector3(x=x, y=y, z=z),
            rotation=Quaternion(x=qx, y=qy, z=qz, w=qw),
        )
        self._write("/tf", t, message.SerializeToString())

    def reference(self, t: int, reference: Reference) -> None:
        """Plot how far off the helicopter is: x y z (m, world), yaw (rad)."""
        if self._truth is None or t < self._error_due:
            return
        self._error_due = t + PLOT_PERIOD
        with np.errstate(invalid="ignore"):
            error = np.append(self._truth.position, self._truth.yaw) - reference.x[0, :4]
        self._write("/view/error", t, cdr_numbers(error))

    def sent(self, t: int, u: Array) -> None:
        """Plot the inputs: pitch, roll, thrust, yaw, fractions of full stick."""
        if t < self._input_due:
            return
        self._input_due = t + PLOT_PERIOD
        self._write("/view/input", t, cdr_numbers(u))

    def plan(self, t: int, plan: Plan) -> None:
        """Draw the predicted positions."""
        if t < self._horizon_due:
            return
        self._horizon_due = t + HORIZON_PERIOD
        self._write("/view/horizon", t, _cloud(t, plan.x[:, :3]))


def timestamp(t: int) -> Timestamp:
    """Simulated time as protobuf writes it."""
    return Timestamp(seconds=t // 1_000_000_000, nanos=t % 1_000_000_000)


_FIELDS = [
    PackedElementField(name=axis, offset=4 * i, type=PackedElementField.NumericType.FLOAT32)
    for i, axis in enumerate("xyz")
]


def _cloud(t: int, points: Array) -> bytes:
    data = np.asarray(points, "<f4").tobytes()
    pose = Pose(position=Vector3(), orientation=Quaternion(w=1.0))
    cloud = PointCloud(timestamp=timestamp(t), frame_id=FRAME, pose=pose, point_stride=12, fields=_FIELDS, data=data)
    return cloud.SerializeToString()
