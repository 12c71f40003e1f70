"""What a log says of itself, read without its messages: what was flown, when, and how it ended."""

import zlib
from io import BytesIO
from pathlib import Path
from typing import IO

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, Footer, MetadataIndex
from mcap.writer import MCAP0_MAGIC

from heli_twin.recording.log import Log
from heli_twin.recording.reader import check_format, ending_of, read_log, reading, ships_of
from heli_twin.recording.records import Attachment
from heli_twin.recording.schema import EXPERIMENT, LogError, unsealed
from heli_twin.recording.unpacking import (
    MAX_RECORD_BYTES,
    RECORD,
    Allowance,
    attachment_record,
    metadata_record,
    records,
)

_FOOTER_BYTES = RECORD.size + 20


def read_head(path: Path) -> Log:
    """Read a log without its messages, by the index at its end: fast, however long the flight was.

    Of the attachments only the experiment is there. The messages' checksums are not checked: `read_log` does that.

    Raises:
        LogError: The file is missing, unfinished, or not a log that this version can read.
    """
    with reading(str(path)), path.open("rb") as file:
        summary, size = _summary(file)
        if summary is None:
            return read_log(path, ())
        allowance = Allowance(size)
        metadata: dict[str, dict[str, str]] = {}
        experiment: Attachment | None = None
        for opcode, body in records(memoryview(summary)):
            if opcode == Opcode.METADATA_INDEX:
                index = MetadataIndex.read(ReadDataStream(BytesIO(body)))
                record = metadata_record(_record(file, Opcode.METADATA, index.offset), allowance)
                metadata[record.name] = record.metadata
            elif opcode == Opcode.ATTACHMENT_INDEX:
                index = AttachmentIndex.read(ReadDataStream(BytesIO(body)))
                if index.name == EXPERIMENT:
                    found = attachment_record(_record(file, Opcode.ATTACHMENT, index.offset), allowance)
                    experiment = Attachment(found.name, found.media_type, found.data)
        check_format(metadata.get("heli_twin"))
        if experiment is None:
            raise LogError("does not say what was flown: give a log that heli-twin recorded")
        return Log(
            messages={},
            experiment=experiment.data.decode(),
            metadata=unsealed(metadata.get("run", {})),
            attachments={EXPERIMENT: experiment},
            ending=ending_of(metadata.get("end", {})),
            ships=ships_of(metadata),
        )


def _summary(file: IO[bytes]) -> tuple[bytes | None, int]:
    """The records of a file's index, None if it has none, and the size of the file."""
    size, magic = file.seek(0, 2), len(MCAP0_MAGIC)
    file.seek(0)
    begin = file.read(magic)
    if not begin:
        raise LogError("is empty: nothing was recorded")
    if begin != MCAP0_MAGIC:
        raise LogError("is not an MCAP file: give a log that heli-twin recorded")
    file.seek(max(0, size - magic - _FOOTER_BYTES))
    end = file.read()
    if not end.endswith(MCAP0_MAGIC) or size < 2 * magic + _FOOTER_BYTES:
        raise LogError("stops in the middle, its flight was interrupted: run `heli-twin recover` on it")
    footer = Footer.read(ReadDataStream(BytesIO(end[RECORD.size : _FOOTER_BYTES])))
    start, stop = footer.summary_start, size - magic - _FOOTER_BYTES
    if start == 0:
        return None, size
    if not magic <= start <= stop or stop - start > MAX_RECORD_BYTES:
        raise ValueError("its index is not where it says")
    file.seek(start)
    summary = file.read(stop - start)
    crc = zlib.crc32(end[: _FOOTER_BYTES - 4], zlib.crc32(summary))
    if footer.summary_crc not in (0, crc):
        raise ValueError("its index fails its checksum")
    return summary, size


def _record(file: IO[bytes], opcode: Opcode, offset: int) -> memoryview:
    """The body of a record at an offset."""
    file.seek(offset)
    found, length = RECORD.unpack(file.read(RECORD.size))
    if found != opcode or length > MAX_RECORD_BYTES:
        raise ValueError("a record is not where the index says")
    body = file.read(length)
    if len(body) != length:
        raise ValueError("a record runs over the end")
    return memoryview(body)
