"""MCAP files with right checksums and hostile content, for the tests of whatever reads a log."""

import json
import struct
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from io import BytesIO
from typing import Any

from hypothesis import strategies as st
from mcap.data_stream import RecordBuilder
from mcap.records import Chunk, DataEnd, Footer, Header, McapRecord, Metadata
from mcap.writer import MCAP0_MAGIC

from heli_twin.recording import Log
from heli_twin.recording.mcap_stream import McapStream
from heli_twin.recording.schema import EXPERIMENT, TOPICS, sealed

MB = 1024**2


def record(content: McapRecord) -> bytes:
    builder = RecordBuilder()
    content.write(builder)
    return builder.end()


def file_of(*records: bytes, summary: bytes = b"") -> bytes:
    """A finished MCAP file of these records; its checksums are 0, which means that there are none."""
    head = MCAP0_MAGIC + record(Header("", "heli_twin")) + record(Metadata("heli_twin", {"format": "1"}))
    data = head + b"".join(records) + record(DataEnd(0))
    return data + summary + record(Footer(len(data), 0, 0)) + MCAP0_MAGIC


def chunk(content: bytes, packed: bytes, compression: str, size: int | None = None) -> bytes:
    size = len(content) if size is None else size
    return record(Chunk(compression, packed, 0, 0, zlib.crc32(content), size))


def message(data: bytes, channel: int = 1, time: int = 0) -> bytes:
    return struct.pack("<BQHIQQ", 5, 22 + len(data), channel, 0, time, time) + data


@dataclass
class Content:
    """What a log says, to be changed and written with right checksums."""

    experiment: str
    run: dict[str, str]
    end: dict[str, str]
    messages: list[tuple[str, int, bytes]]
    attachments: Mapping[str, bytes] = field(default_factory=dict)
    topics: Sequence[str] = tuple(topic.name for topic in TOPICS)

    def written(self) -> bytes:
        stream = BytesIO()
        writer = McapStream(stream, library="heli_twin", chunk_size=256 * 1024)
        writer.metadata("heli_twin", {"format": "1"})
        writer.metadata("run", sealed(self.run))
        for name, data in {EXPERIMENT: self.experiment.encode("utf-8", "replace"), **self.attachments}.items():
            writer.attachment(name, "text/plain", data)
        known = {topic.name: topic for topic in TOPICS}
        channels = {name: writer.channel(*known[name]) for name in self.topics}
        for topic, time, data in self.messages:
            writer.message(channels[topic], time, data)
        writer.metadata("end", sealed(self.end))
        writer.finish()
        return stream.getvalue()


def content_of(log: Log) -> Content:
    """What a real log says."""
    ending = {"outcome": log.outcome, "time": str(log.ending.time), "digest": log.digest, "text": log.ending.text}
    messages = [(name, t, bytes(d)) for name, topic in log.messages.items() for t, d in zip(*topic, strict=True)]
    return Content(log.experiment, dict(log.metadata), ending, sorted(messages, key=lambda message: message[1]))


DIGITS = "9" * 5000
ESCAPES = "\x1b]0;owned\x07\x1b[2J\u202e\x9b31m"
TEXTS: Sequence[str] = (
    "",
    ESCAPES,
    DIGITS,
    "-1",
    "1e3",
    "nan",
    "\u0663",
    str(2**63),
    str(2**63 - 1),
    "x" * 200_000,
    "\n" * 99,
)
VALUES: Sequence[Any] = (
    None,
    True,
    -1,
    0,
    1e308,
    -1e-308,
    2**53,
    2**63,
    "",
    "kind",
    ESCAPES,
    [],
    {},
    [[]],
    {"kind": 1},
    "x" * 9999,
)
TREES: Sequence[str] = (
    *("", "[]", "{}", "null", "3", '"x"', "{", '{"wings": 2}', "\x1b[2J", '{"seed": 1, "seed": 2}'),
    *('{"seed": ' + DIGITS + "}", "[" * 3000, '{"a":' * 3000, '{"seed": NaN}', '{"duration": Infinity}'),
    *(
        '{"' + "x" * 100_000 + '": 1}',
        '{"plant": {"kind": "' + DIGITS + '"}}',
        '{"controller": {"horizon": 1' + "0" * 4000 + "}}",
    ),
)
NUMBERS: Sequence[bytes] = (
    *(struct.pack("<d", x) for x in (float("nan"), float("inf"), 1e308, -1e308, 1e-320)),
    *(struct.pack("<q", n) for n in (-(2**63), 2**63 - 1, -1, 2**62)),
    b"\xff" * 8,
)
TIMES = (0, 1, 2**40, 2**62, 2**63 - 1, 2**63, 2**64 - 1)
COUNT = 10
"""Messages that are changed at once."""


def _paths(tree: Any, here: tuple[str, ...] = ()) -> Iterable[tuple[str, ...]]:
    for key, value in tree.items():
        yield (*here, key)
        if isinstance(value, dict):
            yield from _paths(value, (*here, key))


@st.composite
def hostile(draw: st.DrawFn, content: Content) -> Content:
    """A log of which one thing is changed so as to hurt its reader. Its flight stays short."""
    c = Content(content.experiment, dict(content.run), dict(content.end), list(content.messages))
    text = st.sampled_from(TEXTS)
    match draw(st.sampled_from(["experiment", "field", "run", "end", "bytes", "number", "time", "attachment", "drop"])):
        case "experiment":
            c.experiment = draw(st.sampled_from(TREES))
        case "field":
            tree = json.loads(c.experiment)
            path = draw(st.sampled_from([p for p in _paths(tree) if p[-1] not in ("duration", "period", "step")]))
            place = tree
            for key in path[:-1]:
                place = place[key]
            place[path[-1]] = draw(st.sampled_from(VALUES))
            c.experiment = json.dumps(tree)
        case "run":
            c.run[draw(st.sampled_from([*c.run, "origin", "physics", ESCAPES, "x" * 9999]))] = draw(text)
        case "end":
            c.end[draw(st.sampled_from([*c.end, "error", "recovered", ESCAPES]))] = draw(text)
        case "attachment":
            c.attachments = {draw(text): draw(st.binary())}
        case "drop":
            gone = draw(st.sets(st.sampled_from(c.topics), min_size=1))
            c.messages = [message for message in c.messages if message[0] not in gone]
        case change:
            topic = draw(st.sampled_from(sorted({name for name, _, _ in c.messages})))
            rows = [i for i, (name, _, _) in enumerate(c.messages) if name == topic]
            for i in draw(st.lists(st.sampled_from(rows), min_size=1, max_size=COUNT)):
                name, time, data = c.messages[i]
                if change == "time":
                    time = draw(st.sampled_from(TIMES))
                elif change == "bytes":
                    data = draw(st.sampled_from([b"", b"\xff\x01", data[:-1], data * 2]) | st.binary(max_size=200))
                elif data:
                    at = draw(st.integers(0, len(data) - 1))
                    data = (data[:at] + draw(st.sampled_from(NUMBERS)) + data[at + 8 :])[: len(data)]
                c.messages[i] = name, time, data
    return c
