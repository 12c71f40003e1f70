"""Rows of other code are not mixed with those of this code without a word."""

import subprocess
import sys
from collections import Counter

import hooks
import pytest
from in_process import InProcess

from heli_twin.studies import flight_code
from heli_twin.studies.campaign import run_study
from heli_twin.studies.errors import StudyError
from heli_twin.studies.flight_code import ROOMS, changes_of, code_hash, code_parts, file_hash
from heli_twin.studies.results import rows_of
from heli_twin.studies.store import Store

HARMLESS = ("heli_twin/__init__", "heli_twin/errors", "heli_twin/whole_file", "heli_twin/terminal_text")
"""Modules that a flight loads and that no number of a row comes from."""


def run(small, folder, **options):
    return run_study(small, folder, backend=InProcess, work=hooks.pretend, **options)


def with_files(monkeypatch, **changed):
    """Another source text of some files, as if they had been edited."""
    files = {name: changed.get(name.rpartition("/")[2], data) for name, data in REAL_FILES.items()}
    monkeypatch.setattr(flight_code, "_files", lambda: iter(files.items()))
    for cached in (file_hash, code_parts):
        cached.cache_clear()


REAL_FILES = dict(flight_code._files())


@pytest.fixture(autouse=True)
def _fresh_hashes():
    yield
    for cached in (file_hash, code_parts):
        cached.cache_clear()


def edited(old, new, name="pid.py"):
    (text,) = (data for path, data in REAL_FILES.items() if path.endswith(f"/{name}"))
    assert old in text
    return {name: text.replace(old, new)}


def test_every_module_of_a_flight_is_hashed():
    script = (
        "import sys; from heli_twin import fly, fly_several, load, load_several;"
        "fly(load(None, ['duration=0.1']), log_dir=None).summary();"
        "fly_several(load_several('pair', ['duration=0.1']), log_dir=None).summary();"
        "print(*sorted(m for m in sys.modules if m.split('.')[0] in ('heli_twin', 'controllers')))"
    )
    loaded = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout.split()
    paths = [name.replace(".", "/") for name in loaded]
    hashed = {name.removesuffix(".py").removesuffix("/__init__") for name in REAL_FILES}
    assert {path for path in paths if path not in hashed} <= {"heli_twin", *HARMLESS}
    assert all(any(path.startswith(room) for path in paths) for room in ROOMS)


def test_comments_docstrings_and_line_ends_change_no_code(monkeypatch):
    before = code_hash(), file_hash()
    more = edited(b'"""The paper', b'"""In other words, the paper')["pid.py"].replace(b"\n", b"\r\n")
    with_files(monkeypatch, **{"pid.py": more + b"\n\n# the end\n"})
    assert code_hash() == before[0]
    assert file_hash() != before[1]


def test_a_changed_number_is_changed_code(monkeypatch):
    before, parts = code_hash(), dict(code_parts())
    with_files(monkeypatch, **edited(b"= 0.", b"= 1."))
    assert code_hash() != before
    assert changes_of(parts, code_parts()) == "controllers/laws/pid.py"


def test_changed_packages_are_told_with_their_versions():
    before = {"a.py": "1", "b.py": "1", "numpy": "2.1.0", "z.py": "1", "y.py": "1"}
    after = {"a.py": "2", "b.py": "1", "numpy": "2.2.0", "z.py": "2", "y.py": "2"}
    assert changes_of(before, after) == "a.py, numpy 2.1.0 became 2.2.0, y.py and 1 more"


def test_the_hash_is_the_same_in_another_process_and_folder(tmp_path):
    script = "from heli_twin.studies.flight_code import *; print(file_hash(), code_hash())"
    said = subprocess.run(
        [sys.executable, "-B", "-c", script], cwd=tmp_path, capture_output=True, text=True, check=True
    ).stdout
    assert said.split() == [file_hash(), code_hash()]


def test_a_study_resumed_with_other_code_is_told(small, tmp_path, monkeypatch):
    run(small, tmp_path)
    assert {row["code"] for row in rows_of(tmp_path)} == {code_hash()}
    with_files(monkeypatch, **edited(b"= 0.", b"= 1."))
    with pytest.raises(StudyError, match=r"6 flights .* other code \(changed since: controllers/laws/pid.py\)"):
        run(small, tmp_path)
    assert len(rows_of(tmp_path)) == 6


def test_old_rows_are_kept_or_flown_again_as_asked(small, tmp_path, monkeypatch):
    old = code_hash()
    run(small, tmp_path)
    with_files(monkeypatch, **edited(b"= 0.", b"= 1."))
    assert run(small, tmp_path, accept_old=True).flown == 0
    with Store(tmp_path) as store:
        assert store.codes() == Counter({old: 6})
    assert run(small, tmp_path, again=True).flown == 6
    with Store(tmp_path) as store:
        assert store.codes() == Counter({code_hash(): 6})


def test_a_comment_lets_a_study_go_on(small, tmp_path, monkeypatch):
    run(small, tmp_path)
    with_files(monkeypatch, **edited(b"\n\n", b"\n# a remark\n\n"))
    assert run(small, tmp_path).flown == 0


def test_rows_without_a_hash_are_old(small, tmp_path):
    run(small, tmp_path)
    with Store(tmp_path, write=True) as store:
        store._db.execute("ALTER TABLE flights DROP COLUMN code")
    with pytest.raises(StudyError, match="it left no hash"):
        run(small, tmp_path)


def other_code(task):
    """What a worker with other code answers."""
    return hooks.pretend(task)._replace(
        row={"id": task.id, "outcome": "other code", "host": "far", "parts": {**code_parts(), "numpy": "1.0"}}
    )


def test_a_worker_with_other_code_is_refused(small, tmp_path):
    with pytest.raises(StudyError, match=r"worker on far has other code \(numpy .* became 1.0\)"):
        run_study(small, tmp_path, backend=InProcess, work=other_code)
    assert run(small, tmp_path).flown == 6


def test_work_is_refused_where_the_code_differs(small):
    from heli_twin.studies.plan import plan_of
    from heli_twin.studies.work import OTHER_CODE, fly_with_code
    from heli_twin.workers.task import Task

    planned = next(iter(plan_of(small).runs(next(plan_of(small).batches()))))
    task = Task(planned.id, planned.experiment, "", keep_log=False, keep_failed=False, keep_above=None)
    assert fly_with_code(hooks.pretend, "other files", code_hash(), task).row["outcome"] == "completed"
    assert fly_with_code(hooks.pretend, file_hash(), "other", task).row["outcome"] == "completed"
    assert fly_with_code(hooks.pretend, "other files", "other", task).row["outcome"] == OTHER_CODE
