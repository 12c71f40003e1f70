"""ROS 2 messages in CDR, little-endian: the two for which there is no protobuf type that viewers know."""

import struct
from collections.abc import Sequence

_LITTLE_ENDIAN = b"\0\1\0\0"


def string(text: str) -> bytes:
    """A std_msgs/String."""
    return _LITTLE_ENDIAN + _string(text)


class JointStates:
    """Serialises sensor_msgs/JointState messages of joints with these names; viewers plot each under its name."""

    def __init__(self, *names: str) -> None:
        data = _aligned(_string(""), 4) + struct.pack("<I", len(names))
        for name in names:
            data = _aligned(data, 4) + _string(name)
        # The stamp before it has eight bytes and does not change the alignment.
        self._head = _aligned(_aligned(data, 4) + struct.pack("<I", len(names)), 8)
        self._between = struct.pack("<II", len(names), 0)
        values = f"{len(names)}d"
        self._message = struct.Struct(f"<4siI{len(self._head)}s{values}8s{values}8s{values}")

    def pack(self, t: int, position: Sequence[float], velocity: Sequence[float], effort: Sequence[float]) -> bytes:
        """The message at time t (ns), with one value of each kind per joint."""
        stamp, between = divmod(t, 1_000_000_000), self._between
        return self._message.pack(_LITTLE_ENDIAN, *stamp, self._head, *position, between, *velocity, between, *effort)


def _string(text: str) -> bytes:
    data = text.encode() + b"\0"
    return struct.pack("<I", len(data)) + data


def _aligned(data: bytes, to: int) -> bytes:
    return data + bytes(-len(data) % to)
