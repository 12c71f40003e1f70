"""Whatever a log says, it is read or refused in one sentence: no traceback, no hang, bounded memory."""

import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import TypeVar

import lz4.frame
import numpy as np
import pytest
import zstandard
from hostile_logs import MB, Content, chunk, content_of, file_of, hostile, message, record
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.records import Attachment, AttachmentIndex, Channel, ChunkIndex, MessageIndex, Metadata

from heli_twin import HeliTwinError, fly, load
from heli_twin.cli import main
from heli_twin.exchange.arrow_tables import tables
from heli_twin.metrics.measures import measures
from heli_twin.metrics.tracking import metrics
from heli_twin.recording import LogError, read_log, recover
from heli_twin.recording.schema import WIRES

T = TypeVar("T")
HOSTILE = settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
COMMANDS = settings(HOSTILE, max_examples=20)


@cache
def real() -> Content:
    return content_of(fly(load("lab", ["duration=0.4"]), log_dir=None).log)


@pytest.fixture(scope="module")
def content() -> Content:
    return real()


HOSTILE_LOGS = st.deferred(lambda: hostile(real()))


def test_a_log_that_is_rebuilt_is_the_log(content: Content) -> None:
    assert content_of(read_log(BytesIO(content.written()))) == content


def in_a_sentence(read: Callable[[], T]) -> T | None:
    """What is read, or None if it is refused in one short sentence."""
    try:
        return read()
    except HeliTwinError as error:
        sentence = str(error)
    assert len(sentence) < 500
    assert sentence.isprintable()
    return None


@HOSTILE
@given(log=HOSTILE_LOGS)
def test_every_reader_gives_the_log_or_one_sentence(tmp_path: Path, log: Content) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(log.written())
    path.with_name("run.recovered.mcap").unlink(missing_ok=True)
    with suppress(HeliTwinError), np.errstate(all="ignore"):
        recover(path)
    with np.errstate(all="ignore"):
        read = in_a_sentence(lambda: read_log(path))
        if read is None:
            return
        for wire in WIRES:
            in_a_sentence(lambda wire=wire: getattr(read, wire.name.rpartition("/")[2]))
        for use in (lambda log: log.reference_paths, tables, metrics, measures):
            in_a_sentence(lambda use=use: use(read))
    assert len(repr(read)) < 300
    assert "\x1b" not in repr(read) + read._repr_html_()


