"""A flight log as NumPy columns: what every metric, figure and picture is computed from."""

from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from foxglove_schemas_protobuf.Log_pb2 import Log as LogMessage
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from google.protobuf.message import DecodeError
from numpy.typing import NDArray

from controllers.signals import Array
from heli_twin.recording import flight_pb2 as pb
from heli_twin.recording.packing import Layout
from heli_twin.recording.schema import LAYOUTS, QP_STATUS, SEVERITY, LogError, plan_layout

Times = NDArray[np.int64]


class Truths(NamedTuple):
    """`/truth`: see heli_twin.lab.plant.Truth."""

    time: Times
    stamp: Times
    position: Array
    """(n, 3)."""
    quat_wxyz: Array
    """(n, 4)."""
    velocity: Array
    """(n, 3)."""
    angular_velocity: Array
    """(n, 3)."""
    yaw: Array
    yaw_rate: Array
    actuators: Array
    """(n, 4)."""
    touching: NDArray[np.bool_]


class Poses(NamedTuple):
    """`/mocap/pose`: see controllers.signals.Pose."""

    time: Times
    """When the pose arrived, ns; `stamp` is when the cameras saw it."""
    stamp: Times
    position: Array
    """(n, 3)."""
    quat_wxyz: Array
    """(n, 4)."""


class Estimates(NamedTuple):
    """`/estimate`: see controllers.signals.Estimate."""

    time: Times
    stamp: Times
    x: Array
    """(n, 8)."""
    disturbance: Array
    """(n, 4)."""
    variance: Array
    """(n, 4, 3)."""
    pose_stamp: Times
    rejected: NDArray[np.int32]


class References(NamedTuple):
    """`/reference`: the first row of each controllers.signals.Reference."""

    time: Times
    stamp: Times
    x: Array
    """(n, 8)."""
    u: Array
    """(n, 4)."""


class Commands(NamedTuple):
    """`/command/sent` and `/command/acting`: see controllers.signals.Command."""

    time: Times
    stamp: Times
    u: Array
    """(n, 4)."""


class Plans(NamedTuple):
    """`/mpc/plan`: see controllers.signals.Plan."""

    time: Times
    x: NDArray[np.float32]
    """(n, N + 1, 10), rounded."""
    u: Array
    """(n, N, 4)."""
    u_nominal: Array
    """(n, N, 4)."""


class QpReports(NamedTuple):
    """`/mpc/qp`: see controllers.signals.QpReport."""

    time: Times
    status: NDArray[np.str_]
    iterations: NDArray[np.int32]
    active_bounds: NDArray[np.int32]
    objective: Array
    slack: Array


class Airs(NamedTuple):
    """`/disturbance`: see heli_twin.lab.plant.Air."""

    time: Times
    wind: Array
    """(n, 3)."""
    acceleration: Array
    """(n, 3)."""
    thrust_factor: Array


class Batteries(NamedTuple):
    """`/battery`: see heli_twin.lab.plant.Battery."""

    time: Times
    voltage: Array
    current: Array
    charge: Array


class Event(NamedTuple):
    """`/events`: something worth telling a person."""

    time: int
    severity: str
    name: str
    text: str


class Timings(NamedTuple):
    """`/timing`: measured times, ns."""

    time: Times
    control_step_ns: Times
    solve_ns: Times


class Attachment(NamedTuple):
    """A file kept in the log."""

    name: str
    media_type: str
    data: bytes


class Messages(NamedTuple):
    """One topic as it was recorded."""

    times: Sequence[int]
    data: Sequence[bytes | memoryview]


