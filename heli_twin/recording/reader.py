"""Reading a flight log: every checksum is checked, and damage is told in one sentence."""

import zlib
from collections.abc import Collection, Generator, Mapping
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import IO

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, DataEnd, Footer
from mcap.writer import MCAP0_MAGIC

from controllers.markers import checked_name
from heli_twin.recording.log import Log
from heli_twin.recording.records import OUTCOMES, Attachment, Ending, Messages, ShipRecord
from heli_twin.recording.schema import EXPERIMENT, FORMAT, SHIP_WIRES, SHIPS, TOPICS, LogError, unsealed
from heli_twin.recording.unpacking import (
    DAMAGE,
    MESSAGE,
    MESSAGE_OVERHEAD_BYTES,
    RECORD,
    Allowance,
    attachment_record,
    load,
    metadata_record,
    records,
    unpack_chunk,
)
from heli_twin.terminal_text import clean, instead

_FOOTER_SIZE, _DATA_END_SIZE = RECORD.size + 20, RECORD.size + 4
_MESSAGE_OPCODE = int(Opcode.MESSAGE)
"""A plain number: an enum would be converted for each record."""
LATEST_NS = 2**63 - 1
"""The latest time that fits into the columns of a log."""


def read_log(source: Path | str | IO[bytes], topics: Collection[str] | None = None) -> Log:
    """Read a log; its columns are decoded when first asked for.

    Args:
        source: A file, or a stream that can seek, such as that of a recorder in memory; `RUN.mcap#a` is the log of the
            helicopter `a`, one of several.
        topics: The topics to keep, the others are checked and dropped; None keeps all.

    Raises:
        LogError: The file is missing, damaged, unfinished, or not a log that this version can read, or a topic is
            unknown.
    """
    name = str(source) if isinstance(source, Path | str) else "the log in memory"
    source, ship = of_ship(source) if isinstance(source, Path | str) else (source, "")
    log = _read(name, source, topics)
    with reading(name):
        return log.ship(ship) if ship else log


def of_ship(source: Path | str) -> tuple[Path, str]:
    """Return the path of a log and the name of one helicopter in it, `RUN.mcap#a`; the name is empty without `#`."""
    path, has_ship, ship = str(source).rpartition(SHIP_MARK)
    return (Path(path), ship) if has_ship and not Path(source).exists() else (Path(source), "")


SHIP_MARK = "#"
"""Between the path of a log and the name of one helicopter in it."""


def _read(name: str, source: Path | str | IO[bytes], topics: Collection[str] | None) -> Log:
    with reading(name):
        data = load(source)
        _check_ends(data)
        contents = _Contents(topics, Allowance(len(data)))
        for opcode, body in records(memoryview(data), len(MCAP0_MAGIC)):
            if opcode == Opcode.DATA_END:
                break
            contents.take(opcode, body)
        return contents.log()


@contextmanager
def reading(name: str) -> Generator[None]:
    """Turn every exception inside into one sentence about the file of that name."""
    name = clean(name, 200)
    try:
        yield
    except LogError as error:
        raise LogError(f"{name} {error}") from None
    except OSError as error:
        raise LogError(f"{name} cannot be opened: {error.strerror or error}") from error
    except DAMAGE as error:
        what = clean(str(error), 100) or type(error).__name__
        raise LogError(f"{name} is damaged ({what}): try `heli-twin recover {name}`") from error


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
    """Check that this version can read a log with this metadata."""
    version = (identity or {}).get("format", "")
    if not (version.isascii() and version.isdecimal() and len(version) < 10):
        raise LogError("is not a flight of heli-twin: give a log that heli-twin recorded")
    if int(version) > FORMAT:
        raise LogError(
            f"has log format {version}, written by a newer heli-twin; this one reads up to {FORMAT}: upgrade"
        )


