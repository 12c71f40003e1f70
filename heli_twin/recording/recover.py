"""Saving what is good of a log that stops in the middle or has a damaged place."""

import zlib
from collections.abc import Iterator
from contextlib import suppress
from io import BytesIO
from pathlib import Path

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Metadata
from mcap.writer import MCAP0_MAGIC

from heli_twin.recording.mcap_stream import McapStream
from heli_twin.recording.reader import DAMAGE, MESSAGE, check_format, records, unpack_chunk
from heli_twin.recording.schema import EXPERIMENT, TOPICS, LogError
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
    target = path.with_suffix("") if path.suffix == ".part" else path.with_suffix(".recovered.mcap")
    try:
        contents = _salvage(path.read_bytes())
        with target.open("xb") as stream:
            stream.write(contents)
    except OSError as error:
        raise LogError(f"{path} cannot be recovered: {error}") from error
    except LogError as error:
        raise LogError(f"{path} cannot be recovered: it {error}") from error
    return target


def _salvage(data: bytes) -> bytes:
    """A whole log from the intact records of another."""
    stream = BytesIO()
    log = McapStream(stream, library=LIBRARY, chunk_size=CHUNK_SIZE)
    for topic in TOPICS:
        log.channel(*topic)
    metadata: dict[str, dict[str, str]] = {}
    attachments: set[str] = set()
    last = 0
    for record in _intact_records(data):
        if isinstance(record, Metadata):
            metadata[record.name] = record.metadata
            if record.name != "end":
                log.metadata(record.name, record.metadata)
        elif isinstance(record, Attachment):
            attachments.add(record.name)
            log.attachment(record.name, record.media_type, record.data)
        else:
            last = max(last, _copy_messages(record, log))
    check_format(metadata.get("heli_twin"))
    if EXPERIMENT not in attachments:
        raise LogError("has lost what was flown")
    log.metadata("end", {"outcome": "interrupted", "time": str(last), **metadata.get("end", {}), "recovered": "yes"})
    log.finish()
    return stream.getvalue()


def _intact_records(data: bytes) -> Iterator[Metadata | Attachment | memoryview]:
    """Metadata, attachments and unpacked chunks before the file breaks off, but none that fails its checksum."""
    with suppress(*DAMAGE):
        for opcode, body in records(memoryview(data), len(MCAP0_MAGIC)):
            with suppress(*DAMAGE):
                if opcode == Opcode.CHUNK:
                    yield unpack_chunk(body)
                elif opcode == Opcode.METADATA:
                    yield Metadata.read(ReadDataStream(BytesIO(body)))
                elif opcode == Opcode.ATTACHMENT and zlib.crc32(body[:-4]) == int.from_bytes(body[-4:], "little"):
                    yield Attachment.read(ReadDataStream(BytesIO(body)))


def _copy_messages(chunk: memoryview, log: McapStream) -> int:
    """Add the messages of an unpacked chunk to the log; returns the last log time, ns."""
    last = 0
    for opcode, body in records(chunk):
        if opcode == Opcode.MESSAGE:
            channel, _, time, _ = MESSAGE.unpack_from(body)
            log.message(channel, time, bytes(body[MESSAGE.size :]))
            last = max(last, time)
    return last
