"""Stores that are damaged, foreign, locked or on a full disk: one sentence, and nothing is lost."""

import sqlite3
from contextlib import closing

import hooks
import numpy as np
import pytest
from disks import disk_of
from in_process import InProcess

from heli_twin.cli import main
from heli_twin.errors import HeliTwinError
from heli_twin.studies.campaign import run_study
from heli_twin.studies.errors import StudyError
from heli_twin.studies.report import write_report
from heli_twin.studies.results import RESULTS, rows_of
from heli_twin.studies.store import Store
from heli_twin.studies.study import study_of, study_tree
from heli_twin.studies.worst import worst_runs


def run(study, folder, **options):
    return run_study(study, folder, backend=InProcess, work=hooks.pretend, **options)


def one_sentence(error):
    text = str(error)
    assert 0 < len(text) < 500
    assert "\n" not in text


def used(study, folder):
    """Everything that is done with a study's folder; the messages of what was refused."""
    told = []
    for use in (
        lambda: Store(folder).close(),
        lambda: worst_runs(folder),
        lambda: rows_of(folder),
        lambda: write_report(folder),
        lambda: run(study, folder),
    ):
        try:
            use()
        except HeliTwinError as error:
            one_sentence(error)
            told.append(str(error))
    return told


def foreign(path):
    with closing(sqlite3.connect(path)) as db:
        db.execute("CREATE TABLE flights (bird TEXT)")


def empty_store(path):
    with closing(sqlite3.connect(path)) as db:
        db.execute("PRAGMA user_version=1")


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (foreign, "another version or program"),
        (lambda path: path.write_bytes(b""), "holds no study"),
        (empty_store, "holds no study"),
        (lambda path: path.write_bytes(b"no database at all" * 99), "cannot be used"),
        (lambda path: path.mkdir(), "cannot be used"),
        (lambda path: path.symlink_to(path), "holds no study"),
    ],
    ids=["foreign", "nothing", "no tables", "text", "folder", "circle"],
)
def test_what_is_no_store_is_told(small, tmp_path, make, words):
    make(tmp_path / "results.sqlite")
    told = used(small, tmp_path)
    assert len(told) >= 4
    assert words in told[0]


def test_a_store_without_its_facts_is_told(small, tmp_path):
    Store(tmp_path, write=True).close()
    assert "holds no study" in used(small, tmp_path)[1]


def damaged(data, rng):
    """Bytes cut, changed or zeroed somewhere."""
    place, size = int(rng.integers(0, len(data))), int(rng.integers(1, 3000))
    match rng.integers(0, 3):
        case 0:
            return data[:place]
        case 1:
            return data[:place] + rng.bytes(min(size, len(data) - place)) + data[place + size :]
        case _:
            return data[:place] + bytes(min(size, len(data) - place)) + data[place + size :]


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("name", ["results.sqlite", RESULTS])
def test_random_damage_is_told_or_does_no_harm(small, tmp_path, seed, name):
    run(small, tmp_path)
    file = tmp_path / name
    file.write_bytes(damaged(file.read_bytes(), np.random.default_rng(seed)))
    told = used(small, tmp_path)
    if name == RESULTS:
        # The store has the same rows.
        assert told == []


def test_a_locked_store_is_told(small, tmp_path, monkeypatch):
    run(small, tmp_path)
    real = sqlite3.connect
    monkeypatch.setattr(sqlite3, "connect", lambda *args, **options: real(*args, **{**options, "timeout": 0.05}))
    with closing(real(tmp_path / "results.sqlite", isolation_level=None)) as other:
        other.execute("BEGIN EXCLUSIVE")
        told = used(small, tmp_path)
    assert len(told) == 5
    assert all("in use by another program" in text for text in told)
    assert used(small, tmp_path) == []


def test_a_lock_that_is_no_lock_is_told(small, tmp_path):
    (tmp_path / "lock.sqlite").write_text("no lock" * 500)
    with pytest.raises(StudyError, match="cannot lock"):
        run(small, tmp_path)


def test_a_folder_that_is_a_file_is_told(small, tmp_path):
    (tmp_path / "out").write_text("")
    with pytest.raises(StudyError, match="cannot write to"):
        run(small, tmp_path / "out")


@pytest.mark.parametrize("size", [0, 5_000, 20_000, 60_000, 100_000, 140_000])
def test_a_full_disk_is_told_and_loses_nothing(small, tmp_path, size):
    wide = study_of(study_tree(small) | {"replicates": 100})
    with pytest.raises(StudyError, match="cannot") as refusal, disk_of(size):
        run(wide, tmp_path)
    one_sentence(refusal.value)
    for text in used(small, tmp_path / "nowhere")[:1]:
        assert "holds no study" in text
    try:
        before = len(rows_of(tmp_path))
    except StudyError as error:
        one_sentence(error)
        before = 0
    assert run(wide, tmp_path).flown == 300 - before
    assert len(rows_of(tmp_path)) == 300


def test_the_command_ends_with_2_where_the_disk_is_full(tmp_path, capsys):
    with disk_of(60_000):
        code = main(["study", "run", "mass", "duration=0.1", "replicates=1", "--workers", "1", "--out", str(tmp_path)])
    assert code == 2
    assert capsys.readouterr().err.startswith("heli-twin: cannot write")


def test_a_finished_study_is_one_file_without_a_journal(small, tmp_path):
    run(small, tmp_path)
    assert not list(tmp_path.glob("results.sqlite-*"))
