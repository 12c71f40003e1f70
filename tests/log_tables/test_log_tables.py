"""Tables over logs: every file has a row, a filter keeps what it says, statistics are evo's."""

import csv
import io
import json
import shutil
import struct
from pathlib import Path

import numpy as np
import pytest

from heli_twin import HeliTwinError, fly, load, read_log
from heli_twin.cli import main
from heli_twin.log_tables.rows import head_row
from heli_twin.log_tables.where import comparisons, matching
from heli_twin.metrics.motion import errors, statistics
from heli_twin.recording.head import read_head


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("logs")
    for name, words in (
        ("light", ["plant.mass=0.026"]),
        ("heavy", ["plant.mass=0.031", "seed=1"]),
        ("pid", ["controller=pid", "trajectory=hover"]),
    ):
        flown = fly(load("lab", ["duration=2.5", *words]), log_dir=folder).path
        assert flown is not None
        flown.rename(folder / f"{name}.mcap")
    whole = (folder / "light.mcap").read_bytes()
    (folder / "broken.mcap.part").write_bytes(whole[: len(whole) // 2])
    (folder / "foreign\x1b[2J.mcap").write_bytes(b"something else")
    return folder


def listed(capsys: pytest.CaptureFixture[str], *words: object) -> list[str]:
    assert main(["ls", *map(str, words), "--json"]) == 0
    return [Path(row["file"]).name.partition(".")[0] for row in json.loads(capsys.readouterr().out)]


def test_a_head_is_the_log_without_its_messages(folder: Path) -> None:
    for name in ("light", "pid"):
        head, log = read_head(folder / f"{name}.mcap"), read_log(folder / f"{name}.mcap")
        assert (head.ending, head.metadata, head.experiment) == (log.ending, log.metadata, log.experiment)


def test_a_head_that_is_damaged_is_refused(folder: Path, tmp_path: Path) -> None:
    whole = (folder / "light.mcap").read_bytes()
    # The footer: opcode, length, where the index begins, where its offsets begin, its checksum; then the magic.
    (start,) = struct.unpack_from("<Q", whole, len(whole) - 28)
    for at in range(start, len(whole) - 37, 97):
        data = bytearray(whole)
        data[at] ^= 1
        (tmp_path / "x.mcap").write_bytes(data)
        with pytest.raises(HeliTwinError, match="damaged"):
            read_head(tmp_path / "x.mcap")


def test_every_file_has_a_row(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["ls", str(folder)]) == 0
    out = capsys.readouterr().out
    assert "\x1b" not in out
    for words in ("light.mcap", "plant.mass=0.031 seed=1", "hover pid", "completed", "heli-twin recover", "no", " cm"):
        assert words in out
    assert "5 logs, 2 of them cannot be read" in out


def test_the_numbers_are_the_metrics(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["ls", str(folder / "heavy.mcap"), "--json"]) == 0
    (row,) = json.loads(capsys.readouterr().out)
    found = statistics(read_log(folder / "heavy.mcap"))
    assert found is not None
    assert row["rmse.position"] == pytest.approx(found["position"]["rmse"])
    assert (row["duration"], row["outcome"], row["trajectory"]) == (pytest.approx(2.5), "completed", "circle")
    assert row["error.x.sse"] == found["x"]["sse"]
    assert row["changes"] == ["duration=2.5", "plant.mass=0.031", "seed=1"]


def test_quick_reads_no_message(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("heli_twin.log_tables.rows.read_log", None)
    assert listed(capsys, folder, "--quick") == ["light", "heavy", "pid", "broken", "foreign\x1b[2J"]


def test_a_filter_keeps_what_it_says(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert listed(capsys, folder, "where", "plant.mass>0.028", "--quick") == ["heavy"]
    assert listed(capsys, folder, "where", "plant.mass >= 26 g and controller = ltv_mpc", "--quick") == [
        "light",
        "heavy",
    ]
    assert listed(capsys, folder, "where", "trajectory!=hover", "seed<1", "--quick") == ["light"]
    found = {name: statistics(read_log(folder / f"{name}.mcap")) for name in ("light", "heavy", "pid")}
    rms = {name: each["position"]["rmse"] for name, each in found.items() if each}
    kept = listed(
        capsys, folder, "where", f"rmse.position<{100 * max(rms.values()) - 1e-9}cm", "--sort", "rmse.position"
    )
    assert kept == sorted(rms, key=rms.__getitem__)[:2]


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["where", "plant.mas>1"], "did you mean 'plant.mass'"),
        (["where", "plant.mass>heavy"], "plant.mass is 0.0"),
        (["where", "plant.mass"], "no comparison"),
        (["where"], "followed by nothing"),
        (["where", "rmse.x>1cm", "--quick"], "leave out --quick"),
        (["--sort", "rmse.w"], "did you mean 'rmse."),
    ],
)
def test_a_mistake_is_one_sentence(
    words: list[str], sentence: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["ls", str(folder), *words]) == 2
    error = capsys.readouterr().err
    assert sentence in error
    assert error.count("\n") == 1
    assert len(error) < 500


def test_a_folder_without_logs_says_where_they_are(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "below").mkdir()
    shutil.copy(folder / "pid.mcap", tmp_path / "below")
    assert main(["ls", str(tmp_path)]) == 2
    assert "--recursive" in capsys.readouterr().err
    assert listed(capsys, tmp_path, "-r", "--quick") == ["pid"]


def test_statistics_are_those_of_evo(folder: Path) -> None:
    log = read_log(folder / "heavy.mcap")
    time, error = errors(log)
    norm = np.linalg.norm(error[time >= 2.0, :3], axis=1)
    found = statistics(log)
    assert found is not None
    expected = {"rmse": np.sqrt((norm**2).mean()), "mean": norm.mean(), "median": np.median(norm), "std": norm.std()}
    expected |= {"min": norm.min(), "max": norm.max(), "sse": (norm**2).sum()}
    assert found["position"] == pytest.approx(expected, rel=1e-12)
    assert statistics(log, 3.0) is None


def test_compare_tells_what_differs_and_how_well(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    paths = [str(folder / f"{name}.mcap") for name in ("light", "heavy", "pid")]
    assert main(["compare", *paths]) == 0
    out = capsys.readouterr().out
    for words in ("plant.mass", "0.026", "0.031", "0.028", "ltv_mpc", "sse"):
        assert words in out
    assert main(["compare", *paths, "--sort", "rmse", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    rms = [flight["error.position.rmse"] for flight in found["flights"]]
    assert rms == sorted(rms)
    assert main(["compare", *paths, "--csv", "--from", "0"]) == 0
    rows = list(csv.DictReader(io.StringIO(capsys.readouterr().out)))
    assert [row["name"] for row in rows] == ["A", "B", "C"]
    assert float(rows[0]["error.z.max"]) > 0


@pytest.mark.parametrize("words", [["--from", "3", "--to", "1"], ["--sort", "rms"], ["--from", "nan"]])
def test_compare_refuses_a_mistake(words: list[str], folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["compare", str(folder / "pid.mcap"), *words]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_values_may_have_units() -> None:
    values = [each.value for each in comparisons("a<5cm and b>=2 deg and solve_ms.p50>1ms and c==true and d=hover")]
    assert values == [0.05, pytest.approx(np.radians(2)), 1.0, True, "hover"]


def test_a_text_cannot_be_less_than_a_number(folder: Path) -> None:
    with pytest.raises(HeliTwinError, match="cannot compare"):
        matching([head_row(folder / "pid.mcap")], comparisons("outcome<3"))
