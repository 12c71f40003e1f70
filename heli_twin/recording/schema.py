"""The format of a flight log: its topics in the order in which data flow, their message types and layouts."""

import zlib
from collections.abc import Mapping, Sequence
from functools import cache, lru_cache
from pathlib import Path
from typing import Literal, NamedTuple, get_args

from google.protobuf.message import Message
from mcap_protobuf.schema import build_file_descriptor_set

from controllers.signals import QpStatus
from heli_twin.errors import HeliTwinError
from heli_twin.recording import flight_pb2 as pb
from heli_twin.recording import ships_pb2
from heli_twin.recording.foxglove import FrameTransform, LogMessage, PointCloud
from heli_twin.recording.packing import Layout

FORMAT_OF_ONE, FORMAT = 1, 2
"""Versions of the log format: that of one helicopter, and the newest, of several; a reader refuses a greater one."""
SHIPS = "ships"
"""Key of the names of several helicopters in the metadata that say the format."""
EXPERIMENT = "experiment.json"
"""Name of the attachment that holds the experiment."""
PROTO = Path(__file__).with_name("flight.proto")
"""The message types with their comments; a copy is in every log."""
SHIPS_PROTO = PROTO.with_name("ships.proto")
"""The further message types of several helicopters; a copy is in their logs."""
FRAME = "world"
"""Name of the world frame in messages made for viewers."""
PLAN_STATES = 10
"""Width of a predicted state: eight physical and two integral states."""


class LogError(HeliTwinError):
    """A log that cannot be written or read."""


class LogExistsError(LogError):
    """A log whose name is taken."""


SEAL = "crc32"
"""Key of the checksum of a metadata record. MCAP itself has none, and `recover` must not save damaged numbers."""


def sealed(data: Mapping[str, str]) -> dict[str, str]:
    """Metadata with its checksum.

    Raises:
        LogError: The metadata have the key `SEAL`.
    """
    if SEAL in data:
        raise LogError(f"metadata cannot have the key {SEAL!r}, for their checksum has it: choose another name")
    text = "\0".join(part for item in sorted(data.items()) for part in item)
    return {**data, SEAL: f"{zlib.crc32(text.encode('utf-8', 'surrogatepass')):08x}"}


def unsealed(data: Mapping[str, str]) -> dict[str, str]:
    """Metadata without its checksum."""
    return {key: value for key, value in data.items() if key != SEAL}


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
_JOINTS = (
    "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n"
    f"{_RULE}MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
    f"{_RULE}MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
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
    _protobuf("/events", LogMessage),
    _protobuf("/timing", pb.Timing),
)
"""The signals of the flight."""

FOR_VIEWERS = (
    _ros2("/robot_description", "std_msgs/msg/String", "string data\n"),
    _protobuf("/tf", FrameTransform),
    _protobuf("/view/reference_path", PointCloud),
    _protobuf("/view/horizon", PointCloud),
    _ros2("/view/error_and_input", "sensor_msgs/msg/JointState", _JOINTS),
)
"""The same flight again at a lower rate, in message types that viewers draw without configuration."""

LATER_WIRES = (
    _protobuf("/battery", pb.Battery),
    _protobuf("/estimate_extra", pb.ExtraEstimate),
    _protobuf("/mpc/plan_extra", pb.ExtraPlan),
    _protobuf("/disturbance_moment", pb.Moment),
)
"""Wires that came later: the number of a channel is the place of its topic, in logs of before too."""

TOPICS = WIRES + FOR_VIEWERS + LATER_WIRES
SHIP_WIRES = (
    _protobuf("/path", ships_pb2.Path),
    _protobuf("/planning", ships_pb2.Turn),
    _protobuf("/planning_timing", ships_pb2.PlanningTime),
)
"""Further wires of each of several helicopters."""
TIMING = "/timing"
"""The only topic that the flight digest leaves out: measured times differ from run to run."""

MEASURED = (TIMING, "/planning_timing")
"""The same of each of several helicopters."""

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
    "/battery": Layout(pb.Battery),
    "/disturbance_moment": Layout(pb.Moment, moment=(3,)),
}
"""Layouts of the messages of fixed size. That of `/mpc/plan` depends on the horizon, those of further states on their
number, and `/events` are text."""

QP_STATUS: tuple[str, ...] = ("unspecified", *get_args(QpStatus))
"""Names of the statuses of a control problem, by their number in the log."""
Severity = Literal["unknown", "debug", "info", "warning", "error", "fatal"]
"""Severities of events; nothing that is recorded is `unknown`."""
SEVERITIES: tuple[Severity, ...] = get_args(Severity)
"""By their number in the log."""


@cache
def proto() -> bytes:
    """The text of `flight.proto`."""
    return PROTO.read_bytes()


def topics_of(ships: Sequence[str]) -> tuple[Topic, ...]:
    """The topics of a log in the order of their channels.

    Args:
        ships: Names of several helicopters; empty for a log of one.
    """
    if not ships:
        return TOPICS
    return tuple(topic._replace(name=f"/{name}{topic.name}") for name in ships for topic in TOPICS + SHIP_WIRES)


@lru_cache
def plan_layout(horizon: int) -> Layout:
    """The layout of a plan with this number of steps."""
    return Layout(pb.Plan, x=(horizon + 1, PLAN_STATES), u=(horizon, 4), u_nominal=(horizon, 4))


@lru_cache
def extra_estimate_layout(count: int) -> Layout:
    """The layout of an estimate's further states."""
    return Layout(pb.ExtraEstimate, x=(count,), variance=(count,))


@lru_cache
def extra_plan_layout(rows: int, count: int) -> Layout:
    """The layout of a plan's further states."""
    return Layout(pb.ExtraPlan, x=(rows, count))


def code(names: tuple[str, ...], name: str, what: str) -> int:
    """The number of `name` in the log.

    Raises:
        LogError: `name` is not one of `names`; the message calls it an unknown `what`.
    """
    if name not in names:
        raise LogError(f"unknown {what} {name!r}: use one of {', '.join(names[1:])}")
    return names.index(name)
