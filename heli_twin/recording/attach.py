"""Adding a file to a finished log: the log is written again, whole, with the same messages and the same digest."""

from collections.abc import Iterator
from io import BytesIO
from pathlib import Path

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Schema
from mcap.writer import MCAP0_MAGIC

from heli_twin.recording.mcap_stream import McapStream
from heli_twin.recording.reader import read_log
from heli_twin.recording.records import Attachment
from heli_twin.recording.schema import LogError
from heli_twin.recording.unpacking import (
    MESSAGE,
    Allowance,
    attachment_record,
    load,
    metadata_record,
    records,
    unpack_chunk,
)
from heli_twin.recording.writer import CHUNK_SIZE, LIBRARY
from heli_twin.whole_file import write_whole


def attach(path: Path, file: Attachment) -> None:
    """Put a file into a finished log; one of the same name is replaced. Digest and messages stay as they are.

    Args:
        path: The log.
        file: What to put in.

    Raises:
        LogError: The log cannot be read or written.
    """
    # Every checksum is checked, so that no damage is sealed with a right one.
    read_log(path, ())
    data = _with(load(path), file)
    try:
        write_whole(path, data)
    except OSError as error:
        raise LogError(f"{path} cannot be written: {error.strerror or error}; it is as it was") from error


def _with(data: bytes, file: Attachment) -> bytes:
    stream = BytesIO()
    log = McapStream(stream, library=LIBRARY, chunk_size=CHUNK_SIZE)
    schemas: dict[int, Schema] = {}
    channels: dict[int, int] = {}
    for opcode, body in _all_records(data):
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(ReadDataStream(BytesIO(body)))
            schemas.setdefault(schema.id, schema)
        elif opcode == Opcode.CHANNEL:
            channel = Channel.read(ReadDataStream(BytesIO(body)))
            if channel.id not in channels:
                of = schemas[channel.schema_id]
                channels[channel.id] = log.channel(
                    channel.topic, channel.message_encoding, of.name, of.encoding, of.data
                )
        elif opcode == Opcode.MESSAGE:
            number, _, time, _ = MESSAGE.unpack_from(body)
            log.message(channels[number], time, bytes(body[MESSAGE.size :]))
        elif opcode == Opcode.METADATA:
            record = metadata_record(body, Allowance(len(data)))
            log.metadata(record.name, record.metadata)
        elif opcode == Opcode.ATTACHMENT:
            record = attachment_record(body, Allowance(len(data)))
            if record.name != file.name:
                log.attachment(record.name, record.media_type, record.data)
    log.attachment(*file)
    log.finish()
    return stream.getvalue()


def _all_records(data: bytes) -> Iterator[tuple[int, memoryview]]:
    """The records of the data section, those in chunks too."""
    allowance = Allowance(len(data))
    for opcode, body in records(memoryview(data), len(MCAP0_MAGIC)):
        if opcode == Opcode.DATA_END:
            return
        if opcode == Opcode.CHUNK:
            yield from records(unpack_chunk(body, allowance))
        else:
            yield opcode, body
