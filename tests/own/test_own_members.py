"""Strangers' members fly like ours: named by object, file or import path, swept, logged honestly, flown again."""

import json
import shutil
import sqlite3
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from heli_twin import Experiment, HeliTwinError, fly, load, read_log
from heli_twin.cli import main
from heli_twin.experiment import families
from heli_twin.experiment.named_classes import own_sources
from heli_twin.logbook import write_own_source
from heli_twin.recording import Attachment, Recorder
from heli_twin.studies.campaign import run_study
from heli_twin.studies.plan import plan_of
from heli_twin.studies.results import rows_of
from heli_twin.studies.study import study_of

HERE = Path(__file__).parent
SHORT = ["duration=2", "trajectory=hover"]


@pytest.fixture(autouse=True)
def nothing_named() -> Iterator[None]:
    """What one test names is unknown to the next."""
    families._named.clear()
    yield
    families._named.clear()


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    """A folder of a user's own."""
    for name in ("my_law.py", "helix.py", "my_design.py"):
        shutil.copy(HERE / name, tmp_path / name)
    return tmp_path


def test_three_ways_to_name_a_law_give_one_flight(mine: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(mine))
    by_file = fly(load("lab", [*SHORT, f"controller={mine / 'my_law.py'}"]), log_dir=None)
    families._named.clear()
    by_import = fly(load("lab", [*SHORT, "controller=my_law:MyLaw"]), log_dir=None)
    families._named.clear()
    from my_law import MyLaw

    base = load("lab", SHORT)
    by_object = fly(Experiment(duration=2.0, trajectory=base.trajectory, controller=MyLaw()), log_dir=None)
    assert by_file.flight_digest == by_import.flight_digest == by_object.flight_digest
    assert by_file.outcome.kind == "completed"
    sys.modules.pop("my_law", None)


def test_its_fields_are_overridden_like_ours(mine: Path) -> None:
    law = f"controller={mine / 'my_law.py'}"
    assert load("lab", [law, "controller.gain=3"]).controller.gain == 3.0
    with pytest.raises(HeliTwinError, match=r"controller\.gain = -1"):
        load("lab", [law, "controller.gain=-1"])


def test_a_file_in_toml_stands_beside_the_toml(mine: Path) -> None:
    (mine / "x.toml").write_text('duration = 2\ncontroller = "./my_law.py"\n[trajectory]\nkind = "./helix.py:Helix"\n')
    experiment = load(str(mine / "x.toml"))
    assert (experiment.controller.kind, experiment.trajectory.kind) == ("my_law", "helix")


def test_another_source_is_another_flight(mine: Path) -> None:
    first = fly(load("lab", [*SHORT, f"controller={mine / 'my_law.py'}"]), log_dir=None)
    text = (mine / "my_law.py").read_text()
    (mine / "my_law.py").write_text(text + "\n# changed\n")
    second = fly(load("lab", [*SHORT, f"controller={mine / 'my_law.py'}"]), log_dir=None)
    assert first.flight_digest != second.flight_digest


