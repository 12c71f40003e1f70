import json
import os
import signal
import sqlite3
import subprocess
import sys
import time
from collections import Counter
from contextlib import suppress
from functools import partial
from pathlib import Path

import hooks
import pytest

from heli_twin.experiment.differences import fly_command
from heli_twin.experiment.text import load
from heli_twin.experiment.tree import canonical_json
from heli_twin.studies.campaign import embedded, run_study
from heli_twin.studies.errors import StudyError
from heli_twin.studies.results import rows_of
from heli_twin.studies.store import Store
from heli_twin.studies.study import Study, study_of, study_tree
from heli_twin.studies.worst import experiment_by_id, worst_runs
from heli_twin.workers.stopping import stoppable


def two_processes(plan, timeout):
    return embedded(plan, timeout, 2)


def run(study, out, work=hooks.pretend, **options):
    return run_study(study, out, backend=two_processes, work=work, **options)


def flights(seen: Path) -> Counter[str]:
    return Counter(seen.read_text().split()) if seen.exists() else Counter()


def test_running_again_flies_nothing_twice(small, tmp_path):
    assert run(small, tmp_path).flown == 6
    again = run(small, tmp_path)
    assert (again.flown, again.done) == (0, 6)


def test_a_changed_study_flies_only_what_is_new(small, tmp_path):
    run(small, tmp_path)
    wider = study_of(study_tree(small) | {"axes": {"disturbances.gust.strength": [0.3, 0.4]}})
    assert run(wider, tmp_path).flown == 2
    assert {row["disturbances.gust.strength"] for row in rows_of(tmp_path)} == {0.3, 0.4}


def test_a_poison_run_fails_alone(small, tmp_path):
    count = run(small, tmp_path, hooks.poison)
    rows = rows_of(tmp_path)
    bad = [row for row in rows if row["outcome"] != "completed"]
    assert (count.done, count.failed) == (6, {"killed": 2})
    assert {row["disturbances.gust.strength"] for row in bad} == {0.5}
    assert all("SIGABRT" in row["outcome_text"] and row["attempts"] == 2 for row in bad)
    assert "disturbances.gust.strength=0.5" in worst_runs(tmp_path, 1)[0].command


def test_a_hung_run_is_ended(small, tmp_path):
    quick = study_of(study_tree(small) | {"timeout": 0.3, "replicates": 1})
    assert run(quick, tmp_path, hooks.hang).failed == {"hung": 1}
    assert Counter(row["outcome"] for row in rows_of(tmp_path)) == {"completed": 2, "hung": 1}


def test_a_killed_worker_costs_nothing_but_a_second_try(small, tmp_path):
    assert run(small, tmp_path, partial(hooks.die_once, str(tmp_path / "seen"))).failed == {}
    assert {row["attempts"] for row in rows_of(tmp_path)} == {1, 2}


def test_runs_that_were_lost_fly_again_when_asked_to(small, tmp_path):
    run(small, tmp_path, hooks.poison)
    assert run(small, tmp_path).flown == 0
    assert run(small, tmp_path, again=True).flown == 2
    assert {row["outcome"] for row in rows_of(tmp_path)} == {"completed"}


DRIVER = """
import json, sys
sys.path[:0] = json.loads(sys.argv[1])
from functools import partial
from pathlib import Path
import hooks
from heli_twin.paper import flights
from heli_twin.studies.campaign import embedded, run_study
from heli_twin.studies.plan import plan_of
from heli_twin.studies.study import study_of
from heli_twin.workers.fleet import fleet
from heli_twin.workers.task import Task

if __name__ == "__main__":
    folder = Path(sys.argv[2])
    study = study_of(json.loads((folder / "study.json").read_text()))
    work = partial(getattr(hooks, sys.argv[4]), str(folder / "seen"))
    if sys.argv[3] == "fleet":
        with fleet(2) as run:
            list(run(work, [None] * 4))
    elif sys.argv[3] == "paper":
        tasks = [Task(str(i), plan_of(study).space.base, "", True, True, None) for i in range(4)]
        flights.fly_all(folder, [(work, tasks)])
    else:
        run_study(study, folder / "out", backend=lambda plan, timeout: embedded(plan, timeout, 2), work=work)
"""


