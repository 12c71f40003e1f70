"""Saving the intact part of a log that stops in the middle or is damaged."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from hashlib import sha256
from io import BytesIO
from pathlib import Path

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Metadata
from mcap.writer import MCAP0_MAGIC

from heli_twin.recording.mcap_stream import McapStream
from heli_twin.recording.reader import LATEST_NS, check_format, ending_of, ships_of
from heli_twin.recording.schema import EXPERIMENT, LogError, Topic, sealed, topics_of, unsealed
from heli_twin.recording.unpacking import (
    DAMAGE,
    MESSAGE,
    MESSAGE_OVERHEAD_BYTES,
    Allowance,
    attachment_record,
    load,
    metadata_record,
    records,
    unpack_chunk,
)
from heli_twin.recording.writer import CHUNK_SIZE, LIBRARY
from heli_twin.terminal_text import clean
from heli_twin.whole_file import whole_file


def recover(path: Path) -> Path:
    """Copy everything whose checksum is right into a new log; the old one stays as it is.

    Args:
        path: A log, finished or not: `NAME.mcap.part` is saved as `NAME.mcap`, `NAME.mcap` as `NAME.recovered.mcap`.

    Returns:
        Path of the new log; its outcome is `interrupted` unless the old one says how the flight ended.

    Raises:
        LogError: There is nothing to save, or the new log cannot be written.
    """
    target = path.with_suffix("") if path.name.endswith(".mcap.part") else path.with_suffix(".recovered.mcap")
    try:
        data = load(path)
    except OSError as error:
        raise LogError(f"{path} cannot be opened: {error.strerror or error}") from error
    if target.exists():
        raise LogError(f"{path} is not recovered, for {target} exists already: move that away")
    try:
        contents = _salvage(data)
        # `NAME.mcap.part` may be the damaged log itself.
        with whole_file(target, part=target.with_name(f"{target.name}.recovered")) as part:
            part.write_bytes(contents)
    except OSError as error:
        why = error.strerror or error
        raise LogError(f"{target} cannot be written ({why}): copy {path} to another folder") from error
    except LogError as error:
        raise LogError(f"{path} cannot be recovered: it {error}") from error
    return target


def _salvage(data: bytes) -> bytes:
    """A whole log from the intact records of another."""
    metadata: dict[str, dict[str, str]] = {}
    attachments: dict[str, Attachment] = {}
    chunks: dict[bytes, memoryview] = {}
    allowance = Allowance(len(data))
    for record in _intact_records(data, allowance):
        if isinstance(record, Metadata):
            metadata.setdefault(record.name, record.metadata)
        elif isinstance(record, Attachment):
            attachments.setdefault(record.name, record)
        else:
            chunks.setdefault(sha256(record).digest(), record)
    check_format(metadata.get("heli_twin"))
    ending_of(metadata.get("end", {}))
    topics = topics_of([*ships_of(metadata)])
    stream = BytesIO()
    log = McapStream(stream, library=LIBRARY, chunk_size=CHUNK_SIZE)
    for topic in topics:
        log.channel(*topic)
    if EXPERIMENT not in attachments:
        raise LogError("breaks off before it says what was flown")
    for name, record in metadata.items():
        if name != "end":
            log.metadata(name, record)
    for attachment in attachments.values():
        log.attachment(attachment.name, attachment.media_type, attachment.data)
    last = 0
    for messages in sorted(
        filter(None, (_messages(chunk, topics, allowance) for chunk in chunks.values())), key=_begin
    ):
        for message in messages:
            log.message(*message)
            last = max(last, message[1])
    ends = {"outcome": "interrupted", "time": str(last), **unsealed(metadata.get("end", {})), "recovered": "yes"}
    log.metadata("end", sealed(ends))
    log.finish()
    return stream.getvalue()


def _intact_records(data: bytes, allowance: Allowance) -> Iterator[Metadata | Attachment | memoryview]:
    """Metadata, attachments and unpacked chunks up to where the file breaks off, without those whose checksum fails."""
    with suppress(*DAMAGE):
        for opcode, body in records(memoryview(data), len(MCAP0_MAGIC)):
            with suppress(*DAMAGE):
                if opcode == Opcode.CHUNK:
                    yield unpack_chunk(body, allowance)
                elif opcode == Opcode.METADATA:
                    record = metadata_record(body, allowance)
                    if record.name == "heli_twin" or record.metadata == sealed(unsealed(record.metadata)):
                        yield record
                elif opcode == Opcode.ATTACHMENT:
                    yield attachment_record(body, allowance)


Message = tuple[int, int, bytes]
"""Channel, log time (ns) and data."""


def _messages(chunk: memoryview, topics: Sequence[Topic], allowance: Allowance) -> list[Message]:
    """The messages of an unpacked chunk; none if it is not a chunk of messages.

    Raises:
        LogError: Its channels are not those of this version, or the allowance is used up.
    """
    messages: list[Message] = []
    with suppress(*DAMAGE):
        for opcode, body in records(chunk):
            if opcode == Opcode.CHANNEL:
                channel = Channel.read(ReadDataStream(BytesIO(body)))
                if not 1 <= channel.id <= len(topics) or channel.topic != topics[channel.id - 1].name:
                    topic = clean(channel.topic, 60)
                    raise LogError(f"has topics of another version ({topic}): recover it with that one")
            elif opcode == Opcode.MESSAGE:
                channel, _, time, _ = MESSAGE.unpack_from(body)
                if not 1 <= channel <= len(topics) or time > LATEST_NS:
                    return []
                allowance.take(len(body) + MESSAGE_OVERHEAD_BYTES)
                messages.append((channel, time, bytes(body[MESSAGE.size :])))
        return messages
    return []


def _begin(messages: list[Message]) -> int:
    """The first log time, ns: a spliced file may hold its chunks in another order."""
    return min(time for _, time, _ in messages)
