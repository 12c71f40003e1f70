"""Every command and program of the README and of the guide is run: most of them here, slow ones by `pytest -m long`.

A page's commands run in their order in one folder, which has the files that they name. Flights are a tenth of a second.
"""

import io
import json
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import redirect_stdout
from dataclasses import replace
from functools import partial
from pathlib import Path

import hooks
import pytest
from in_process import InProcess

import heli_twin
from heli_twin import load, mission
from heli_twin.cli import main
from heli_twin.commands import command_line
from heli_twin.experiment import Experiment, families
from heli_twin.experiment.several import Several
from heli_twin.experiment.several_text import changed_several, load_several
from heli_twin.recording.schema import LAYOUTS, TOPICS
from heli_twin.requirements import requirements_of
from heli_twin.several import fly as several_flights
from heli_twin.studies.campaign import run_study
from heli_twin.studies.columns import metric_names
from heli_twin.studies.plan import plan_of
from heli_twin.studies.study import load_study, study_of

ROOT = Path(__file__).parents[1]
GUIDE = ROOT / "heli_twin" / "guide"
PAGES = {"README": ROOT / "README.md"} | {path.stem: path for path in sorted(GUIDE.glob("*.md"))}
FOREIGN = {"cc", "dask", "pip", "python3", "rerun", "duckdb", "ssh"}
"""Other programs on the pages; set-up, or run by the tests of external laws and of TLS."""
SLOW = (
    *("study run", "study report", "paper", "tune", "margins", "identify", "calibrate", "validate", "plot", "snapshot"),
    *("replay", "check", "film"),
)
"""Commands that are only read here, with all they name: they fly much, draw, or need a viewer."""
QUICK = ("calibrate --card",)
EXAMPLES = re.compile(r"(COMMAND|TOPIC|STUDY|NAME|HERE|CLASS|FILE|FILE\.toml)\b")
"""Words that a reader replaces."""
COURSE_S, WHOLE_S = 0.1, 13.0
"""Duration of the flights, and where slow commands run: longer than any moment that a page names."""


def blocks(page: str, language: str) -> list[str]:
    """The fenced blocks of a page in a language; that of commands is empty."""
    found = re.findall(r"^```(\w*)\n(.*?)^```", PAGES[page].read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    return [text for kind, text in found if kind == language]


def lines(page: str) -> Iterator[str]:
    """Every command of a page, without its comment."""
    text = PAGES[page].read_text(encoding="utf-8")
    inline = re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)
    commands = [line for block in blocks(page, "") for line in block.splitlines() if "──" not in line]
    for line in [*commands, *re.findall(r"`(heli-twin [^`]+)`", inline)]:
        command = re.sub(r"\s+# .*", "", line).strip()
        if command and not line.startswith(" "):
            yield from map(str.strip, command.split("&&"))


def ours(page: str) -> list[str]:
    """The commands of heli-twin on a page, each once."""
    return list(
        dict.fromkeys(line for line in lines(page) if line.startswith("heli-twin ") and not EXAMPLES.search(line))
    )


@pytest.mark.parametrize("page", PAGES)
def test_every_block_is_of_a_kind_that_is_tested(page: str) -> None:
    text = PAGES[page].read_text(encoding="utf-8")
    assert set(re.findall(r"^```(\w+)", text, re.MULTILINE)) <= {"python", "toml", "yaml", "c"}
    for line in lines(page):
        assert re.sub(r"^\.venv/bin/", "", line).split()[0] in {"heli-twin", "pytest", *FOREIGN}, line


@pytest.mark.parametrize("page", PAGES)
def test_links_lead_somewhere(page: str) -> None:
    for link in re.findall(r"\]\((?!http|#)([^)#]+)\)", PAGES[page].read_text(encoding="utf-8")):
        assert (PAGES[page].parent / link).exists(), link


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ready: Path) -> Path:
    """A folder with the files that the pages name."""
    folder = tmp_path / "place"
    shutil.copytree(ready, folder)
    monkeypatch.chdir(folder)
    monkeypatch.syspath_prepend(str(folder))
    return folder


@pytest.fixture
def _short(monkeypatch: pytest.MonkeyPatch) -> None:
    shorten(monkeypatch.setattr)
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(families, "_named", {})
    monkeypatch.setattr("heli_twin.studies.run.embedded", InProcess)


def shorten(set_attribute: Callable[[object, str, object], None]) -> None:
    """Let every flight last a moment."""
    checked = mission.checked

    def short(experiment: Experiment) -> Experiment:
        return replace(checked(experiment), duration=COURSE_S)

    set_attribute(mission, "checked", short)
    fleet = several_flights.checked_fleet

    def short_fleet(several: Several) -> Several:
        return changed_several(fleet(several), [f"duration={COURSE_S}"])

    set_attribute(several_flights, "checked_fleet", short_fleet)