def drive(folder: Path, study: Study, command: str, work: str, lines: int) -> subprocess.Popen[bytes]:
    """A driver in a process group of its own, when its workers have left so many lines in the file `seen`."""
    (folder / "study.json").write_text(json.dumps(study_tree(study)))
    script = folder / "drive.py"
    script.write_text(DRIVER)
    words = [sys.executable, str(script), json.dumps(sys.path), str(folder), command, work]
    driver = subprocess.Popen(words, start_new_session=True, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 30
    while flights(folder / "seen").total() < lines and time.monotonic() < deadline:
        time.sleep(0.05)
    return driver


def is_gone(group: int, patience: float) -> bool:
    """Whether the last process of a group ends within so many seconds; one that only waits to be reaped has ended."""
    deadline = time.monotonic() + patience
    while time.monotonic() < deadline:
        listed = subprocess.run(["ps", "-eo", "pgid=,stat="], capture_output=True, text=True, check=True).stdout
        if not any(int(line.split()[0]) == group and "Z" not in line for line in listed.splitlines()):
            return True
        time.sleep(0.05)
    return False


ENDINGS = {"fleet": ("SIGKILL", "SIGTERM", "SIGHUP"), "study": ("SIGKILL", "SIGTERM"), "paper": ("SIGHUP", "SIGINT")}


@pytest.mark.parametrize(("command", "asked"), [(command, name) for command in ENDINGS for name in ENDINGS[command]])
def test_a_driver_that_ends_leaves_no_process_behind(small, tmp_path, command, asked):
    driver = drive(tmp_path, small, command, "stay", 1)
    os.kill(driver.pid, signal.Signals[asked])
    try:
        # A KeyboardInterrupt ends Python by the signal that Ctrl-C is.
        assert driver.wait(timeout=5) == -(signal.SIGKILL if asked == "SIGKILL" else signal.SIGINT)
        assert is_gone(driver.pid, 5)
    finally:
        with suppress(ProcessLookupError):
            os.killpg(driver.pid, signal.SIGKILL)


def test_a_program_keeps_its_own_signal_handlers():
    def mine(number, frame):
        raise AssertionError(number, frame)

    before = signal.signal(signal.SIGTERM, mine)
    try:
        with stoppable():
            assert signal.getsignal(signal.SIGTERM) is mine
        # Not the default, which would end pytest.
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        with pytest.raises(KeyboardInterrupt), stoppable():
            signal.raise_signal(signal.SIGTERM)
        assert signal.getsignal(signal.SIGTERM) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGTERM, before)


def test_a_killed_driver_goes_on_where_it_was(small, tmp_path):
    seen = tmp_path / "seen"
    study = study_of(study_tree(small) | {"replicates": 10})
    driver = drive(tmp_path, study, "study", "noted", 6)
    os.kill(driver.pid, signal.SIGKILL)
    driver.wait()
    time.sleep(0.5)
    with Store(tmp_path / "out") as store:
        stored = store.outcomes().total()
    assert stored >= 2
    count = run(study, tmp_path / "out", partial(hooks.noted, str(seen)))
    assert (count.done, count.flown) == (30, 30 - stored)
    # Only what was in the air when the driver died has been flown again.
    assert sum(flights(seen).values()) <= 30 + 3 * 2


def test_one_driver_at_a_time(small, tmp_path):
    with Store(tmp_path, write=True), pytest.raises(StudyError, match="another study is running"):
        run(small, tmp_path)


def test_a_bad_study_leaves_nothing_behind(tmp_path):
    with pytest.raises(StudyError):
        run(Study(axes={"plant.mass": []}), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_logs_of_failed_and_worst_flights_are_kept_and_no_others(small, tmp_path):
    run(small, tmp_path, hooks.fail)
    rows = rows_of(tmp_path)
    kept = {path.stem for path in (tmp_path / "logs").iterdir()}
    failed = {row["id"] for row in rows if row["outcome"] == "crashed"}
    assert failed < kept
    assert len(kept - failed) == 1
    assert {row["disturbances.gust.strength"] for row in rows if row["id"] in kept - failed} == {0.3}
    told = {run.id: run.what for run in worst_runs(tmp_path)}
    assert all(" cm (" in told[id] for id in kept - failed), "a person reads cm"


def test_a_printed_command_flies_the_same_experiment(small, tmp_path):
    import shlex

    run(small, tmp_path)
    for row in rows_of(tmp_path):
        experiment = experiment_by_id(tmp_path, row["id"])
        source, *overrides = shlex.split(fly_command(experiment))[2:]
        again = load(source, overrides) if "=" not in source else load(None, [source, *overrides])
        assert canonical_json(again) == experiment


def test_results_are_read_by_others(small, tmp_path):
    run(small, tmp_path, hooks.fail)
    duckdb = pytest.importorskip("duckdb")
    query = (
        f"SELECT outcome, count(*), max(\"rmse.position\") FROM '{tmp_path / 'results.parquet'}' GROUP BY 1 ORDER BY 1"
    )
    assert duckdb.sql(query).fetchall() == [("completed", 4, 0.3), ("crashed", 2, 0.5)]


def test_a_real_flight_has_all_its_columns(small, tmp_path):
    from heli_twin.studies.columns import metric_names
    from heli_twin.studies.work import fly_task

    one = study_of(study_tree(small) | {"axes": {}, "replicates": 1})
    run(one, tmp_path, fly_task)
    (row,) = rows_of(tmp_path)
    assert row["outcome"] == "completed"
    assert set(metric_names()) <= row.keys()
    assert {"id", "seed", "host", "version.mujoco", "digest", "wall_time"} <= row.keys()
    (log,) = (tmp_path / "logs").iterdir()
    from heli_twin.recording import read_log

    assert read_log(log).digest == row["digest"]


def test_results_of_another_version_are_told_not_misread(small, tmp_path):
    run(small, tmp_path)
    db = sqlite3.connect(tmp_path / "results.sqlite")
    db.execute("PRAGMA user_version=99")
    db.close()
    for use in (lambda: run(small, tmp_path), lambda: worst_runs(tmp_path)):
        with pytest.raises(StudyError, match="another version"):
            use()


def test_a_file_that_is_no_database_is_told(small, tmp_path):
    (tmp_path / "results.sqlite").write_text("these are not the results you are looking for" * 100)
    with pytest.raises(StudyError, match="cannot be used"):
        run(small, tmp_path)
