"""A log tells of itself, as text, as JSON and as tables."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from disks import disk_of
from mcap.reader import make_reader

from heli_twin import HeliTwinError, fly, load, read_log
from heli_twin.cli import main
from heli_twin.commands.info import about
from heli_twin.commands.recover import lost, saved
from heli_twin.exchange.arrow_tables import WIRE_NAMES, table, tables
from heli_twin.metrics.tracking import metrics
from heli_twin.recording import Log, recover

WIRES = tuple(name for name in WIRE_NAMES if name not in ("/estimate_extra", "/mpc/plan_extra", "/disturbance_moment"))
"""Those with messages in this flight: its law and its air have nothing further to say."""


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    flown = fly(
        load("lab", ["duration=3", "seed=5", "radio=off"]),
        log_dir=tmp_path_factory.mktemp("flight"),
    ).path
    assert flown is not None
    return flown


@pytest.fixture(scope="module")
def log(path: Path) -> Log:
    return read_log(path)


def test_info_names_what_was_changed(log: Log) -> None:
    assert sorted(about(log)["overrides"]) == ["duration=3.0", "radio=off", "seed=5"]


def test_info_counts_what_is_there(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", str(path), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["size"] == path.stat().st_size
    assert found["topics"]["/truth"]["messages"] == 151
    # 150 periods between 151 messages.
    assert found["topics"]["/truth"]["rate"] == pytest.approx(50.0, abs=1e-9)
    assert found["metrics"] == json.loads(json.dumps(metrics(read_log(path))))
    assert (found["outcome"], found["duration"]) == ("completed", 3.0)


def test_info_reads_a_log_whose_experiment_it_cannot_fly(log: Log) -> None:
    found = about(replace(log, experiment='{"wings": 2}'))
    assert found["experiment"] is None
    assert "wings" in found["experiment_problem"]


def test_info_prints_for_a_person(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", str(path)]) == 0
    out = capsys.readouterr().out
    for words in ("radio=off", "completed after 3 s", "/mocap/pose", "version.mujoco"):
        assert words in out


@pytest.mark.parametrize("topic", WIRES)
def test_a_table_holds_the_columns_of_the_log(log: Log, topic: str) -> None:
    found = table(log, topic)
    assert found.num_rows == len(log.messages[topic].times)
    if topic != "/events":
        for name, values in getattr(log, topic.rpartition("/")[2])._asdict().items():
            column = found.column(name).combine_chunks()
            while isinstance(column, pa.FixedSizeListArray):
                column = column.flatten()
            np.testing.assert_array_equal(np.array(column.to_pylist()), values.reshape(-1))


def test_numbers_are_not_copied(log: Log) -> None:
    column = table(log, "/truth").column("position").chunk(0)
    numbers = column.values.to_numpy(zero_copy_only=True)
    assert np.shares_memory(numbers, log.truth.position)


def test_polars_reads_the_memory_of_the_log(log: Log) -> None:
    for topic in set(WIRES) - {"/events"}:
        for column in pl.DataFrame(table(log, topic)):
            # Truth values are bits in Arrow, and text is text.
            if column.dtype not in (pl.Boolean, pl.String):
                numbers = getattr(getattr(log, topic.rpartition("/")[2]), column.name)
                assert np.shares_memory(column.to_numpy(allow_copy=False), numbers)


def test_every_wire_with_messages_is_a_table(log: Log) -> None:
    assert set(tables(log)) == set(WIRES)
    assert tables(Log({})) == {}


def test_parquet_survives_the_way_to_a_file(path: Path, log: Log, tmp_path: Path) -> None:
    assert main(["export", str(path), "--parquet", str(tmp_path)]) == 0
    back = pq.read_table(tmp_path / "mpc_plan.parquet")
    assert back.equals(table(log, "/mpc/plan"))
    assert back.schema.metadata[b"digest"].decode() == log.digest
    assert {file.stem for file in tmp_path.iterdir()} == {topic[1:].replace("/", "_") for topic in WIRES}


def test_export_overwrites_nothing(path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "truth.parquet").write_text("mine")
    assert main(["export", str(path), "--parquet", str(tmp_path)]) == 2
    assert "exists already" in capsys.readouterr().err
    assert (tmp_path / "truth.parquet").read_text() == "mine"


def test_an_unknown_topic_is_refused(log: Log) -> None:
    with pytest.raises(HeliTwinError, match="/mocap/pose"):
        table(log, "/mocap")


def test_recover_says_what_was_saved_and_lost(path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    broken = tmp_path / "run.mcap.part"
    broken.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])
    assert main(["recover", str(broken)]) == 0
    out = capsys.readouterr().out
    log = read_log(tmp_path / "run.mcap")
    assert f"{1e-9 * max(log.sent.time[-1], log.acting.time[-1]):.2f} s of flight" in out
    assert "how the flight ended" in out
    assert main(["recover", str(broken)]) == 2


@pytest.mark.parametrize("name", ["run.part", "run.txt", "run.mcap"])
def test_recover_leaves_a_log_and_its_name_alone(name: str, path: Path, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(path.read_bytes())
    assert recover(tmp_path / name) == tmp_path / "run.recovered.mcap"
    assert (tmp_path / name).read_bytes() == path.read_bytes()


def test_what_is_not_there_cannot_be_recovered(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for missing in (tmp_path / "none.mcap.part", tmp_path):
        assert main(["recover", str(missing)]) == 2
        assert f"{missing} cannot be opened" in capsys.readouterr().err


def test_recover_finds_the_gap_of_a_damaged_place(path: Path, tmp_path: Path) -> None:
    data = bytearray(path.read_bytes())
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    chunk = summary.chunk_indexes[2]
    data[chunk.chunk_start_offset + chunk.chunk_length // 2] ^= 0xFF
    broken = tmp_path / "run.mcap"
    broken.write_bytes(data)
    log = read_log(recover(broken))
    # The recorder writes a chunk every 0.5 s; the gap goes from control step to control step.
    assert lost(log) == "0.52 s from 0.98 s on"
    assert "how the flight ended" not in lost(log)
    assert "s of flight" in saved(log)


def test_a_full_disk_leaves_all_of_an_export_or_nothing(path: Path, tmp_path: Path, capsys) -> None:
    with disk_of(20_000):
        assert main(["export", str(path), "--parquet", str(tmp_path)]) == 2
    assert "cannot be written" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
    assert main(["export", str(path), "--parquet", str(tmp_path)]) == 0
