"""Messages of MCAP files that heli-twin did not write, under the same limits as its own logs."""

from collections.abc import Collection, Iterator
from io import BytesIO
from pathlib import Path
from typing import NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Message, Schema
from mcap.writer import MCAP0_MAGIC

from heli_twin.recording.schema import LogError
from heli_twin.recording.unpacking import DAMAGE, Allowance, load, records, unpack_chunk


class BagMessage(NamedTuple):
    """One message."""

    topic: str
    schema: str
    """Name of its type, such as `geometry_msgs/msg/PoseStamped`."""
    encoding: str
    """Of its bytes, such as `cdr`."""
    log_time: int
    """When it was recorded, ns."""
    data: bytes


def bag_messages(path: Path, schemas: Collection[str]) -> Iterator[BagMessage]:
    """The messages of some types, in the order of the file.

    Args:
        path: An MCAP file, finished or not.
        schemas: Names of the types.

    Raises:
        LogError: It cannot be opened, is no MCAP file, is damaged, or unpacks to too much.
    """
    try:
        data = load(path)
        if not data.startswith(MCAP0_MAGIC):
            raise LogError("is not an MCAP file")
        yield from _Bag(schemas, Allowance(len(data))).messages(memoryview(data)[len(MCAP0_MAGIC) :])
    except LogError as error:
        raise LogError(f"{path} {error}") from None
    except OSError as error:
        raise LogError(f"{path} cannot be opened: {error.strerror or error}") from error
    except DAMAGE as error:
        raise LogError(f"{path} is damaged ({error or type(error).__name__})") from error


class _Bag:
    def __init__(self, schemas: Collection[str], allowance: Allowance) -> None:
        self._wanted, self._allowance = schemas, allowance
        self._schemas: dict[int, str] = {}
        self._channels: dict[int, Channel] = {}

    def messages(self, data: memoryview) -> Iterator[BagMessage]:
        for opcode, body in records(data):
            if opcode in (Opcode.FOOTER, Opcode.DATA_END):
                return
            if opcode == Opcode.CHUNK:
                yield from self.messages(unpack_chunk(body, self._allowance))
            elif opcode == Opcode.SCHEMA:
                schema = Schema.read(_stream(body))
                self._schemas[schema.id] = schema.name
            elif opcode == Opcode.CHANNEL:
                channel = Channel.read(_stream(body))
                if self._schemas.get(channel.schema_id) in self._wanted:
                    self._channels[channel.id] = channel
            elif opcode == Opcode.MESSAGE:
                message = Message.read(_stream(body), len(body))
                if channel := self._channels.get(message.channel_id):
                    schema = self._schemas[channel.schema_id]
                    yield BagMessage(channel.topic, schema, channel.message_encoding, message.log_time, message.data)


def _stream(body: memoryview) -> ReadDataStream:
    return ReadDataStream(BytesIO(bytes(body)))