def test_a_log_needs_the_class_to_fly_again_and_for_nothing_else(
    mine: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    law, log = str(mine / "my_law.py"), mine / "logs"
    assert (
        main(
            [
                "fly",
                *SHORT,
                f"controller={law}",
                "disturbances.up=" + str(mine / "helix.py:Thermal"),
                "--log-dir",
                str(log),
            ]
        )
        == 0
    )
    (run,) = log.glob("*.mcap")
    assert str(mine) not in json.dumps([read_log(run).experiment, dict(read_log(run).metadata)])
    kept = mine / "kept"
    kept.mkdir()
    for name in ("my_law.py", "helix.py", "my_design.py"):
        shutil.move(mine / name, kept / name)
    families._named.clear()
    capsys.readouterr()
    assert main(["info", str(run)]) == 0
    out = capsys.readouterr().out
    assert "MyLaw" in out
    assert "disturbances.up=thermal disturbances.up.strength=0.3" in out
    assert "controller=my_law controller.gain=0.8" in out
    assert main(["replay", str(run), "--save", str(mine / "x.rrd")]) == 0
    assert main(["export", str(run), "--parquet", str(mine / "tables")]) == 0
    assert main(["refly", str(run)]) == 2
    error = capsys.readouterr().err
    assert "--with ./my_law.py" in error
    assert "what was flown came from my_law.py, helix.py" in error
    words = ["--with", str(kept / "my_law.py"), "--with", str(kept / "helix.py")]
    assert main(["refly", str(run), *words]) == 0
    assert "identical" in capsys.readouterr().out
    (kept / "my_law.py").write_text((kept / "my_law.py").read_text().replace("0.5 * error[4]", "0.6 * error[4]"))
    families._named.clear()
    main(["refly", str(run), *words])
    assert "controller was flown by 'MyLaw, source" in capsys.readouterr().out


def test_a_study_sweeps_it_on_workers(mine: Path) -> None:
    study = study_of(
        {
            "name": "mine",
            "base": {
                "preset": "ideal",
                "duration": 2.5,
                "controller": str(mine / "my_law.py"),
                "trajectory": str(mine / "helix.py:Helix"),
            },
            "axes": {"controller.gain": [0.5, 1.0, 2.0]},
        }
    )
    run_study(study, mine / "out")
    rows = rows_of(mine / "out")
    assert [row["outcome"] for row in rows] == ["completed"] * 3
    assert len({row["digest"] for row in rows}) == 3


DESIGN = {"name": "star", "base": {"preset": "ideal", "duration": 0.5, "trajectory": "hover"}}
STAR = """
name = "star"
design = "./my_design.py"
replicates = 2
[base]
preset = "ideal"
duration = 0.5
controller = "./my_law.py"
trajectory = "hover"
[axes]
"controller.gain" = { uniform = [0.5, 1.0] }
"controller.model.b_x" = { uniform = [1.9, 2.1] }
"""


def test_a_design_of_ones_own_chooses_the_flights(
    mine: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # The files stand beside the study, which is flown from elsewhere.
    (mine / "star.toml").write_text(STAR)
    elsewhere = mine / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    assert main(["study", "run", str(mine / "star.toml"), "design.points=2", "--out", "out", "--workers", "1"]) == 0
    rows = rows_of(Path("out"))
    assert [(row["controller.gain"], row["seed"]) for row in rows] == [
        *((None, 0), (None, 1), (0.5, 0), (0.5, 1), (0.75, 0), (0.75, 1)),
        *[(None, 0), (None, 1)] * 2,
    ]
    assert {row["outcome"] for row in rows} == {"completed"}
    store = Path("out/results.sqlite").read_bytes()
    # Neither a path of this machine nor the text of the class is kept.
    assert str(mine).encode() not in store
    assert b"Star, source" in store
    # A report and the list of the worst need no class.
    families._named.clear()
    (mine / "my_design.py").unlink()
    (mine / "my_law.py").unlink()
    capsys.readouterr()
    assert main(["study", "report", "out"]) == 0
    assert main(["study", "worst", "out", "-n", "1"]) == 0
    assert main(["study", "status", "out"]) == 0


def test_three_ways_to_name_a_design_plan_the_same(mine: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(mine))
    axes = {"plant.model.b_x": [1.9, 2.1]}
    plans = []
    for design in (str(mine / "my_design.py"), "my_design:Star", {"kind": str(mine / "my_design.py:Star")}):
        families._named.clear()
        plan = plan_of(study_of({**DESIGN, "axes": axes, "design": design}))
        plans.append([run.id for batch in plan.batches() for run in plan.runs(batch)])
    from my_design import Star

    plan = plan_of(replace(study_of({**DESIGN, "axes": axes}), design=Star()))
    plans.append([run.id for batch in plan.batches() for run in plan.runs(batch)])
    assert plans[0] == plans[1] == plans[2] == plans[3]
    assert len(plans[0]) == 4
    sys.modules.pop("my_design", None)


def test_designs_are_sent_to_no_worker(mine: Path) -> None:
    study_of({**DESIGN, "design": str(mine / "my_design.py")})
    load("lab", [f"controller={mine / 'my_law.py'}"])
    assert [source.class_name for source in own_sources()] == ["MyLaw"]


def test_an_axis_lists_laws_of_ones_own_by_their_files(mine: Path) -> None:
    law = str(mine / "my_law.py")
    study = study_of({"base": {"duration": 0.5}, "axes": {"controller": ["pid", law], "plant.mass": [0.028]}})
    assert [alternative.name for alternative in plan_of(study).space.alternatives] == ["pid", "my_law"]


def test_code_that_a_store_names_is_loaded_by_nobody(mine: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (mine / "evil.py").write_text("raise SystemExit('loaded')\n")
    (mine / "star.toml").write_text(STAR)
    assert main(["study", "run", str(mine / "star.toml"), "--out", str(mine / "out"), "--workers", "1"]) == 0
    with sqlite3.connect(mine / "out" / "results.sqlite") as store:
        runs = store.execute("select changes from settings limit 1").fetchall()
        assert runs
        store.execute("update settings set changes = ?", [json.dumps({"controller": str(mine / "evil.py")})])
    capsys.readouterr()
    run = rows_of(mine / "out")[0]["id"]
    assert main(["study", "fly", str(mine / "out"), run]) == 2
    assert "unknown controller" in capsys.readouterr().err


def test_check_judges_a_design_and_what_is_no_member(mine: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(mine / "my_design.py")]) == 0
    assert "Star, a member of heli_twin.studies.designs" in capsys.readouterr().out
    greedy = (mine / "my_design.py").read_text().replace("1 + self.points", "self.points")
    (mine / "greedy.py").write_text(greedy)
    assert main(["check", str(mine / "greedy.py")]) == 1
    assert "and count() says" in capsys.readouterr().out
    (mine / "half.py").write_text((mine / "my_law.py").read_text().replace("def steps", "def stairs"))
    assert main(["check", str(mine / "half.py")]) == 1
    assert "MyLaw, a member of controllers.laws" in capsys.readouterr().out
    (mine / "nothing.py").write_text(
        "from dataclasses import dataclass\n@dataclass(frozen=True)\nclass Thing:\n    kind: str = 'thing'\n"
    )
    assert main(["check", str(mine / "nothing.py")]) == 1
    assert "Thing has the attributes of none" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("controller=./nowhere.py", "nowhere.py cannot be opened"),
        ("controller={}/my_law.py:Other", "Other is no dataclass with a field kind"),
        ("controller=no_such.module:Mine", "cannot be imported"),
        ("controller={}/helix.py", "has 0 members of laws"),
        ("controller={}/broken.py", "broken.py, line 2 cannot be loaded: ZeroDivisionError"),
        ("controller={}/clash.py", "two members have the kind 'pid': that of heli_twin and that of"),
    ],
)
def test_what_cannot_be_loaded_is_told(mine: Path, word: str, message: str, capsys: pytest.CaptureFixture[str]) -> None:
    (mine / "broken.py").write_text('"""Broken."""\n1 / 0\n')
    (mine / "clash.py").write_text((mine / "my_law.py").read_text().replace('"my_law"', '"pid"'))
    assert main(["fly", "duration=0.1", "--no-log", word.format(mine)]) == 2
    assert message in capsys.readouterr().err


