"""Runs whose control law is a program that failed: neither completed nor a failure, and flown again."""

import json
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from controllers import programs
from heli_twin import HeliTwinError
from heli_twin.cli import main
from heli_twin.studies.campaign import run_study
from heli_twin.studies.designs.margin import Search, bracket
from heli_twin.studies.plan import plan_of
from heli_twin.studies.report import write_report
from heli_twin.studies.report.results import results_of
from heli_twin.studies.results import rows_of
from heli_twin.studies.store import Store
from heli_twin.studies.study import Study, load_study, study_of
from heli_twin.studies.worst import worst_runs
from heli_twin.workers.engine import Trouble

LAW = """
import os, sys
sys.stdin.readline()
print("heli_twin 1", flush=True)
for line in sys.stdin:
    now, *rest = line.split()
    if int(now) > 200_000_000 and len(sys.argv) > 1 and os.path.exists({flag!r}):
        sys.exit("no more charge")
    print(now, 0, 0, 0.545, 0, flush=True)
"""


@pytest.fixture(autouse=True)
def nothing_named() -> Iterator[None]:
    programs._named.clear()
    programs._supplied.clear()
    yield
    programs._named.clear()
    programs._supplied.clear()


@pytest.fixture
def study(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Study:
    """A steady law and one that fails as long as there is a file `broken`."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "law.py").write_text(LAW.format(flag=str(tmp_path / "broken")))
    (tmp_path / "broken").touch()
    steady: list[str] = ["python3", "law.py"]
    return study_of(
        {
            "name": "programs",
            "base": {"preset": "lab", "duration": 0.5, "trajectory": "hover", "controller": "external"},
            "alternatives": {
                "steady": {"controller.command": steady},
                "flaky": {"controller.command": [*steady, "flaky"]},
            },
            "replicates": 2,
        }
    )


class Elsewhere:
    """A worker in this process on a machine without the files of the driver."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def workers(self) -> int:
        return 1

    def submit(self, work: Any, task: Any) -> Any:
        from concurrent.futures import Future

        future: Future[Any] = Future()
        here = dict(programs._named)
        programs._named.clear()
        try:
            sent = tuple(
                program._replace(words=tuple(w.replace(str(self.folder), "/not/here") for w in program.words))
                for program in task.programs
            )
            future.set_result(work(task._replace(programs=sent)))
        finally:
            programs._named.clear()
            programs._named.update(here)
        return future

    def trouble(self, error: BaseException) -> Trouble:
        return Trouble("error", str(error))

    def __enter__(self) -> "Elsewhere":
        return self

    def __exit__(self, *stopped: object) -> None: ...


def inline(plan: Any, timeout: float) -> Elsewhere:
    """A backend that flies in this process."""
    return Elsewhere(Path("/no/such/folder"))


def test_an_invalid_run_is_no_failure_and_is_flown_again_on_resume(study: Study, tmp_path: Path) -> None:
    out = tmp_path / "out"
    progress = run_study(study, out)
    assert progress.failed == {"invalid": 2}
    rows = {(row["alternative"], row["seed"]): row for row in rows_of(out)}
    assert [rows["steady", seed]["outcome"] for seed in (0, 1)] == ["completed"] * 2
    flaky = rows["flaky", 0]
    assert "digest" not in flaky or flaky["digest"] is None
    assert flaky["outcome"] == "invalid"
    assert flaky["outcome_text"].startswith("law.py failed as a control law at 0.22 s: it ended with exit code 1")
    assert flaky["attempts"] == 2
    results = results_of(out)
    assert (len(results), results.invalid, int(results.failed.sum())) == (2, 2, 0)
    assert worst_runs(out) == []
    told = "2 invalid runs are left out" in write_report(out).read_text()
    assert told
    digest = rows["steady", 0]["digest"]
    (tmp_path / "broken").unlink()
    progress = run_study(study, out, backend=inline)
    assert (progress.flown, progress.failed) == (2, {})
    rows = {(row["alternative"], row["seed"]): row for row in rows_of(out)}
    assert {row["outcome"] for row in rows.values()} == {"completed"}
    assert rows["steady", 0]["digest"] == digest
    assert results_of(out).invalid == 0


def test_a_report_of_invalid_runs_alone_says_why(study: Study, tmp_path: Path) -> None:
    changes: Any = {"base": study.base | {"controller.command": ["python3", "law.py", "flaky"]}}
    run_study(study_of({"name": "x", **changes}), tmp_path / "out", backend=inline)
    with pytest.raises(HeliTwinError, match=r"all runs of .* are invalid, the first since law.py failed"):
        write_report(tmp_path / "out")


def test_a_store_holds_no_path_and_starts_no_program(
    study: Study, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "broken").unlink()
    out = tmp_path / "out"
    run_study(study, out, backend=inline)
    (row,) = [row for row in rows_of(out) if row["alternative"] == "flaky" and row["seed"] == 0]
    with Store(out) as store:
        everything = json.dumps([store.about()["study"], store.about()["base"], store.find(row["id"])])
    assert str(tmp_path) not in everything
    assert "law.py@" in everything
    programs._named.clear()
    assert main(["study", "fly", "out", row["id"]]) == 2
    assert "--with ./pid where a log or a store is read" in capsys.readouterr().err
    assert main(["study", "fly", "out", row["id"], "--with", '["python3", "law.py", "flaky"]']) == 0
    assert main(["study", "report", "out"]) == 0
    programs._supplied.clear()
    with closing(sqlite3.connect(out / "results.sqlite")) as database:
        database.execute("UPDATE settings SET changes = replace(changes, 'python3@PATH', 'touch')")
        database.commit()
    assert main(["study", "fly", "out", row["id"], "--with", '["python3", "law.py", "flaky"]']) == 2
    assert "no program is run because they say so" in capsys.readouterr().err


def test_a_program_goes_along_to_another_machine(study: Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "temporary"))
    (tmp_path / "temporary").mkdir()
    (tmp_path / "broken").unlink()
    run_study(study, tmp_path / "here", backend=inline)
    run_study(study, tmp_path / "there", backend=lambda plan, timeout: Elsewhere(tmp_path))
    here, there = ([row["digest"] for row in rows_of(tmp_path / name)] for name in ("here", "there"))
    assert here == there
    assert list((tmp_path / "temporary").iterdir()) == []


