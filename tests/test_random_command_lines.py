"""Whatever the command line: an exit code that tells, one short sentence for a mistake, and no traceback."""

from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from heli_twin import fly, load
from heli_twin.cli import main
from heli_twin.errors import HeliTwinError

COMMANDS = ["export", "fly", "identify", "import", "info", "paper", "recover", "reestimate", "refly", "replay"]
COMMANDS += ["compare", "film", "ls", "plot", "resolve", "show", "snapshot", "study", "trajectories", "tune"]
ACTIONS = ["run", "status", "report", "worst", "fly", "list"]
OPTIONS = ["--json", "--no-log", "--log-dir", "--rerun", "--save", "--out", "--at", "--size", "--budget", "--seeds"]
OPTIONS += [
    "--parquet",
    "--map",
    "--workers",
    "--again",
    "--no-report",
    "--spawn",
    "--connect",
    "-n",
    "--",
    "-x",
    "--jsn",
]
FIELDS = ["plant.mass", "plant", "duration", "seed", "trajectory", "trajectory.radius", "controller", "radio", "mass"]
FIELDS += ["controller.horizon", "disturbances.gust", "faults", "controller.model.b_x", "a." * 300 + "a", "", "."]
VALUES = [
    "0.03",
    "-1",
    "nan",
    "1e999",
    "9" * 400,
    "on",
    "off",
    "hover",
    "[",
    "{}",
    "[" * 500,
    '"',
    "'",
    "\x1b[2J",
    "\udcff",
]
VALUES += ["[[0,0,1],[1,1,1]]", "x" * 10_000, "[/foo]", "$(touch pwned)", "1_0", "0x1", "lab", "pid", ""]
FILES = [
    "lab",
    "ideal",
    "run.mcap",
    "run.mcap.part",
    "none.mcap",
    "bad.toml",
    "keys.toml",
    "poses.csv",
    "shot.png",
    ".",
]
FILES += ["pid", "mpc", "ladder", "x[/foo].mcap", "n" * 300, ".", "1e999", "--jsn", "12", "1.5", "100x100"]

TEXT = st.text(st.characters(exclude_characters="\0"), max_size=8)
overrides = st.builds("{}={}".format, st.sampled_from(FIELDS), st.sampled_from(VALUES) | TEXT)
words = st.sampled_from(FILES) | st.sampled_from(OPTIONS) | overrides | TEXT
lines = st.tuples(st.sampled_from(COMMANDS) | TEXT, st.lists(st.sampled_from(ACTIONS) | words, max_size=6))


def refuse(*_: object, **__: object) -> None:
    """Take the place of work that takes long."""
    raise HeliTwinError("not in this test")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("command_lines")
    flown = fly(load("lab", ["duration=0.2"]), log_dir=folder).path
    assert flown is not None
    flown.rename(folder / "run.mcap")
    (folder / "run.mcap.part").write_bytes((folder / "run.mcap").read_bytes()[:20_000])
    (folder / "bad.toml").write_text("[plant\n")
    (folder / "keys.toml").write_text('"\\u001b[2J\\u001b]0;x\\u0007" = 1\n')
    (folder / "poses.csv").write_text("time,x,y,\x1b[2J\n0,0,0,0\n")
    return folder


@pytest.fixture(autouse=True)
def _doors(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Work in a folder of its own, and end where hours of flights or a viewer would begin."""
    monkeypatch.chdir(folder)
    for work in (
        "heli_twin.mission.Flight.run",
        "heli_twin.identification.flights.fly_them",
        "heli_twin.tuning.search.tune",
        "heli_twin.paper.write.write_paper",
        "heli_twin.studies.campaign.run_study",
        "heli_twin.viewing.show.ShownFlights.show",
        "heli_twin.viewing.show.picture",
        "heli_twin.plots.figure._drawn",
        "heli_twin.films.film.Renderer",
    ):
        monkeypatch.setattr(work, refuse)


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(lines)
def test_a_random_command_line_ends_with_a_code_and_a_sentence(
    capsys: pytest.CaptureFixture[str], line: tuple[str, list[str]]
) -> None:
    check(capsys, line)


@pytest.mark.long
@settings(max_examples=1000, derandomize=False, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(lines)
def test_a_thousand_random_command_lines(capsys: pytest.CaptureFixture[str], line: tuple[str, list[str]]) -> None:
    check(capsys, line)


def check(capsys: pytest.CaptureFixture[str], line: tuple[str, list[str]]) -> None:
    try:
        code = main([line[0], *line[1]])
    except SystemExit as stop:
        code = stop.code
    out, error = capsys.readouterr()
    assert code in (0, 1, 2)
    assert "Traceback" not in out + error
    assert "\x1b" not in error.replace("\x1b[?25", "")
    if code == 2:
        assert error.startswith("heli-twin")
        assert error.count("\n") == 1
        assert len(error) < 500
