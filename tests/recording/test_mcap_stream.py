"""Our fast MCAP writer against the library's."""

from io import BytesIO
from unittest.mock import patch

import zstandard
from hypothesis import given
from hypothesis import strategies as st
from mcap.writer import Writer

from heli_twin.recording.mcap_stream import ZSTD_LEVEL, McapStream

CHANNELS = [
    ("/a", "protobuf", "A", "protobuf", b"schema"),
    ("/b", "cdr", "B", "ros2msg", b""),
    ("/c", "cdr", "B", "ros2msg", b""),
]
MESSAGES = st.lists(st.tuples(st.integers(1, 3), st.integers(0, 2**63), st.binary(max_size=300)), max_size=30)


@given(st.lists(MESSAGES, max_size=4), st.sampled_from([50, 1000, 100_000]))
def test_bytes_are_those_of_the_library(batches: list[list[tuple[int, int, bytes]]], chunk_size: int) -> None:
    with patch("mcap.writer.zstandard.compress", zstandard.ZstdCompressor(level=ZSTD_LEVEL).compress):
        assert _ours(batches, chunk_size) == _theirs(batches, chunk_size)


def _ours(batches: list[list[tuple[int, int, bytes]]], chunk_size: int) -> bytes:
    out = BytesIO()
    log = McapStream(out, library="test", chunk_size=chunk_size)
    log.metadata("run", {"key": "value", "empty": ""})
    log.attachment("file.txt", "text/plain", b"contents")
    for channel in CHANNELS:
        log.channel(*channel)
    for batch in batches:
        for message in batch:
            log.message(*message)
        log.flush()
    log.metadata("end", {})
    log.finish()
    return out.getvalue()


def _theirs(batches: list[list[tuple[int, int, bytes]]], chunk_size: int) -> bytes:
    out = BytesIO()
    log = Writer(out, chunk_size=chunk_size, enable_data_crcs=True)
    log.start(library="test")
    log.add_metadata("run", {"key": "value", "empty": ""})
    log.add_attachment(0, 0, "file.txt", "text/plain", b"contents")
    schemas: dict[str, int] = {}
    for topic, encoding, name, schema_encoding, data in CHANNELS:
        if name not in schemas:
            schemas[name] = log.register_schema(name, schema_encoding, data)
        log.register_channel(topic, encoding, schemas[name])
    for batch in batches:
        for channel, time, data in batch:
            log.add_message(channel, time, data, time)
        log.flush()
    log.add_metadata("end", {})
    log.finish()
    return out.getvalue()
