"""ROS 2 messages in CDR, little-endian: the two that viewers understand and protobuf has no equal for."""

import struct

import numpy as np

from controllers.signals import Array

_LITTLE_ENDIAN = b"\0\1\0\0"


def string(text: str) -> bytes:
    """A std_msgs/String."""
    return _LITTLE_ENDIAN + _string(text)


class JointStates:
    """A sensor_msgs/JointState of joints with these names: viewers plot each under its name."""

    def __init__(self, *names: str) -> None:
        data = _aligned(_string(""), 4) + struct.pack("<I", len(names))
        for name in names:
            data = _aligned(data, 4) + _string(name)
        # The stamp stands in front, eight bytes, so it moves nothing off its alignment.
        self._head = _aligned(_aligned(data, 4) + struct.pack("<I", len(names)), 8)
        self._between = struct.pack("<II", len(names), 0)

    def pack(self, t: int, position: Array, velocity: Array, effort: Array) -> bytes:
        """The message at time t (ns) with these values, each (n,)."""
        stamp = struct.pack("<iI", t // 1_000_000_000, t % 1_000_000_000)
        arrays = [np.asarray(values, "<f8").tobytes() for values in (position, velocity, effort)]
        return _LITTLE_ENDIAN + stamp + self._head + self._between.join(arrays)


def _string(text: str) -> bytes:
    data = text.encode() + b"\0"
    return struct.pack("<I", len(data)) + data


def _aligned(data: bytes, to: int) -> bytes:
    return data + bytes(-len(data) % to)
