"""The flight once more for viewers that know nothing of heli_twin: a URDF that moves, point clouds and plots.

Opened in Rerun, Foxglove or PlotJuggler the bare log shows the helicopter, its path and its plan. All of it follows
from the wires and is thinned out, so it costs little.
"""

from collections.abc import Iterator, Sequence
from typing import Any

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
    """Derives what viewers draw from the messages of the wires."""

    def __init__(self) -> None:
        self._tf_due = self._horizon_due = self._plot_due = 0
        self._truth = self._reference = b""
        self.plan: Layout | None = None
        """How the plans of this flight are packed, once there is one."""

    def description(self) -> Timed:
        """The helicopter, before anything moves."""
        return "/robot_description", 0, cdr.string(_URDF)

    def reference_path(self, t: int, points: Array) -> Timed:
        """The whole path to fly, (n, 3) world, m."""
        return "/view/reference_path", t, _cloud(t, points, WANTED)

    def messages(self, batch: Sequence[Timed]) -> Iterator[Timed]:
        """What there is to draw of the next messages of a flight."""
        plots: list[tuple[int, bytes, bytes, bytes]] = []
        for topic, t, data in batch:
            if topic == "/truth":
                self._truth = data
            # Where nobody knows the truth, as of a real flight, the cameras say where the helicopter is.
            if t >= self._tf_due and (topic == "/truth" or (topic == "/mocap/pose" and not self._truth)):
                self._tf_due = t + TF_PERIOD
                yield "/tf", t, _transform(t, topic, data)
            elif topic == "/reference":
                self._reference = data
            elif topic == "/command/sent":
                if self._truth and self._reference and t >= self._plot_due:
                    self._plot_due = t + PLOT_PERIOD
                    plots.append((t, self._truth, self._reference, data))
            elif topic == "/mpc/plan" and self.plan and t >= self._horizon_due:
                self._horizon_due = t + HORIZON_PERIOD
                (plan,) = np.frombuffer(data, self.plan.dtype)
                yield "/view/horizon", t, _cloud(t, plan["x"][:, :3], PLANNED)
        if plots:
            yield from _error_and_input(*zip(*plots, strict=True))


def _read(topic: str, *data: bytes) -> np.ndarray:
    return np.frombuffer(b"".join(data), LAYOUTS[topic].dtype)


def _transform(t: int, topic: str, data: bytes) -> bytes:
    (body,) = _read(topic, data)
    (x, y, z), (qw, qx, qy, qz) = body["position"].tolist(), body["quat_wxyz"].tolist()
    message = FrameTransform(
        timestamp=timestamp(t),
        parent_frame_id=FRAME,
        child_frame_id=BODY,
        translation=Vector3(x=x, y=y, z=z),
        rotation=Quaternion(x=qx, y=qy, z=qz, w=qw),
    )
    return message.SerializeToString()


def _error_and_input(
    times: Sequence[int], truths: Sequence[bytes], references: Sequence[bytes], commands: Sequence[bytes]
) -> Iterator[Timed]:
    """As joints: the error in position and velocity (yaw frame) of x y z yaw, and as effort the inputs."""
    truth = _read("/truth", *truths)
    with np.errstate(invalid="ignore"):
        columns: list[Any] = [truth[name] for name in Truth._fields]
        error = physical_state(Truth(*columns)) - _read("/reference", *references)["x"]
        error[:, 3] = (error[:, 3] + np.pi) % (2 * np.pi) - np.pi
    for t, off, u in zip(times, error, _read("/command/sent", *commands)["u"], strict=True):
        yield "/view/error_and_input", t, _AXES.pack(t, off[:4], off[4:], u)


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


_CLOUD = PointCloud(
    frame_id=FRAME,
    pose=Pose(position=Vector3(), orientation=Quaternion(w=1.0)),
    point_stride=_POINT.itemsize,
    fields=_FIELDS,
).SerializeToString()


def _cloud(t: int, points: Array, colour: int) -> bytes:
    cloud = np.empty(len(points), _POINT)
    cloud["position"], cloud["colour"] = points, colour
    # Fields in the order of their numbers, as the whole message would be written; what never changes is written once.
    stamped = PointCloud(timestamp=timestamp(t)).SerializeToString()
    return stamped + _CLOUD + PointCloud(data=cloud.tobytes()).SerializeToString()
