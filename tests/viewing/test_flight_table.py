"""A table of many flights: which rows, in what order, and what Rerun's server has of them."""

import shutil
from functools import partial
from pathlib import Path

import hooks
import pytest
from in_process import InProcess

from heli_twin import HeliTwinError, fly, load
from heli_twin.cli import main
from heli_twin.recording import read_log
from heli_twin.studies.browse import table_of
from heli_twin.studies.campaign import run_study
from heli_twin.studies.results import rows_of
from heli_twin.studies.study import study_of
from heli_twin.viewing.flight_table import FLIGHT, FlightTable, served, thinned

GUST = "disturbances.gust.strength"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = fly(load("ideal", ["duration=2.2"]), log_dir=tmp_path_factory.mktemp("run")).path
    assert path is not None
    return path


@pytest.fixture(scope="module")
def study(run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Ten pretended flights, whose error is their gust and whose gusts above 0.8 crash; two have a log."""
    folder = tmp_path_factory.mktemp("study")
    tree = {"name": "gusty", "base": {"preset": "ideal", "disturbances": {"gust": "on"}}, "metrics": ["rmse.x"]}
    swept = study_of({**tree, "axes": {GUST: {"linspace": [0.1, 1.0, 10]}}, "logs": {"worst": 0, "sampled": 0}})
    run_study(swept, folder, backend=InProcess, work=partial(hooks.rough, 0.85))
    for row in rows_of(folder):
        if row[GUST] in (0.3, 1.0):
            (folder / "logs").mkdir(exist_ok=True)
            shutil.copy(run, folder / "logs" / f"{row['id']}.mcap")
    return folder


def test_flights_that_failed_stand_first_and_then_the_worst(study: Path) -> None:
    table = table_of([study])
    assert table.columns.column("outcome").to_pylist() == ["crashed"] * 2 + ["completed"] * 8
    assert table.columns.column("strength, m/s").to_pylist() == [0.9, 1.0, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1]
    assert table.columns.column("rms, cm").to_pylist()[2:] == [80.0, 70.0, 60.0, 50.0, 40.0, 30.0, 20.0, 10.0]
    assert [log is not None for log in table.logs] == [False, True, *[False] * 5, True, False, False]
    ids = {row["id"] for row in rows_of(study)}
    commands = table.columns.column("command").to_pylist()
    assert {Path(command.split()[-1]).stem for command in commands} == ids
    assert ["replay" in command for command in commands] == [log is not None for log in table.logs]


def test_logs_are_a_table_too(run: Path, tmp_path: Path) -> None:
    crashed = fly(load("lab", ["duration=3", "plant.thrust_gain=0.2"]), log_dir=tmp_path).path
    assert crashed is not None
    shutil.copy(run, tmp_path / "0.mcap")
    table = table_of([tmp_path])
    assert table.logs == [crashed, tmp_path / "0.mcap"]
    assert table.columns.column("flown").to_pylist() == ["duration=3.0 plant.thrust_gain=0.2", "ideal duration=2.2"]
    assert table.columns.column("rms, cm").to_pylist()[1] < 0.1


def test_the_server_has_a_row_a_flight_and_a_recording_a_log(study: Path) -> None:
    pytest.importorskip("datafusion")
    from rerun.catalog import CatalogClient

    flights = table_of([study])
    with served(flights) as address:
        assert address.startswith("rerun+http://127.0.0.1:")
        client = CatalogClient(address.partition("/entry/")[0])
        dataset, table = client.get_dataset("flights"), client.get_table("gusty")
        assert address.endswith(str(table.id))
        rows = table.to_arrow_reader().read_all()
        links = rows.column(FLIGHT).to_pylist()
        assert [link is not None for link in links] == [log is not None for log in flights.logs]
        assert sorted(link.partition("segment_id=")[2] for link in links if link) == sorted(dataset.segment_ids())
        assert rows.column("column_0").to_pylist() == flights.columns.column("outcome").to_pylist()
        assert len(dataset.blueprints()) == len(table.blueprints()) == 1


def test_flights_far_down_are_shown_at_a_tenth_of_their_samples(run: Path) -> None:
    log = read_log(run)
    few = thinned(log, 10)
    assert few.truth.time.tolist() == log.truth.time[::10].tolist()
    assert (few.events, len(few.reference_paths)) == (log.events, len(log.reference_paths))
    assert thinned(log, 1).messages == log.messages


def test_without_rerun_s_catalog_it_says_what_to_install(study: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "datafusion", None)
    with pytest.raises(HeliTwinError, match=r"pip install 'heli-twin\[table\]'"), served(table_of([study])):
        pass


@pytest.fixture
def _with_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("heli_twin.viewing.viewer_process.has_screen", lambda: True)


@pytest.mark.usefixtures("_with_screen")
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["."], "holds neither a study nor a log"),
        ([".", "--save", "x.rrd"], "a table of flights needs Rerun's server and fits into no file"),
        (["a.mcap", "b.mcap", "c.mcap"], "a.mcap"),
        (["x.mcap", "--web", "--port", "80"], "--port 80: give one from 1024 to 65534"),
    ],
)
def test_what_cannot_be_shown_is_told_in_one_line(
    words: list[str],
    said: str,
    run: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copy(run, "x.mcap") if "x.mcap" in words else None
    assert main(["replay", *words]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1


def test_an_empty_table_is_refused() -> None:
    pytest.importorskip("datafusion")
    import pyarrow as pa

    with pytest.raises(HeliTwinError, match="has no flights"), served(FlightTable("none", pa.table({}), [])):
        pass