def test_a_package_adds_members_by_entry_points(mine: Path) -> None:
    """In an environment of its own: a folder with the metadata that an installer writes."""
    (mine / "my_package-1.0.dist-info").mkdir()
    (mine / "my_package-1.0.dist-info" / "METADATA").write_text(
        "Metadata-Version: 2.1\nName: my-package\nVersion: 1.0\n"
    )
    (mine / "my_package-1.0.dist-info" / "entry_points.txt").write_text(
        "[heli_twin.controllers]\nmy_law = my_law:MyLaw\n[heli_twin.trajectories]\nhelix = helix:Helix\n"
    )
    paths = {"PYTHONPATH": ":".join([str(mine), *sys.path])}
    listed = subprocess.run(
        [sys.executable, "-m", "heli_twin", "list", "--json"], env=paths, capture_output=True, text=True, check=True
    )
    rows: list[dict[str, Any]] = json.loads(listed.stdout)
    assert {"kind": "my_law", "from": "the package my-package"}.items() <= next(
        row for row in rows if row["kind"] == "my_law"
    ).items()
    words = ["fly", "duration=0.5", "controller=my_law", "trajectory=helix", "--no-log", "--json"]
    flown = subprocess.run(
        [sys.executable, "-m", "heli_twin", *words], env=paths, capture_output=True, text=True, check=True
    )
    assert json.loads(flown.stdout)["outcome"] == "completed"