class _Contents:
    """Collects the records of a log, each once and in the order of the file; the index is not used."""

    def __init__(self, topics: Collection[str] | None, allowance: Allowance) -> None:
        self._topics, self._allowance = topics, allowance
        self._channels: dict[int, str] = {}
        self._messages: dict[str, tuple[list[int], list[bytes]]] = {}
        self._columns: dict[int, tuple[list[int], list[bytes]]] = {}
        """The same by channel; only of topics that are kept."""
        self._metadata: dict[str, dict[str, str]] = {}
        self._attachments: dict[str, Attachment] = {}

    def take(self, opcode: int, body: memoryview) -> None:
        """Add a record of the file."""
        if opcode == Opcode.CHUNK:
            for inner, inner_body in records(unpack_chunk(body, self._allowance)):
                if inner == _MESSAGE_OPCODE:
                    self._message(inner_body)
                elif inner == Opcode.CHANNEL:
                    self._channel(Channel.read(ReadDataStream(BytesIO(inner_body))))
        elif opcode == Opcode.MESSAGE:
            self._message(body)
        elif opcode == Opcode.CHANNEL:
            self._channel(Channel.read(ReadDataStream(BytesIO(body))))
        elif opcode == Opcode.METADATA:
            record = metadata_record(body, self._allowance)
            self._only("metadata records", record.name, self._metadata)
            self._metadata[record.name] = record.metadata
        elif opcode == Opcode.ATTACHMENT:
            file = attachment_record(body, self._allowance)
            self._only("attachments", file.name, self._attachments)
            self._attachments[file.name] = Attachment(file.name, file.media_type, file.data)

    def log(self) -> Log:
        """The log, once all records were added."""
        check_format(self._metadata.get("heli_twin"))
        ships = ships_of(self._metadata)
        known = [topic.name for topic in TOPICS + SHIP_WIRES] + [*self._channels.values()]
        unknown = next((topic for topic in self._topics or () if topic not in known), None)
        if unknown is not None:
            raise LogError(f"has no topic {instead(unknown, known[: len(TOPICS)])}")
        if EXPERIMENT not in self._attachments:
            raise LogError("does not say what was flown: give a log that heli-twin recorded")
        return Log(
            messages={topic: Messages(*columns) for topic, columns in self._messages.items()},
            experiment=self._attachments[EXPERIMENT].data.decode(),
            metadata=unsealed(self._metadata.get("run", {})),
            attachments=self._attachments,
            ending=ending_of(self._metadata.get("end", {})),
            ships=ships,
        )

    def _message(self, body: memoryview) -> None:
        channel, _, time, _ = MESSAGE.unpack_from(body)
        columns = self._columns.get(channel)
        if columns is not None:
            if time > LATEST_NS:
                raise LogError(f"has a message at {time} ns, later than any flight: heli-twin did not write it")
            self._allowance.take(MESSAGE_OVERHEAD_BYTES)
            columns[0].append(time)
            columns[1].append(bytes(body[MESSAGE.size :]))
        elif channel not in self._channels:
            raise ValueError("a message of a channel that is not described")

    def _channel(self, channel: Channel) -> None:
        if self._channels.get(channel.id) == channel.topic:
            return
        if channel.id in self._channels or channel.topic in self._channels.values():
            topic = clean(channel.topic, 60)
            raise LogError(f"has two channels for {topic}, of which one would hide the other: heli-twin writes one")
        self._channels[channel.id] = channel.topic
        if self._topics is None or not {channel.topic, within_ship(channel.topic)}.isdisjoint(self._topics):
            self._messages[channel.topic] = self._columns[channel.id] = ([], [])

    def _only(self, kind: str, name: str, known: Collection[str]) -> None:
        if name in known:
            raise LogError(f"has two {kind} called {clean(name, 60)}, of which one would hide the other")


def within_ship(topic: str) -> str:
    """Return the topic of a helicopter without its name: `/truth` for `/a/truth`."""
    return f"/{topic.removeprefix('/').partition('/')[2]}"


def ships_of(metadata: Mapping[str, Mapping[str, str]]) -> dict[str, ShipRecord]:
    """Return what the metadata of a log say of each of several helicopters; empty for a log of one.

    Raises:
        LogError: They are not named as helicopters are.
    """
    names = list(filter(None, metadata.get("heli_twin", {}).get(SHIPS, "").split(",")))
    try:
        ships = [checked_name(name) for name in names]
    except ValueError as error:
        raise LogError(f"names a helicopter that cannot be: {clean(str(error), 100)}") from None
    return {
        name: ShipRecord(unsealed(metadata.get(f"run.{name}", {})), ending_of(dict(metadata.get(f"end.{name}", {}))))
        for name in ships
    }


def ending_of(metadata: dict[str, str]) -> Ending:
    """Return the end of a flight, from the metadata of its log.

    Raises:
        LogError: The flight ended at no possible time.
    """
    time = metadata.get("time", "0")
    if not (time.isascii() and time.isdecimal() and len(time) < 20 and int(time) <= LATEST_NS):
        raise LogError(f"ends at '{clean(time, 30)}', which is no time in ns: heli-twin did not write it")
    return Ending(
        outcome=OUTCOMES.get(metadata.get("outcome", ""), "unknown"),
        time=int(time),
        text=metadata.get("text", ""),
        digest=metadata.get("digest", ""),
        error=metadata.get("error", ""),
        recovered="recovered" in metadata,
    )