def test_a_large_program_has_to_be_on_the_other_machine(
    study: Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(programs, "MAX_SENT_BYTES", 10)
    run_study(study, tmp_path / "there", backend=lambda plan, timeout: Elsewhere(tmp_path))
    (row, *_) = rows_of(tmp_path / "there")
    assert row["outcome"] == "invalid"
    assert "put the same file under the same path here" in row["outcome_text"]


def test_a_search_learns_nothing_from_an_invalid_run() -> None:
    criteria = {"rmse.x": 1.0}
    good, bad = ({"outcome": "completed", "rmse.x": x} for x in (0.5, 2.0))
    rows = [good | {"share": 0.0}, {"outcome": "invalid", "share": 0.5}, bad | {"share": 1.0}]
    assert bracket(rows, "rmse.x", criteria) == (0.0, 1.0)
    search = Search("a", "base", 0, "rmse.x", 0.0, 1.0)
    search.learn({"outcome": "invalid"}, criteria)
    assert (search.low, search.high) == (0.0, 1.0)


def test_a_program_in_a_study_file_stands_beside_the_file(
    study: Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "x.toml").write_text(
        'tuning = [{ command = "heli-twin tune", controller = { kind = "pid" } }]\n'
        '[axes]\n"controller.command" = [["python3", "law.py"], ["python3", "law.py", "flaky"]]\n'
        '[base]\ncontroller = { kind = "external", command = ["python3", "law.py"] }\n'
    )
    here = plan_of(load_study("x.toml"))
    monkeypatch.chdir("/")
    there = plan_of(load_study(str(tmp_path / "x.toml")))
    assert here.study == there.study
    assert here.study.tuning[0]["command"] == "heli-twin tune"
    assert here.study.axes["controller.command"][1][1:] == [f"law.py@{programs._hash(tmp_path / 'law.py')}", "flaky"]
    assert here.count() == 2