def test_check_judges_a_file(mine: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(mine / "my_law.py")]) == 0
    assert main(["check", str(mine / "helix.py")]) == 0
    assert "Thermal, a member of heli_twin.lab.disturbances" in capsys.readouterr().out
    (mine / "jumpy.py").write_text(
        (mine / "helix.py").read_text().replace("(-r * s, r * c, slope", "(-r * s, r * c, 2 * slope")
    )
    assert main(["check", str(mine / "jumpy.py"), "--json"]) == 1
    broken = [row for row in json.loads(capsys.readouterr().out) if row["trouble"]]
    assert [row["rule"] for row in broken] == ["The derivatives of its flat outputs are those of its path."]


def test_the_text_of_a_law_is_in_a_log_only_if_asked_for(mine: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["fly", "duration=0.5", f"controller={mine / 'my_law.py'}", f"trajectory={mine / 'helix.py:Helix'}"]
    for extra, folder in (([], "plain"), (["--embed-source"], "embedded")):
        assert main([*words, *extra, "--log-dir", str(mine / folder)]) == 0
    plain, embedded = (next((mine / folder).glob("*.mcap")) for folder in ("plain", "embedded"))
    assert b"def step(self" not in plain.read_bytes()
    assert read_log(plain).digest == read_log(embedded).digest
    capsys.readouterr()
    assert main(["info", str(plain)]) == 0
    assert "embedded" not in capsys.readouterr().out.replace("/embedded/", "/")
    assert main(["info", str(embedded)]) == 0
    out = capsys.readouterr().out
    assert "Helix.py, MyLaw.py embedded; heli-twin export" in out
    assert main(["export", str(embedded), "--source", str(mine / "out")]) == 0
    assert (mine / "out" / "MyLaw.py").read_bytes() == (mine / "my_law.py").read_bytes()
    assert main(["export", str(embedded), "--source", str(mine / "out")]) == 2
    assert "exists already" in capsys.readouterr().err
    assert main(["export", str(plain), "--source", str(mine / "other")]) == 2
    assert "no embedded source" in capsys.readouterr().err
    # What is embedded is never taken for the class that is missing.
    families._named.clear()
    assert main(["refly", str(embedded)]) == 2
    assert "--with ./my_law.py" in capsys.readouterr().err


def test_a_source_leaves_a_foreign_log_under_plain_names_only(mine: Path) -> None:
    names = (
        "own_source/../evil.py",
        "own_source//etc/x.py",
        "own_source/.py",
        "own_source/a b.py",
        "own_source/Good.py",
    )
    recorder = Recorder(attachments=[Attachment(name, "text/x-python", b"1") for name in names])
    recorder.close("completed", 1)
    assert [path.name for path in write_own_source(recorder.log(), mine / "out")] == ["Good.py"]
    assert sorted(path.name for path in mine.rglob("*.py")) == ["Good.py", "helix.py", "my_design.py", "my_law.py"]


def test_without_a_class_of_ones_own_there_is_nothing_to_embed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fly", "duration=0.1", "--no-log", "--embed-source"]) == 2
    assert "no source to embed" in capsys.readouterr().err
