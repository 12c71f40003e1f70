"""Reading a flight log: every checksum checked, damage told in one sentence."""

import struct
import zlib
from collections.abc import Collection, Generator, Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import IO

import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Chunk, DataEnd, Footer
from mcap.stream_reader import get_chunk_data_stream
from mcap.summary import Summary
from mcap.writer import MCAP0_MAGIC

from heli_twin.pasteable import pasteable
from heli_twin.recording.log import Attachment, Log, Messages
from heli_twin.recording.schema import EXPERIMENT, FORMAT, LogError, unsealed

MAX_FILE = 2 * 1024**3
"""Bytes of the largest file that is read; an hour of flight is about 400 MB."""
MAX_CHUNK = 64 * 1024**2
"""Bytes of the largest chunk that is unpacked; the recorder's are 256 KiB."""
MAX_UNPACKED = 4 * 1024**3
"""Bytes of all chunks of a log together."""

RECORD = struct.Struct("<BQ")
"""What every MCAP record starts with: opcode and length."""
MESSAGE = struct.Struct("<HIQQ")
"""What every message starts with: channel, sequence, log and publish time."""
_MESSAGE_RECORD = struct.Struct("<BQHIQQ")
_INDEX_RECORD = struct.Struct("<BQHI")
"""Opcode, length, channel and bytes of what follows: pairs of log time and offset in the chunk."""
_FOOTER_SIZE, _DATA_END_SIZE = RECORD.size + 20, RECORD.size + 4


def read_log(source: Path | str | IO[bytes], topics: Collection[str] | None = None) -> Log:
    """Read a log; its columns are decoded when they are asked for.

    Args:
        source: A file, or a stream that can seek, such as the one a recorder in memory leaves.
        topics: What to keep of it, the others are checked and dropped; None keeps all.

    Raises:
        LogError: There is no such file, it is damaged, unfinished, or not a log that this version can read.
    """
    name = str(source) if isinstance(source, Path | str) else "the log in memory"
    with _reading(name):
        data = load(source)
        _check_ends(data)
        reader = SeekingReader(BytesIO(data), validate_crcs=True, record_size_limit=MAX_FILE)
        summary = reader.get_summary()
        if summary is None:
            raise ValueError("it has no summary")
        metadata = {record.name: record.metadata for record in reader.iter_metadata()}
        check_format(metadata.get("heli_twin"))
        attachments = {a.name: Attachment(a.name, a.media_type, a.data) for a in reader.iter_attachments()}
        return Log(
            messages=_messages(data, summary, topics),
            experiment=attachments[EXPERIMENT].data.decode(),
            metadata=unsealed(metadata.get("run", {})),
            attachments=attachments,
            ending=unsealed(metadata.get("end", {})),
        )


@contextmanager
def _reading(name: str) -> Generator[None]:
    """Turn whatever goes wrong inside into one sentence about the file of that name."""
    try:
        yield
    except LogError as error:
        raise LogError(f"{name} {error}") from None
    except OSError as error:
        raise LogError(f"{name} cannot be opened: {error.strerror or error}") from error
    except DAMAGE as error:
        command = pasteable("heli-twin", "recover", Path(name))
        raise LogError(f"{name} is damaged ({error or type(error).__name__}): try `{command}`") from error


DAMAGE = (McapError, zstandard.ZstdError, struct.error, ValueError, LookupError, OverflowError, MemoryError)
"""What the libraries raise on bytes that are not what they should be."""


def load(source: Path | str | IO[bytes]) -> bytes:
    """The bytes of a file that is not too large."""
    if isinstance(source, Path | str):
        with Path(source).open("rb") as stream:
            return load(stream)
    source.seek(0)
    data = source.read(MAX_FILE + 1)
    if len(data) > MAX_FILE:
        raise LogError(f"is larger than {MAX_FILE} bytes: split it with the mcap command line tool")
    return data