@COMMANDS
@given(log=HOSTILE_LOGS)
def test_every_command_does_its_work_or_says_one_sentence(
    tmp_path_factory: pytest.TempPathFactory, log: Content, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path_factory.mktemp("hostile")
    path = str(folder / "run.mcap")
    Path(path).write_bytes(log.written())
    for command in (
        ["info", path],
        ["info", path, "--json"],
        ["export", path, "--parquet", str(folder / "tables")],
        ["recover", path],
        ["replay", path, "--save", str(folder / "run.rrd")],
        ["reestimate", path],
        ["refly", path, "--no-log"],
        ["resolve", path],
    ):
        code = main(command)
        out, err = capsys.readouterr()
        assert code in (0, 1, 2), command
        assert "\x1b" not in out + err, command
        if code == 2:
            assert err.startswith("heli-twin: "), command
            assert err.count("\n") == 1, command
            assert len(err) < 500, command


# --- memory


def _big(size: int, byte: bytes = b"\0") -> bytes:
    return record(Channel(1, "/truth", "protobuf", {}, 0)) + message(byte * size)


def _zstd(content: bytes) -> bytes:
    return chunk(content, zstandard.ZstdCompressor().compress(content), "zstd")


def _one_message_400_times() -> bytes:
    body = _big(60 * MB)
    packed, at = _zstd(body), len(file_of()) - 46
    index = record(MessageIndex(1, [(0, len(body) - 60 * MB - 31)] * 400))
    place = ChunkIndex(len(packed), at, "zstd", len(packed), 0, len(index), {1: at + len(packed)}, 0, len(body))
    return file_of(packed, index, summary=record(place))


def _unknown_size(content: bytes) -> bytes:
    return zstandard.ZstdCompressor(write_content_size=False).compress(content)


ZEROS = bytes(60 * MB)
MEMORY_ATTACKS: dict[str, Callable[[], bytes]] = {
    "index": _one_message_400_times,
    "chunks": lambda: file_of(*[_zstd(_big(60 * MB))] * 400),
    "lz4 liar": lambda: file_of(chunk(b"", lz4.frame.compress(ZEROS * 8), "lz4", 1000)),
    "zstd liar": lambda: file_of(chunk(b"", zstandard.ZstdCompressor().compress(ZEROS * 8), "zstd", 1000)),
    "zstd of unknown size": lambda: file_of(chunk(b"", _unknown_size(ZEROS * 8), "zstd", 1000)),
    "zstd of great size": lambda: file_of(_zstd(ZEROS * 8)),
    "empty messages": lambda: file_of(_zstd(_big(0) + message(b"") * 1_000_000)),
    "metadata": lambda: file_of(record(Metadata("run", {str(i): "" for i in range(1_000_000)}))),
    "attachments": lambda: file_of(
        record(Attachment(0, 0, "a", "", bytes(MB))),
        summary=record(AttachmentIndex(64, MB + 70, 0, 0, MB, "a", "")) * 900,
    ),
}
READ = """
import resource, sys
from pathlib import Path
from heli_twin.recording import LogError, read_log, recover
def peak(): return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
before = peak()
for use in read_log, recover:
    for path in map(Path, sys.argv[1:]):
        try:
            use(path)
        except LogError as error:
            print(error)
print(peak() - before)
"""


def test_a_small_file_never_takes_much_memory(tmp_path: Path) -> None:
    paths = [tmp_path / f"{name}.mcap" for name in MEMORY_ATTACKS]
    for path, attack in zip(paths, MEMORY_ATTACKS.values(), strict=True):
        path.write_bytes(attack())
        assert path.stat().st_size < 30 * MB
    read = subprocess.run([sys.executable, "-c", READ, *paths], capture_output=True, text=True, check=True)
    *sentences, peak = read.stdout.splitlines()
    assert len(sentences) == 2 * len(paths)
    assert all(len(sentence) < 500 for sentence in sentences)
    # Unpacked once and copied a few times: 64 MiB, and 100 bytes for each byte of the file.
    assert int(peak) < 500, f"{peak} MB"


# --- one thing hides no other


def test_two_channels_of_one_topic_are_refused(content: Content, tmp_path: Path) -> None:
    content = Content(content.experiment, content.run, content.end, content.messages[:50])
    content.topics = [*content.topics, "/truth"]
    with pytest.raises(LogError, match="two channels for /truth"):
        read_log(BytesIO(content.written()))


def test_two_attachments_of_one_name_are_refused() -> None:
    twice = [record(Attachment(0, 0, "experiment.json", "", b"{}"))] * 2
    with pytest.raises(LogError, match=r"two attachments called experiment\.json"):
        read_log(BytesIO(file_of(*twice)))


def test_an_unknown_topic_is_refused_with_the_nearest(content: Content) -> None:
    log = BytesIO(content.written())
    with pytest.raises(LogError, match="no topic '/trut': did you mean '/truth'"):
        read_log(log, topics=["/trut"])
    assert set(read_log(log, topics=["/truth"]).messages) == {"/truth"}


def test_a_log_prints_as_a_line(content: Content) -> None:
    log = read_log(BytesIO(content.written()))
    assert repr(log).startswith("Log(flight, completed after 0.4 s, ")
    assert repr(log.messages["/truth"]) == "Messages(21 from 0 to 0.4 s)"
    assert max(len(repr(file)) for file in log.attachments.values()) < 100
    assert "<td>/truth</td>" in log._repr_html_()
    assert len(repr(fly(load("ideal", ["duration=0.1"]), log_dir=None))) < 3000
