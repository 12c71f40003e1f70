"""The file: deterministic, readable by others, safe against crashes, and damage is noticed."""

import signal
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import cache
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from disks import disk_of
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.records import Message
from mcap.stream_reader import StreamReader
from mcap.writer import Writer
from mcap_protobuf.decoder import DecoderFactory

from controllers.signals import Pose
from heli_twin.recording import Ending, LogError, Recorder, read_log, recover
from heli_twin.recording.mcap_stream import McapStream
from heli_twin.recording.schema import FORMAT, TIMING

Record = Callable[..., Recorder]

POSE = Pose(0, np.zeros(3), np.array([1.0, 0, 0, 0]))
KILLED_AT = 1_740_000_000


@pytest.fixture(scope="module")
def whole(record: Record, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A whole log."""
    return record(tmp_path_factory.mktemp("whole") / "run.mcap", seconds=2.2).path


def _bytes(recorder: Recorder) -> bytes:
    recorder.stream.seek(0)
    return recorder.stream.read()


def test_same_flight_same_bytes(record: Record) -> None:
    assert _bytes(record()) == _bytes(record())


def test_flights_in_threads_do_not_mix(record: Record) -> None:
    with ThreadPoolExecutor(4) as threads:
        logs = list(threads.map(lambda seed: _bytes(record(seed=seed)), [1, 2, 1, 2]))
    assert logs == [_bytes(record(seed=seed)) for seed in (1, 2, 1, 2)]


def test_in_memory_and_in_a_file_are_the_same(record: Record, tmp_path: Path) -> None:
    record(tmp_path / "run.mcap")
    assert (tmp_path / "run.mcap").read_bytes() == _bytes(record())


def test_only_measured_times_may_differ(record: Record) -> None:
    fast, slow = (record(compute_ns=ns, started=started).log() for ns, started in ((5, "Monday"), (10**9, "Tuesday")))
    assert fast.digest == slow.digest != ""
    assert fast.metadata != slow.metadata
    assert {topic for topic in fast.messages if fast.messages[topic] != slow.messages[topic]} == {TIMING}


def test_another_flight_has_another_digest(record: Record) -> None:
    assert record(seed=1).digest != record(seed=2).digest


def test_the_experiment_is_part_of_the_digest() -> None:
    assert Recorder(experiment="{}").digest != Recorder(experiment='{"seed":1}').digest


def test_the_library_reads_every_message(record: Record) -> None:
    recorder = record(seconds=0.7)
    log = recorder.log()
    recorder.stream.seek(0)
    streamed = [r for r in StreamReader(recorder.stream, validate_crcs=True).records if isinstance(r, Message)]
    assert len(streamed) == sum(len(topic.times) for topic in log.messages.values())
    assert all(message.log_time == message.publish_time for message in streamed)


def test_an_independent_decoder_finds_the_same_values(record: Record) -> None:
    recorder = record(seconds=0.7)
    log = recorder.log()
    recorder.stream.seek(0)
    reader = make_reader(recorder.stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
    topics = ["/truth", "/mpc/plan", "/mpc/qp", "/events"]
    decoded = {topic: [m for _, _, _, m in reader.iter_decoded_messages(topics=topic)] for topic in topics}
    np.testing.assert_array_equal([m.position for m in decoded["/truth"]], log.truth.position)
    np.testing.assert_array_equal(np.reshape([m.u for m in decoded["/mpc/plan"]], log.plan.u.shape), log.plan.u)
    assert [m.iterations for m in decoded["/mpc/qp"]] == log.qp.iterations.tolist()
    assert [m.message for m in decoded["/events"]] == [event.text for event in log.events]


def test_the_file_gets_its_name_at_the_end(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "new" / "run.mcap")
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["run.mcap.part"]
    recorder.close("completed", 0)
    recorder.close("completed", 0)
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["run.mcap"]


def test_a_log_is_never_overwritten(tmp_path: Path) -> None:
    Recorder(tmp_path / "run.mcap").close("completed", 0)
    with pytest.raises(LogError, match=r"run\.mcap exists already"):
        Recorder(tmp_path / "run.mcap")


def test_a_flight_that_raises_leaves_an_aborted_log(tmp_path: Path) -> None:
    with suppress(ZeroDivisionError), Recorder(tmp_path / "run.mcap") as recorder:
        recorder.pose(30, POSE)
        raise ZeroDivisionError("oh")
    log = read_log(tmp_path / "run.mcap")
    assert (log.outcome, log.ending.time, log.ending.error) == ("aborted", 30, "ZeroDivisionError('oh')")


def test_listeners_get_every_message() -> None:
    heard = []
    recorder = Recorder(listeners=[lambda *message: heard.append(message)])
    recorder.pose(30, POSE)
    recorder.close("completed", 30)
    assert [(topic, t) for topic, t, _ in heard] == [("/robot_description", 0), ("/mocap/pose", 30), ("/tf", 30)]
    assert heard[1][2] == recorder.log().messages["/mocap/pose"].data[0]


def test_unknown_names_are_refused() -> None:
    with pytest.raises(LogError, match="unknown severity 'bad': use one of debug, info, warning, error, fatal"):
        Recorder().event(0, "bad", "name", "text")


# --- when writing goes wrong


def test_a_folder_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(LogError, match="cannot be written"):
        Recorder(tmp_path / "file" / "run.mcap")


def test_a_disk_that_is_full_from_the_start(tmp_path: Path) -> None:
    with disk_of(10), pytest.raises(LogError, match="make room"):
        Recorder(tmp_path / "run.mcap")


def test_an_unfinished_log_is_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "run.mcap.part").touch()
    with pytest.raises(LogError, match=r"run\.mcap\.part exists already"):
        Recorder(tmp_path / "run.mcap")


def test_a_full_disk_is_told_once_and_loses_nothing_written(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    recorder = Recorder(tmp_path / "run.mcap")
    with disk_of(100_000):
        _record_poses(recorder, rng)
        recorder.close("completed", 10**10)
    assert [path.name for path in tmp_path.iterdir()] == ["run.mcap.part"]
    assert len(read_log(recover(tmp_path / "run.mcap.part")).pose.time) >= 500


def _record_poses(recorder: Recorder, rng: np.random.Generator) -> None:
    for t in range(0, 10**10, 10**6):
        recorder.pose(t, Pose(t, rng.standard_normal(3), rng.standard_normal(4)))


KILLED = f"""
import os, signal, sys
from pathlib import Path
import numpy as np
from controllers.signals import Pose
from heli_twin.recording import Recorder
recorder = Recorder(Path(sys.argv[1]), experiment='{{"seed":1}}')
for t in range(0, {KILLED_AT} + 1, 20_000_000):
    recorder.pose(t, Pose(t, np.zeros(3), np.zeros(4)))
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_kill_9_loses_at_most_half_a_second(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    flight = subprocess.run([sys.executable, "-c", KILLED, path], check=False, env={"PYTHONPATH": ":".join(sys.path)})
    assert flight.returncode == -signal.SIGKILL
    part = path.with_name("run.mcap.part")
    with pytest.raises(LogError, match="interrupted: run `heli-twin recover`"):
        read_log(part)
    assert recover(part) == path
    log = read_log(path)
    assert log.pose.time[-1] >= KILLED_AT - 500_000_000
    assert (log.experiment, log.outcome, log.ending.time) == ('{"seed":1}', "interrupted", log.pose.time[-1])


# --- what is read may be anything

DAMAGED = settings(max_examples=300, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)


@given(where=st.floats(0, 1, exclude_max=True))
def test_a_truncated_log_is_refused(whole: Path, where: float) -> None:
    contents = whole.read_bytes()
    with pytest.raises(LogError, match=r"empty|not an MCAP|interrupted"):
        read_log(BytesIO(contents[: int(where * len(contents))]))


@given(where=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7))
def test_a_flipped_bit_is_noticed(whole: Path, where: float, bit: int) -> None:
    with suppress(LogError):
        assert read_log(BytesIO(_flipped(whole, where, bit))) == read_log(whole)


@DAMAGED
@given(st.data())
def test_a_damaged_log_is_refused_or_read_as_it_was(whole: Path, data: st.DataObject) -> None:
    contents = whole.read_bytes()
    damaged = data.draw(damages(contents))
    with suppress(LogError):
        log = read_log(BytesIO(damaged))
        assert log == read_log(BytesIO(contents))


@DAMAGED
@given(st.data())
def test_what_is_recovered_is_true(whole: Path, tmp_path: Path, data: st.DataObject) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(data.draw(damages(whole.read_bytes())))
    path.with_name("run.recovered.mcap").unlink(missing_ok=True)
    good = read_log(whole)
    try:
        log = read_log(recover(path))
    except LogError:
        return
    assert log.experiment == good.experiment
    for topic, messages in log.messages.items():
        whole_topic = [*zip(good.messages[topic].times, good.messages[topic].data, strict=True)]
        left = [*zip(messages.times, messages.data, strict=True)]
        found = iter(whole_topic)
        assert all(message in found for message in left), f"{topic} is not a part of what it was, in its order"
    assert log.metadata in ({}, good.metadata)
    last = max((messages.times[-1] for messages in log.messages.values() if len(messages.times)), default=0)
    lost = Ending("interrupted", last, recovered=True)
    assert log.ending in (lost, good.ending._replace(recovered=True))


@st.composite
def damages(draw: st.DrawFn, contents: bytes) -> bytes:
    """What disks and people do to a file: bits flipped, a stretch zeroed, cut, copied or moved, the end lost."""
    damaged = bytearray(contents)
    for _ in range(draw(st.integers(1, 3))):
        size = len(damaged)
        if not size:
            break
        a, b = sorted(draw(st.tuples(*[st.integers(0, size - 1)] * 2)))
        match draw(st.sampled_from(["flip", "zero", "cut", "copy", "move", "truncate", "repeat a chunk"])):
            case "flip":
                damaged[a] ^= 1 << draw(st.integers(0, 7))
            case "zero":
                b = min(b, a + 4096)
                damaged[a:b] = bytes(b - a)
            case "cut":
                del damaged[a : min(b, a + 5000)]
            case "copy":
                damaged[b:b] = damaged[a : a + 3000]
            case "move":
                damaged[a:b] = damaged[b : b + 1000] + damaged[a:b]
            case "truncate":
                del damaged[b:]
            case _:
                starts = _chunk_starts(contents)
                i, j = draw(st.tuples(*[st.integers(0, len(starts) - 2)] * 2))
                damaged[starts[i] : starts[i]] = contents[starts[j] : starts[j + 1]]
    return bytes(damaged)


@cache
def _chunk_starts(contents: bytes) -> list[int]:
    summary = make_reader(BytesIO(contents)).get_summary()
    assert summary is not None
    return [index.chunk_start_offset for index in summary.chunk_indexes]


def _flipped(path: Path, where: float, bit: int) -> bytes:
    damaged = bytearray(path.read_bytes())
    damaged[int(where * len(damaged))] ^= 1 << bit
    return bytes(damaged)


def test_one_damaged_chunk_costs_only_itself(whole: Path, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(_flipped(whole, 0.75, 3))
    log = read_log(recover(path))
    assert 0 < len(log.truth.time) < len(read_log(whole).truth.time)
    assert (log.outcome, log.ending.recovered) == ("completed", True)


def test_what_is_not_a_flight_cannot_be_recovered(tmp_path: Path) -> None:
    (tmp_path / "run.mcap").write_bytes(b"text")
    with pytest.raises(LogError, match=r"run\.mcap cannot be recovered: it is not a flight of heli-twin"):
        recover(tmp_path / "run.mcap")


@pytest.mark.parametrize("junk", [b"", b"text", b"\x89MCAP0\r\n", b"\x89MCAP0\r\n" * 2, b"\x89MCAP0\r\n" + bytes(200)])
def test_junk_is_refused(junk: bytes) -> None:
    with pytest.raises(LogError):
        read_log(BytesIO(junk))


@given(st.binary())
def test_any_bytes_are_refused(junk: bytes) -> None:
    magic = b"\x89MCAP0\r\n"
    with pytest.raises(LogError):
        read_log(BytesIO(magic + junk + magic))


def test_no_such_file(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"run\.mcap cannot be opened: No such file"):
        read_log(tmp_path / "run.mcap")


def test_a_log_of_something_else_is_refused() -> None:
    stream = BytesIO()
    writer = Writer(stream)
    writer.start()
    writer.add_metadata("other", {})
    writer.finish()
    with pytest.raises(LogError, match="not a flight of heli-twin"):
        read_log(stream)


def test_a_newer_log_is_refused() -> None:
    stream = BytesIO()
    writer = McapStream(stream, library="heli_twin", chunk_size=1000)
    writer.metadata("heli_twin", {"format": str(FORMAT + 1)})
    writer.finish()
    with pytest.raises(LogError, match=f"has log format {FORMAT + 1}, written by a newer heli-twin"):
        read_log(stream)


def test_messages_of_another_layout_are_refused(record: Record) -> None:
    stream = BytesIO()
    writer = McapStream(stream, library="heli_twin", chunk_size=1000)
    writer.metadata("heli_twin", {"format": str(FORMAT)})
    writer.attachment("experiment.json", "application/json", b"{}")
    for topic in ("/truth", "/mpc/plan", "/mpc/qp", "/events"):
        writer.message(writer.channel(topic, "protobuf", "X", "protobuf", b""), 0, b"\xff\x01")
    writer.finish()
    log = read_log(stream)
    for column in ("truth", "plan", "qp", "events"):
        with pytest.raises(LogError, match="cannot be read"):
            getattr(log, column)
