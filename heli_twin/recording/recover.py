"""Saving what is good of a log that stops in the middle or has a damaged place."""

import zlib
from collections.abc import Iterator
from contextlib import suppress
from hashlib import sha256
from io import BytesIO
from pathlib import Path

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Metadata
from mcap.writer import MCAP0_MAGIC

from heli_twin.recording.mcap_stream import McapStream
from heli_twin.recording.reader import DAMAGE, MAX_UNPACKED, MESSAGE, check_format, load, records, unpack_chunk
from heli_twin.recording.schema import EXPERIMENT, TOPICS, LogError, sealed, unsealed
from heli_twin.recording.writer import CHUNK_SIZE, LIBRARY


def recover(path: Path) -> Path:
    """Copy everything that passes its checksum into a new log and leave the old one as it is.

    Args:
        path: A log, finished or not: `NAME.mcap.part` becomes `NAME.mcap`, `NAME.mcap` becomes `NAME.recovered.mcap`.

    Returns:
        The new log; its outcome is `interrupted` unless the old one says how the flight ended.

    Raises:
        LogError: There is nothing to save, or the new log cannot be written.
    """
    target = path.with_suffix("") if path.name.endswith(".mcap.part") else path.with_suffix(".recovered.mcap")
    try:
        data = load(path)
    except OSError as error:
        raise LogError(f"{path} cannot be opened: {error.strerror or error}") from error
    try:
        _write(target, _salvage(data))
    except FileExistsError:
        raise LogError(f"{path} is not recovered, for {target} exists already: move that away") from None
    except OSError as error:
        why = error.strerror or error
        raise LogError(f"{target} cannot be written ({why}): copy {path} to another folder") from error
    except LogError as error:
        raise LogError(f"{path} cannot be recovered: it {error}") from error
    return target


def _write(target: Path, contents: bytes) -> None:
    """Make a new file, whole or not at all."""
    with target.open("xb") as stream:
        try:
            stream.write(contents)
            stream.flush()
        except OSError:
            target.unlink()
            raise


def _salvage(data: bytes) -> bytes:
    """A whole log from the intact records of another."""
    stream = BytesIO()
    log = McapStream(stream, library=LIBRARY, chunk_size=CHUNK_SIZE)
    for topic in TOPICS:
        log.channel(*topic)
    metadata: dict[str, dict[str, str]] = {}
    attachments: dict[str, Attachment] = {}
    chunks: dict[bytes, memoryview] = {}
    for record in _intact_records(data):
        if isinstance(record, Metadata):
            metadata.setdefault(record.name, record.metadata)
        elif isinstance(record, Attachment):
            attachments.setdefault(record.name, record)
        else:
            chunks.setdefault(sha256(record).digest(), record)
    check_format(metadata.get("heli_twin"))
    if EXPERIMENT not in attachments:
        raise LogError("breaks off before it says what was flown")
    for name, record in metadata.items():
        if name != "end":
            log.metadata(name, record)
    for attachment in attachments.values():
        log.attachment(attachment.name, attachment.media_type, attachment.data)
    last = 0
    for messages in sorted(filter(None, map(_messages, chunks.values())), key=_begin):
        for message in messages:
            log.message(*message)
            last = max(last, message[1])
    ends = {"outcome": "interrupted", "time": str(last), **unsealed(metadata.get("end", {})), "recovered": "yes"}
    log.metadata("end", sealed(ends))
    log.finish()
    return stream.getvalue()


def _intact_records(data: bytes) -> Iterator[Metadata | Attachment | memoryview]:
    """Metadata, attachments and unpacked chunks before the file breaks off, but none that fails its checksum."""
    unpacked = 0
    with suppress(*DAMAGE):
        for opcode, body in records(memoryview(data), len(MCAP0_MAGIC)):
            with suppress(*DAMAGE):
                if opcode == Opcode.CHUNK:
                    chunk = unpack_chunk(body)
                    unpacked += len(chunk)
                    if unpacked > MAX_UNPACKED:
                        return
                    yield chunk
                elif opcode == Opcode.METADATA:
                    record = Metadata.read(ReadDataStream(BytesIO(body)))
                    if record.name == "heli_twin" or record.metadata == sealed(unsealed(record.metadata)):
                        yield record
                elif opcode == Opcode.ATTACHMENT and zlib.crc32(body[:-4]) == int.from_bytes(body[-4:], "little"):
                    yield Attachment.read(ReadDataStream(BytesIO(body)))


Message = tuple[int, int, bytes]
"""Channel, log time (ns) and data."""


def _messages(chunk: memoryview) -> list[Message]:
    """The messages of an unpacked chunk; none if it is not one of a flight.

    Raises:
        LogError: Its channels are not those of this version.
    """
    messages: list[Message] = []
    with suppress(*DAMAGE):
        for opcode, body in records(chunk):
            if opcode == Opcode.CHANNEL:
                known = Channel.read(ReadDataStream(BytesIO(body)))
                if known.topic != TOPICS[known.id - 1].name:
                    raise LogError(f"has topics of another version ({known.topic}): recover it with that one")
            elif opcode == Opcode.MESSAGE:
                channel, _, time, _ = MESSAGE.unpack_from(body)
                if not 1 <= channel <= len(TOPICS):
                    return []
                messages.append((channel, time, bytes(body[MESSAGE.size :])))
        return messages
    return []


def _begin(messages: list[Message]) -> int:
    """When the first of some messages was logged, ns: a spliced file may hold its chunks in another order."""
    return min(time for _, time, _ in messages)
