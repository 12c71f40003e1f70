"""Parsing of MCAP bytes from anywhere: every size is checked before memory of that size is used."""

import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import IO

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.records import Attachment, Metadata

from heli_twin.recording.schema import LogError

MAX_FILE_BYTES = 2 * 1024**3
"""Largest file that is read; an hour of flight is about 400 MB."""
MAX_RECORD_BYTES = 64 * 1024**2
"""Largest chunk, unpacked, and largest other record; the recorder's chunks have 256 KiB."""
MAX_METADATA_BYTES = 1024**2
"""All metadata of a log together; a flight's are 2 KB. In memory they take up to 30 times as much."""
MAX_UNPACKED_BYTES = 4 * 1024**3
"""Everything in a log, unpacked."""
MAX_EXPANSION = 100
"""Unpacked bytes per byte of the file, beyond `MAX_RECORD_BYTES`; ten minutes of ideal hover have 6, in the lab 1.3."""
MESSAGE_OVERHEAD_BYTES = 120
"""Memory of one message besides its data."""

RECORD = struct.Struct("<BQ")
"""Head of an MCAP record: opcode and length."""
MESSAGE = struct.Struct("<HIQQ")
"""Head of a message: channel, sequence, log and publish time."""
_CHUNK = struct.Struct("<QQQII")
"""Head of a chunk: first and last time, size and CRC of the unpacked records, length of the compression's name."""

DAMAGE = (
    *(McapError, zstandard.ZstdError, struct.error),
    *(ValueError, LookupError, OverflowError, MemoryError, EOFError, RuntimeError),
)
"""The exceptions of the libraries on damaged bytes."""


class Allowance:
    """The memory that a log may take, given the size of its file."""

    def __init__(self, file_bytes: int) -> None:
        self._left = min(MAX_RECORD_BYTES + MAX_EXPANSION * file_bytes, MAX_UNPACKED_BYTES)
        self._metadata_left = MAX_METADATA_BYTES

    def take(self, count: int) -> None:
        """Use up some bytes.

        Raises:
            LogError: The log takes more than it may.
        """
        self._left -= count
        if self._left < 0:
            raise LogError("unpacks to far more than a flight in a file of its size: heli-twin did not write it")

    def take_metadata(self, count: int) -> None:
        """Use up some bytes for metadata.

        Raises:
            LogError: The metadata take more than they may.
        """
        self._metadata_left -= count
        if self._metadata_left < 0:
            raise LogError(f"has more than {MAX_METADATA_BYTES} bytes of metadata: heli-twin did not write it")


def load(source: Path | str | IO[bytes]) -> bytes:
    """The bytes of a file that is not larger than `MAX_FILE_BYTES`."""
    if isinstance(source, Path | str):
        with Path(source).open("rb") as stream:
            return load(stream)
    source.seek(0)
    data = source.read(MAX_FILE_BYTES + 1)
    if len(data) > MAX_FILE_BYTES:
        raise LogError(f"is larger than {MAX_FILE_BYTES} bytes: split it with the mcap command line tool")
    return data


def records(data: memoryview, at: int = 0) -> Iterator[tuple[int, memoryview]]:
    """The opcode and the body of each MCAP record."""
    end = len(data)
    while at < end:
        opcode, length = RECORD.unpack_from(data, at)
        start, at = at + RECORD.size, at + RECORD.size + length
        if at > end:
            raise ValueError("a record runs over the end")
        yield opcode, data[start:at]


def unpack_chunk(body: memoryview, allowance: Allowance) -> memoryview:
    """The records in a chunk.

    Raises:
        LogError: The allowance is used up.
        ValueError: The chunk is damaged or too large; so are the other exceptions of `DAMAGE`.
    """
    _, _, size, crc, name_length = _CHUNK.unpack_from(body)
    name_end = _CHUNK.size + name_length
    compression = bytes(body[_CHUNK.size : name_end])
    (length,) = struct.unpack_from("<Q", body, name_end)
    packed = body[name_end + 8 : name_end + 8 + length]
    if max(size, len(packed)) > MAX_RECORD_BYTES:
        raise ValueError(f"a chunk of {max(size, len(packed))} bytes")
    allowance.take(size)
    unpacked = memoryview(_unpacked(compression, packed, size))
    if len(unpacked) != size or (crc and zlib.crc32(unpacked) != crc):
        raise ValueError("a chunk fails its checksum")
    return unpacked


def _unpacked(compression: bytes, packed: memoryview, size: int) -> bytes | memoryview:
    """Unpacked data, of not more than size + 1 bytes."""
    match compression:
        case b"":
            return packed
        case b"zstd":
            if zstandard.frame_content_size(packed) != size:
                raise ValueError("a chunk of another size than it says")
            return zstandard.ZstdDecompressor().decompress(packed, max_output_size=size)
        case b"lz4":
            return lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=size + 1)
        case _:
            raise ValueError("a chunk in an unknown compression")


def metadata_record(body: memoryview, allowance: Allowance) -> Metadata:
    """The metadata in the body of a record."""
    allowance.take_metadata(len(body))
    return Metadata.read(ReadDataStream(BytesIO(body)))


def attachment_record(body: memoryview, allowance: Allowance) -> Attachment:
    """The attachment in the body of a record, its checksum checked."""
    if len(body) > MAX_RECORD_BYTES:
        raise LogError(f"has an attachment of {len(body)} bytes, {MAX_RECORD_BYTES} at most can be read")
    allowance.take(len(body))
    if int.from_bytes(body[-4:], "little") != zlib.crc32(body[:-4]):
        raise ValueError("an attachment fails its checksum")
    return Attachment.read(ReadDataStream(BytesIO(body)))
