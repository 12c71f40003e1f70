"""A fast MCAP writer.

The library's own writer takes 5 us a message, and a control step writes twelve. Here a message is one `struct.pack`;
all other records are written by the library. The bytes are the same as the library's (see the tests).
"""

import struct
import zlib
from collections import defaultdict
from collections.abc import Iterable, Mapping
from typing import Any, Protocol

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.writer import MCAP0_MAGIC

ZSTD_LEVEL = -7
"""Compression level: a sixth of the time of the default, and files 15 % larger, since most of a flight is noise."""

_OPCODE_AND_LENGTH = 9
"""Bytes at the start of a record that its length does not include."""
_MESSAGE = struct.Struct("<BQHIQQ")
"""Head of a message: opcode, length, channel, sequence, log and publish time."""
_MESSAGE_OPCODE = int(Opcode.MESSAGE)
"""A plain number: an enum would be converted for each message."""
_CHUNK = struct.Struct("<BQQQQII4sQ")
"""Head of a chunk: opcode, length, times, size and CRC of the unpacked data, `zstd` with its length, packed size."""


class Writable(Protocol):
    """A stream of bytes that takes all it is given."""

    def write(self, data: bytes, /) -> Any:
        """Add bytes."""


class McapStream:
    """Writes a chunked, indexed, zstd-compressed MCAP file with all checksums to a binary stream."""

    def __init__(self, stream: Writable, *, library: str, chunk_size: int) -> None:
        self._stream = stream
        self._chunk_size = chunk_size
        self._compressor = zstandard.ZstdCompressor(level=ZSTD_LEVEL)
        self._schemas: dict[tuple[str, str, bytes], Schema] = {}
        self._channels: list[Channel] = []
        self._chunks = bytearray()
        """Index of the chunks so far, packed: the only memory that grows with the flight."""
        self._chunk_count, self._start, self._end = 0, 2**64 - 1, 0
        self._attachments: list[AttachmentIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._counts: dict[int, int] = {}
        self._head = b""
        """Schemas and channels that the next chunk begins with."""
        self._records: list[bytes] = []
        """The chunk in progress: heads and data of its messages."""
        self._index: defaultdict[int, list[int]] = defaultdict(list)
        """By channel: log time and offset behind `_head` of each message, alternating."""
        self._size = 0
        self._offset = self._crc = 0
        self._emit(MCAP0_MAGIC)
        self._emit(_bytes(Header("", library)))

    def channel(self, topic: str, encoding: str, schema_name: str, schema_encoding: str, schema: bytes) -> int:
        """Register a topic and its message type, and return the channel's id."""
        key = (schema_name, schema_encoding, schema)
        if key not in self._schemas:
            self._schemas[key] = Schema(len(self._schemas) + 1, schema, schema_encoding, schema_name)
            self._head += _bytes(self._schemas[key])
        self._channels.append(Channel(len(self._channels) + 1, topic, encoding, {}, self._schemas[key].id))
        self._head += _bytes(self._channels[-1])
        return len(self._channels)

    def message(self, channel: int, time: int, data: bytes) -> None:
        """Add a message, logged and published at `time` (ns)."""
        self.messages([(channel, time, data)])

    def messages(self, batch: Iterable[tuple[int, int, bytes]]) -> bytes:
        """Add messages: channel, time at which they are logged and published (ns), data.

        Returns:
            Heads and data of all of them.
        """
        pack, written, whole = _MESSAGE.pack, list[bytes](), b""
        index, size, room = self._index, self._size, self._chunk_size - len(self._head)
        for channel, time, data in batch:
            length = _MESSAGE.size + len(data)
            written += (pack(_MESSAGE_OPCODE, length - _OPCODE_AND_LENGTH, channel, 0, time, time), data)
            entry = index[channel]
            entry.append(time)
            entry.append(size)
            size += length
            if size > room:
                self._records.append(b"".join(written))
                whole += self._records[-1]
                self._end_chunk()
                written, index, size, room = [], self._index, 0, self._chunk_size
        if written:
            self._records.append(b"".join(written))
            whole += self._records[-1]
        self._size = size
        return whole

    def metadata(self, name: str, data: Mapping[str, str]) -> None:
        """Write key-value text."""
        record = _bytes(Metadata(name, dict(data)))
        self._metadata.append(MetadataIndex(self._offset, len(record), name))
        self._emit(record)

    def attachment(self, name: str, media_type: str, data: bytes) -> None:
        """Write a file."""
        record = _bytes(Attachment(0, 0, name, media_type, data))
        self._attachments.append(AttachmentIndex(self._offset, len(record), 0, 0, len(data), name, media_type))
        self._emit(record)

    def flush(self) -> None:
        """Write all messages so far."""
        self._end_chunk()

    def finish(self) -> None:
        """Write the index; the stream stays open."""
        self._end_chunk()
        statistics = Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=self._chunk_count,
            message_count=sum(self._counts.values()),
            metadata_count=len(self._metadata),
            message_start_time=self._start if self._chunk_count else 0,
            message_end_time=self._end,
            schema_count=len(self._schemas),
        )
        groups = {
            Opcode.SCHEMA: _bytes(*self._schemas.values()),
            Opcode.CHANNEL: _bytes(*self._channels),
            Opcode.STATISTICS: _bytes(statistics),
            Opcode.CHUNK_INDEX: bytes(self._chunks),
            Opcode.ATTACHMENT_INDEX: _bytes(*self._attachments),
            Opcode.METADATA_INDEX: _bytes(*self._metadata),
        }
        self._emit(_bytes(DataEnd(self._crc)))
        start = self._offset
        summary, offsets = b"", b""
        for opcode, group in groups.items():
            offsets += _bytes(SummaryOffset(opcode, start + len(summary), len(group)))
            summary += group
        footer = _bytes(Footer(start, start + len(summary), 0))[:-4]
        crc = zlib.crc32(summary + offsets + footer)
        self._emit(summary + offsets + footer + struct.pack("<I", crc) + MCAP0_MAGIC)

    def _end_chunk(self) -> None:
        if not self._records:
            return
        head, records = len(self._head), b"".join([self._head, *self._records])
        packed = self._compressor.compress(records)
        times = [entry[::2] for entry in self._index.values()]
        start, end = min(map(min, times)), max(map(max, times))
        # The library would copy the packed data three times.
        chunk_length = _CHUNK.size + len(packed)
        length, crc = chunk_length - _OPCODE_AND_LENGTH, zlib.crc32(records)
        chunk = _CHUNK.pack(Opcode.CHUNK, length, start, end, len(records), crc, 4, b"zstd", len(packed))
        offsets, indexes = {}, b""
        for channel, entry in self._index.items():
            if head:
                entry[1::2] = [head + offset for offset in entry[1::2]]
            offsets[channel] = self._offset + chunk_length + len(indexes)
            size = 8 * len(entry)
            indexes += struct.pack(f"<BQHI{len(entry)}Q", Opcode.MESSAGE_INDEX, 6 + size, channel, size, *entry)
            self._counts[channel] = self._counts.get(channel, 0) + len(entry) // 2
        self._chunk_count += 1
        self._start, self._end = min(self._start, start), max(self._end, end)
        self._chunks += _bytes(
            ChunkIndex(
                chunk_length=chunk_length,
                chunk_start_offset=self._offset,
                compression="zstd",
                compressed_size=len(packed),
                message_end_time=end,
                message_index_length=len(indexes),
                message_index_offsets=offsets,
                message_start_time=start,
                uncompressed_size=len(records),
            )
        )
        self._head, self._records, self._index, self._size = b"", [], defaultdict(list), 0
        self._emit(b"".join([chunk, packed, indexes]))

    def _emit(self, data: bytes) -> None:
        self._crc = zlib.crc32(data, self._crc)
        self._offset += len(data)
        self._stream.write(data)


def _bytes(*records: McapRecord) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return builder.end()