@pytest.fixture(scope="session")
def ready(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files, made once."""
    return files_in(tmp_path_factory.mktemp("guide"), COURSE_S)


def files_in(folder: Path, duration: float) -> Path:
    """Make the files that the pages name, with flights of this duration, s."""
    flights = {name: Experiment(seed=number, duration=duration) for number, name in enumerate(("RUN", "A", "B", "C"))}
    if duration == WHOLE_S:
        # A pair that can be calibrated on.
        flights |= {"A": load("calibrate_plane", ["seed=11"]), "B": load("calibrate_height_yaw", ["seed=12"])}
    for name, experiment in flights.items():
        flown = mission.fly(experiment, log_dir=folder / "logs").path
        assert flown is not None
        flown.rename(folder / f"{name}.mcap")
    shutil.copy(folder / "RUN.mcap", folder / "logs" / "RUN.mcap")
    room = several_flights.fly_several(load_several("pair", [f"duration={duration}"]), log_dir=folder / "logs").path
    assert room is not None
    room.rename(folder / "ROOM.mcap")
    (folder / "LOST.mcap.part").write_bytes((folder / "A.mcap").read_bytes()[:-3000])
    for name in ("my_law.py", "my_design.py"):
        shutil.copy(ROOT / "tests" / "own" / name, folder)
    shutil.copy(ROOT / "tests" / "lab" / "plant" / "airframes" / "quadrotor.xml", folder / "my_heli.xml")
    law = (folder / "my_law.py").read_text().replace("MyLaw", "Mine").replace('"my_law"', '"mine"')
    (folder / "my_package").mkdir()
    (folder / "my_package" / "laws.py").write_text(law)
    (folder / "calibration.toml").write_text("[plant]\nmass = 0.029\n")
    (folder / "model.toml").write_text("[controller.model]\nb_x = 2.1\n")
    (folder / "pid.py").write_text(blocks("external-laws", "python")[0])
    rows = [f"{0.01 * i:.2f},{0.002 * i:.4f},0,1,0" for i in range(80)]
    (folder / "take.csv").write_text("\n".join(["time,x,y,z,yaw", *rows, ""]))
    (folder / "sent.csv").write_text("time,ux,uy,uz,uyaw\n0,0,0,0.5,0\n0.5,0,0,0.6,0\n")
    rows = [f"{0.01 * i:.2f},{2 * i},0,1000,0,0.5" for i in range(80)]
    (folder / "poses.csv").write_text("\n".join(["t,px,py,pz,psi,u3", *rows, ""]))
    swept = study_of(
        {"name": "mass", "base": {"preset": "ideal", "disturbances": {"gust": "on"}}}
        | {"axes": {"disturbances.gust.strength": [0.1, 0.3]}, "logs": {"worst": 0, "sampled": 0}}
    )
    run_study(swept, folder / "logs" / "studies" / "mass", backend=InProcess, work=partial(hooks.rough, 1.0))
    if cc := shutil.which("cc"):
        (folder / "pid.c").write_text(blocks("external-laws", "c")[0])
        subprocess.run([cc, "-O2", "-ffp-contract=off", "pid.c", "-o", "pid", "-lm"], cwd=folder, check=True)
    return folder


def words_of(line: str) -> tuple[list[str], Path | None]:
    """The arguments of a command, and the file that its output goes to."""
    words = shlex.split(line)[1:]
    target = Path(words[words.index(">") + 1]) if ">" in words else None
    words = words[: words.index(">")] if target else words
    named = [sorted(map(str, Path().glob(word))) if "*" in word and "=" not in word else [word] for word in words]
    return [word for some in named for word in some], target


def expected(line: str) -> tuple[int, ...]:
    """Exit codes of a command whose flight is too short to be any good."""
    return (0, 1, 3) if "judge" in line or "--require" in line else (0, 1)


@pytest.mark.usefixtures("_short")
@pytest.mark.parametrize("page", PAGES)
def test_the_commands_of_a_page_do_what_they_say(page: str, place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    if page == "external-laws" and not (place / "pid").exists():
        pytest.skip("no C compiler")
    for line in ours(page):
        words, target = words_of(line)
        if line.removeprefix("heli-twin ").startswith(SLOW) and not any(quick in line for quick in QUICK):
            parsed = command_line().parse_args(words)
            if words[:2] == ["study", "run"]:
                assert plan_of(load_study(parsed.study, parsed.overrides)).count() > 0
            continue
        output = io.StringIO()
        with redirect_stdout(output):
            try:
                code = main(words)
            except SystemExit as stop:
                code = stop.code
        assert code in expected(line), f"{line}: {capsys.readouterr().err}"
        if target:
            target.write_text(output.getvalue())


@pytest.mark.usefixtures("_short", "place")
@pytest.mark.parametrize("page", [page for page in PAGES if blocks(page, "python") and page not in ("external-laws",)])
def test_the_programs_of_a_page_run(page: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if page == "own-code":
        assert [text.strip() for text in blocks(page, "python")] == [Path("my_law.py").read_text().strip()]
        return
    # The look of a figure is tested where figures are.
    monkeypatch.setitem(heli_twin.__dict__, "plot", lambda *_, **__: None)
    for text in blocks(page, "python"):
        with redirect_stdout(io.StringIO()) as output:
            exec(compile(text, page, "exec"), {"__name__": "__main__"})
        assert output.getvalue()


def test_the_study_of_the_guide_can_be_flown(tmp_path: Path) -> None:
    (text,) = blocks("studies", "toml")
    (tmp_path / "mine.toml").write_text(text)
    assert plan_of(load_study(str(tmp_path / "mine.toml"))).count() == 30


def test_the_files_of_the_page_on_several_can_be_used(tmp_path: Path) -> None:
    room, require = blocks("several", "toml")
    for name, text in (("room.toml", room), ("require.toml", require)):
        (tmp_path / name).write_text(text)
    several = several_flights.checked_fleet(load_several(str(tmp_path / "room.toml")))
    assert [*several.fleet()] == ["a", "b", "c", "guest"]
    assert [each.name for each in requirements_of(str(tmp_path / "require.toml"))] == ["apart"]


def test_the_guide_names_every_metric_and_every_design() -> None:
    text = (GUIDE / "studies.md").read_text(encoding="utf-8")
    for name in metric_names():
        stem = name.partition(".")[0]
        assert f"`{name}`" in text or f"`{stem}`" in text or f"`{stem}." in text, name
    for kind in families.members(families.DESIGNS):
        assert f"| `{kind}` |" in text


def test_the_set_up_is_two_commands() -> None:
    readme = PAGES["README"].read_text(encoding="utf-8")
    assert len(re.findall(r"^python3 -m venv", readme, re.MULTILINE)) == 2


def test_guide_lists_and_prints_its_pages(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["guide"]) == 0
    listed = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in listed] == [*(name for name in PAGES if name != "README"), "foxglove"]
    assert main(["guide", "logs"]) == 0
    assert capsys.readouterr().out == (GUIDE / "logs.md").read_text(encoding="utf-8")
    assert main(["guide", "study"]) == 2
    assert "did you mean 'studies'?" in capsys.readouterr().err


def test_the_layout_for_foxglove_shows_what_a_log_has() -> None:
    layout = json.loads((GUIDE / "foxglove.json").read_text(encoding="utf-8"))
    known = {topic.name: topic for topic in TOPICS}
    shown: set[str] = set()
    for name, panel in layout["configById"].items():
        shown |= {*panel.get("topics", {}), *([panel["topicToRender"]] if "topicToRender" in panel else [])}
        for path in panel.get("paths", []):
            topic, _, field = path["value"].partition(".")
            shown.add(topic)
            if topic in LAYOUTS:
                assert field.partition("[")[0] in LAYOUTS[topic].dtype.names, (name, path)
            else:
                assert f"float64[] {field.partition('[')[0]}\n".encode() in known[topic].schema
    assert shown <= set(known)
    assert {*panels(layout["layout"])} == set(layout["configById"])


def panels(tree: object) -> Iterator[str]:
    """The panels of a layout."""
    if isinstance(tree, dict):
        yield from (panel for side in ("first", "second") for panel in panels(tree[side]))
    else:
        yield str(tree)


@pytest.mark.long
@pytest.mark.parametrize("page", PAGES)
def test_slow_commands_of_a_page_run_too(page: str, tmp_path: Path) -> None:
    """As processes; studies, the paper and tuning are cut short, and viewers are not opened."""
    place = files_in(tmp_path / "place", WHOLE_S)
    shorter = {"study run": ["replicates=1", "duration=2.2", "--workers", "2"], "paper": ["--seeds", "1"]}
    shorter |= {"tune": ["--budget", "1"]}
    for line in ours(page):
        command = line.removeprefix("heli-twin ")
        is_needed = command.startswith(SLOW) or re.search(r"--log-dir|^study new", command)
        if not is_needed or re.search(r"--scheduler|--web|^replay (?!.*--save)", command):
            continue
        extra = next((words for start, words in shorter.items() if command.startswith(start)), [])
        words = " ".join([sys.executable, "-m", "heli_twin", command, *extra])
        done = subprocess.run(words, shell=True, cwd=place, capture_output=True, text=True, check=False)
        assert done.returncode in expected(command), f"{words}: {done.stderr[-500:]}"
