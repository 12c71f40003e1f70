"""The contract of a flight log: its topics in the order data flows, their message types and layouts."""

from collections.abc import Mapping
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from google.protobuf.message import Message
from mcap_protobuf.schema import build_file_descriptor_set

from heli_twin.errors import HeliTwinError
from heli_twin.recording import flight_pb2 as pb
from heli_twin.recording.packing import Layout

FORMAT = 1
"""Version of this contract; a reader refuses a greater one."""
EXPERIMENT = "experiment.json"
"""Name of the attachment that says what was flown."""
FRAME = "world"
"""Name of the world frame in messages made for viewers."""
PLAN_STATES = 10
"""Width of a predicted state: eight physical and two integral states."""


class LogError(HeliTwinError):
    """A log that cannot be written or read."""


class Topic(NamedTuple):
    """A channel of the log and its message type, as MCAP describes it."""

    name: str
    message_encoding: str
    schema_name: str
    schema_encoding: str
    schema: bytes


def _protobuf(topic: str, message: type[Message]) -> Topic:
    schema = build_file_descriptor_set(message).SerializeToString(deterministic=True)
    return Topic(topic, "protobuf", message.DESCRIPTOR.full_name, "protobuf", schema)


def _ros2(topic: str, message: str, definition: str) -> Topic:
    return Topic(topic, "cdr", message, "ros2msg", definition.encode())


_RULE = f"{'=' * 80}\n"
_NUMBERS = (
    "std_msgs/MultiArrayLayout layout\nfloat64[] data\n"
    f"{_RULE}MSG: std_msgs/MultiArrayLayout\nstd_msgs/MultiArrayDimension[] dim\nuint32 data_offset\n"
    f"{_RULE}MSG: std_msgs/MultiArrayDimension\nstring label\nuint32 size\nuint32 stride\n"
)

WIRES = (
    _protobuf("/truth", pb.Truth),
    _protobuf("/mocap/pose", pb.Pose),
    _protobuf("/estimate", pb.Estimate),
    _protobuf("/reference", pb.Reference),
    _protobuf("/command/sent", pb.Command),
    _protobuf("/command/acting", pb.Command),
    _protobuf("/mpc/plan", pb.Plan),
    _protobuf("/mpc/qp", pb.QpReport),
    _protobuf("/disturbance", pb.Air),
    _protobuf("/events", Log),
    _protobuf("/timing", pb.Timing),
)
"""What crossed the wires."""

FOR_VIEWERS = (
    _ros2("/robot_description", "std_msgs/msg/String", "string data\n"),
    _protobuf("/tf", FrameTransform),
    _protobuf("/view/reference_path", PointCloud),
    _protobuf("/view/horizon", PointCloud),
    _ros2("/view/error", "std_msgs/msg/Float64MultiArray", _NUMBERS),
    _ros2("/view/input", "std_msgs/msg/Float64MultiArray", _NUMBERS),
)
"""The same flight once more, thinned out, in the message types that viewers draw without being told how."""

TOPICS = WIRES + FOR_VIEWERS
TIMING = "/timing"
"""The one topic that the flight digest leaves out: measured times differ from run to run."""

LAYOUTS: Mapping[str, Layout] = {
    "/truth": Layout(pb.Truth, position=(3,), quat_wxyz=(4,), velocity=(3,), angular_velocity=(3,), actuators=(4,)),
    "/mocap/pose": Layout(pb.Pose, position=(3,), quat_wxyz=(4,)),
    "/estimate": Layout(pb.Estimate, x=(8,), disturbance=(4,), variance=(4, 3)),
    "/reference": Layout(pb.Reference, x=(8,), u=(4,)),
    "/command/sent": Layout(pb.Command, u=(4,)),
    "/command/acting": Layout(pb.Command, u=(4,)),
    "/mpc/qp": Layout(pb.QpReport),
    "/disturbance": Layout(pb.Air, wind=(3,), acceleration=(3,)),
    "/timing": Layout(pb.Timing),
}
"""How the wires of one size are packed; `/mpc/plan` depends on the horizon, `/events` on their text."""

QP_STATUS = tuple(name.removeprefix("QP_STATUS_").lower() for name in pb.QpStatus.keys())  # noqa: SIM118
"""Names of the rungs of the fallback ladder, by their number in the log."""
SEVERITY = tuple(name.lower() for name in Log.Level.keys())  # noqa: SIM118
"""Names of the severities of an event, by their number in the log."""


@lru_cache
def plan_layout(horizon: int) -> Layout:
    """How a plan of so many steps is packed."""
    return Layout(pb.Plan, x=(horizon + 1, PLAN_STATES), u=(horizon, 4), u_nominal=(horizon, 4))


def code(names: tuple[str, ...], name: str, what: str) -> int:
    """The number that stands for `name` in the log."""
    if name not in names:
        raise LogError(f"unknown {what} {name!r}: use one of {', '.join(names[1:])}")
    return names.index(name)


def cdr_numbers(values: np.ndarray) -> bytes:
    """A std_msgs/Float64MultiArray without named dimensions: header, dim, data_offset, count, padding to 8, data."""
    return b"\0\1\0\0" + np.array([0, 0, values.size, 0], "<u4").tobytes() + values.astype("<f8").tobytes()


def cdr_string(text: str) -> bytes:
    """A std_msgs/String."""
    data = text.encode() + b"\0"
    return b"\0\1\0\0" + len(data).to_bytes(4, "little") + data