@dataclass(frozen=True)
class Log:
    """A flight: what was flown, what crossed the wires, how it ended. Columns are decoded when first asked for."""

    messages: Mapping[str, Messages]
    experiment: str = ""
    """The experiment, canonical JSON."""
    metadata: Mapping[str, str] = field(default_factory=dict)
    """Versions, platform, wall-clock start, ..."""
    attachments: Mapping[str, Attachment] = field(default_factory=dict)
    """By name."""
    ending: Mapping[str, str] = field(default_factory=dict)
    """`outcome`, `time` (ns), `digest` and what else the flight left."""

    @property
    def outcome(self) -> str:
        """How the flight ended."""
        return self.ending.get("outcome", "")

    @property
    def digest(self) -> str:
        """What two flights of the same experiment have in common."""
        return self.ending.get("digest", "")

    @cached_property
    def truth(self) -> Truths:
        """What the helicopter really did."""
        return Truths(*self._columns("/truth"))

    @cached_property
    def pose(self) -> Poses:
        """What the motion capture delivered, in order of arrival."""
        return Poses(*self._columns("/mocap/pose"))

    @cached_property
    def estimate(self) -> Estimates:
        """What the estimator believed."""
        return Estimates(*self._columns("/estimate"))

    @cached_property
    def reference(self) -> References:
        """Where the helicopter should have been."""
        return References(*self._columns("/reference"))

    @cached_property
    def sent(self) -> Commands:
        """What the controller asked for."""
        return Commands(*self._columns("/command/sent"))

    @cached_property
    def acting(self) -> Commands:
        """What was in force at the helicopter, from each time on."""
        return Commands(*self._columns("/command/acting"))

    @cached_property
    def plan(self) -> Plans:
        """What the controller expected."""
        data = self._messages("/mpc/plan").data
        with _decoding("/mpc/plan"):
            horizon = len(pb.Plan.FromString(bytes(data[0])).u) // 4 if data else 0
        return Plans(*self._columns("/mpc/plan", plan_layout(horizon)))

    @cached_property
    def qp(self) -> QpReports:
        """How the control problems were solved."""
        time, status, *rest = self._columns("/mpc/qp")
        with _decoding("/mpc/qp"):
            return QpReports(time, np.array(QP_STATUS)[status], *rest)

    @cached_property
    def disturbance(self) -> Airs:
        """What the surroundings did to the helicopter."""
        return Airs(*self._columns("/disturbance"))

    @cached_property
    def battery(self) -> Batteries:
        """What the battery gave; no rows if the plant has none."""
        return Batteries(*self._columns("/battery"))

    @cached_property
    def events(self) -> list[Event]:
        """What was worth telling."""
        topic = self._messages("/events")
        with _decoding("/events"):
            messages = [LogMessage.FromString(bytes(data)) for data in topic.data]
            return [Event(t, SEVERITY[m.level], m.name, m.message) for t, m in zip(topic.times, messages, strict=True)]

    @cached_property
    def reference_paths(self) -> list[tuple[int, Array]]:
        """When (ns) each whole path to fly became known, and its points (n, 3), world, m, rounded."""
        topic = self._messages("/view/reference_path")
        with _decoding("/view/reference_path"):
            clouds = [PointCloud.FromString(bytes(data)) for data in topic.data]
            return [(t, _points(cloud)) for t, cloud in zip(topic.times, clouds, strict=True)]

    @cached_property
    def timing(self) -> Timings:
        """How long computing took."""
        return Timings(*self._columns("/timing"))

    def _messages(self, topic: str) -> Messages:
        return self.messages.get(topic, Messages((), ()))

    def _columns(self, topic: str, layout: Layout | None = None) -> list[Any]:
        """Log times and then every field of a topic, one row a message."""
        messages = self._messages(topic)
        with _decoding(topic):
            records = (layout or LAYOUTS[topic]).unpack(messages.data)
        columns = [np.ascontiguousarray(records[name]) for name in records.dtype.names or ()]
        return [np.array(messages.times, np.int64), *columns]


@contextmanager
def _decoding(topic: str) -> Generator[None]:
    try:
        yield
    except (ValueError, IndexError, DecodeError) as error:
        raise LogError(
            f"the messages on {topic} cannot be read ({error}): was another program writing them?"
        ) from error


def _points(cloud: PointCloud) -> Array:
    """Positions (n, 3), which stand first in every point."""
    points = np.frombuffer(cloud.data, np.uint8).reshape(-1, cloud.point_stride)
    return np.ascontiguousarray(points[:, :12]).view("<f4").reshape(-1, 3).astype(float)
