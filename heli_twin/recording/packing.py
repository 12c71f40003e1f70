"""Protobuf messages of fixed size as NumPy records: only the values change, the key and length bytes stay the same.

Many messages are written with one assignment per field, and a whole column of a log is read by one `np.frombuffer`.
The bytes are those that the generated class writes.
"""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from google.protobuf.descriptor import FieldDescriptor as Field
from google.protobuf.message import Message

_VARINT, _FIXED64, _LENGTH, _FIXED32 = 0, 1, 2, 5
_SCALARS = {
    Field.TYPE_DOUBLE: ("<f8", _FIXED64),
    Field.TYPE_FLOAT: ("<f4", _FIXED32),
    Field.TYPE_SFIXED64: ("<i8", _FIXED64),
    Field.TYPE_SFIXED32: ("<i4", _FIXED32),
    Field.TYPE_BOOL: ("?", _VARINT),
    Field.TYPE_ENUM: ("u1", _VARINT),
}
"""NumPy type and wire type of the types of fixed size. Enums must stay below 128, one byte."""


class Layout:
    """The byte offsets of the values of one message type, given the shapes of its repeated fields."""

    def __init__(self, message: type[Message], **shapes: tuple[int, ...]) -> None:
        prefixes, names, formats, offsets = [], [], [], []
        end = 0
        for field in message.DESCRIPTOR.fields:
            kind, wire_type = _SCALARS[field.type]
            value = np.dtype((kind, shapes.get(field.name, ())))
            if field.is_repeated:
                prefix = _varint(field.number << 3 | _LENGTH) + _varint(value.itemsize)
            else:
                prefix = _varint(field.number << 3 | wire_type)
            prefixes.append((end, prefix))
            names.append(field.name)
            formats.append(value)
            offsets.append(end + len(prefix))
            end = offsets[-1] + value.itemsize
        self.dtype = np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": end})
        template = bytearray(end)
        for at, prefix in prefixes:
            template[at : at + len(prefix)] = prefix
        self._template = bytes(template)
        self._constant = np.concatenate([np.arange(at, at + len(prefix)) for at, prefix in prefixes])
        self._prefix = np.frombuffer(self._template, np.uint8)[self._constant]

    def pack(self, rows: Sequence[Iterable[Any]]) -> list[bytes]:
        """Serialise one message per row of values, in the order of the fields; repeated fields are arrays."""
        size = self.dtype.itemsize
        buffer = bytearray(self._template * len(rows))
        records = np.frombuffer(buffer, self.dtype)
        for name, column in zip(self.dtype.names or (), zip(*rows, strict=True), strict=True):
            records[name] = column
        data = bytes(buffer)
        return [data[at : at + size] for at in range(0, len(data), size)]

    def unpack(self, messages: Sequence[bytes | memoryview]) -> np.ndarray:
        """The values of many messages as a record array (n,).

        Raises:
            ValueError: A message has another layout.
        """
        size = self.dtype.itemsize
        if any(len(message) != size for message in messages):
            raise ValueError(f"a message is not {size} bytes long")
        data = b"".join(messages)
        constant = np.frombuffer(data, np.uint8).reshape(-1, size)[:, self._constant]
        if not np.array_equal(constant, np.broadcast_to(self._prefix, constant.shape)):
            raise ValueError("a message has other fields")
        return np.frombuffer(data, self.dtype)


def _varint(value: int) -> bytes:
    """An integer in protobuf's variable-length code: seven bits a byte, least significant first."""
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    return bytes([*out, value])