def _check_ends(data: bytes) -> None:
    """Check that this is a whole MCAP file and that both its checksums hold (0 means that there is none)."""
    if not data:
        raise LogError("is empty: nothing was recorded")
    if not data.startswith(MCAP0_MAGIC):
        raise LogError("is not an MCAP file: give a log that heli-twin recorded")
    if not data.endswith(MCAP0_MAGIC) or len(data) < 2 * len(MCAP0_MAGIC) + _FOOTER_SIZE + _DATA_END_SIZE:
        raise LogError("stops in the middle, its flight was interrupted: run `heli-twin recover` on it")
    footer_end = len(data) - len(MCAP0_MAGIC)
    footer = Footer.read(ReadDataStream(BytesIO(data[footer_end - 20 : footer_end])))
    if footer.summary_crc not in (0, zlib.crc32(memoryview(data)[footer.summary_start : footer_end - 4])):
        raise ValueError("its index fails its checksum")
    end = footer.summary_start - _DATA_END_SIZE
    data_end = DataEnd.read(ReadDataStream(BytesIO(data[end + RECORD.size : footer.summary_start])))
    if data_end.data_section_crc not in (0, zlib.crc32(memoryview(data)[:end])):
        raise ValueError("its data fail their checksum")


def check_format(identity: dict[str, str] | None) -> None:
    """Check that a log with this metadata is one that this version can read."""
    version = (identity or {}).get("format", "")
    if not version.isdecimal():
        raise LogError("is not a flight of heli-twin: give a log that heli-twin recorded")
    if int(version) > FORMAT:
        raise LogError(
            f"has log format {version}, written by a newer heli-twin; this one reads up to {FORMAT}: upgrade"
        )


def _messages(data: bytes, summary: Summary, topics: Collection[str] | None) -> dict[str, Messages]:
    """The messages of each topic, in the order of the file, found by the indexes of the chunks."""
    kept = {id: channel.topic for id, channel in summary.channels.items() if topics is None or channel.topic in topics}
    found: dict[int, tuple[list[int], list[bytes]]] = {channel: ([], []) for channel in kept}
    size = 0
    for index in sorted(summary.chunk_indexes, key=lambda index: index.chunk_start_offset):
        start = index.chunk_start_offset + RECORD.size
        chunk = bytes(unpack_chunk(data[start : index.chunk_start_offset + index.chunk_length]))
        size += len(chunk)
        if size > MAX_UNPACKED:
            raise ValueError(f"it unpacks to more than {MAX_UNPACKED} bytes")
        for channel, at in index.message_index_offsets.items():
            if channel in kept:
                times, messages = found[channel]
                for time, offset in _index(data, at, channel):
                    opcode, length, of, _, logged, _ = _MESSAGE_RECORD.unpack_from(chunk, offset)
                    end = offset + RECORD.size + length
                    if (opcode, of, logged) != (Opcode.MESSAGE, channel, time) or end > len(chunk):
                        raise ValueError("an index points at something else")
                    times.append(time)
                    messages.append(chunk[offset + _MESSAGE_RECORD.size : end])
    counted = summary.statistics.channel_message_counts if summary.statistics else {}
    if any(len(times) != counted.get(channel, 0) for channel, (times, _) in found.items()):
        raise ValueError("its index is not complete")
    return {kept[channel]: Messages(*columns) for channel, columns in found.items()}


def _index(data: bytes, at: int, channel: int) -> list[list[int]]:
    """Log time and offset of each message of a channel in a chunk, from the message index at this place."""
    opcode, length, of, size = _INDEX_RECORD.unpack_from(data, at)
    if (opcode, of, size) != (Opcode.MESSAGE_INDEX, channel, length - 6):
        raise ValueError("a message index is somewhere else")
    return np.frombuffer(data, "<u8", size // 8, at + _INDEX_RECORD.size).reshape(-1, 2).tolist()


def records(data: memoryview, at: int = 0) -> Iterator[tuple[int, memoryview]]:
    """Opcode and body of one MCAP record after the other."""
    while at < len(data):
        opcode, length = RECORD.unpack_from(data, at)
        start, at = at + RECORD.size, at + RECORD.size + length
        if at > len(data):
            raise ValueError("a record runs over the end")
        yield opcode, data[start:at]


def unpack_chunk(body: bytes | memoryview) -> memoryview:
    """The records in a chunk; its sizes are checked before anything of that size is made."""
    chunk = Chunk.read(ReadDataStream(BytesIO(body)))
    sizes = {chunk.uncompressed_size}
    if chunk.compression == "zstd":
        sizes.add(zstandard.frame_content_size(chunk.data))
    if len(sizes) > 1 or chunk.uncompressed_size > MAX_CHUNK:
        raise ValueError(f"a chunk of {max(sizes)} bytes")
    stream, length = get_chunk_data_stream(chunk, validate_crc=True)
    return memoryview(stream.read(length))
