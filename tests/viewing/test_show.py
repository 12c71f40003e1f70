"""Two flights in one picture, and pictures without a screen."""

import socket
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from math import ceil, floor
from pathlib import Path
from urllib.request import urlopen

import numpy as np
import pytest
import rerun.blueprint as rrb
from hypothesis import given
from hypothesis import strategies as st
from rerun.experimental import ViewerClient

from heli_twin import HeliTwinError
from heli_twin.cli import main
from heli_twin.experiment.differences import differences
from heli_twin.experiment.text import changed, load
from heli_twin.mission import fly
from heli_twin.recording import Log, Recorder
from heli_twin.viewing import two_flights
from heli_twin.viewing.blueprint import Scales, layout
from heli_twin.viewing.delivery import Destination
from heli_twin.viewing.ranges import LABEL_PX, ROW_PX, TILE_PX, labelled
from heli_twin.viewing.show import flights, in_browser, with_truth
from heli_twin.viewing.style import Source, floor_mark
from heli_twin.viewing.two_flights import ComparedFlight, difference, document, show_both
from heli_twin.viewing.viewer_process import is_listening, is_viewer

Record = Callable[..., Recorder]
RERUN = Path(sys.executable).with_name("rerun")
LAB = load("lab")
NO_DRIVER = {"VK_DRIVER_FILES": "/nowhere", "VK_ICD_FILENAMES": "/nowhere"}


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two flights that differ in three fields, one of them shorter."""
    flown = [
        fly(load("ideal", overrides), log_dir=tmp_path_factory.mktemp("run")).path
        for overrides in (["duration=2"], ["duration=1.5", "seed=3", "controller.horizon=12"])
    ]
    return [path for path in flown if path]


# --- what differs


def test_an_experiment_does_not_differ_from_itself() -> None:
    assert differences(LAB, load("lab")) == []


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        ("plant.mass=0.031", [("plant.mass", "0.028", "0.031")]),
        ("controller=pid", [("controller", "ltv_mpc", "pid")]),
        ("faults.pose_outage=on", [("faults.pose_outage", "off", "on")]),
        ("disturbances.gust=off", [("disturbances.gust", "on", "off")]),
        ("trajectory=hover", [("trajectory", "circle", "hover")]),
    ],
)
def test_differences_are_the_overrides(override: str, expected: list[tuple[str, str, str]]) -> None:
    assert differences(LAB, changed(LAB, [override])) == expected
    assert differences(changed(LAB, [override]), LAB) == [(path, b, a) for path, a, b in expected]


@given(st.integers(0, 9), st.floats(0.02, 0.04), st.booleans())
def test_differences_rebuild_the_other_experiment(seed: int, mass: float, roll_forward: bool) -> None:
    other = replace(
        LAB,
        seed=seed,
        plant=replace(LAB.plant, mass=mass),
        estimator=replace(LAB.estimator, roll_forward=roll_forward),
    )
    assert changed(LAB, [f"{path}={b}" for path, _, b in differences(LAB, other)]) == other


# --- the difference


def test_a_flight_does_not_differ_from_itself(record: Record) -> None:
    log = record(seconds=1.0).log()
    t, minus = difference(log, log)
    np.testing.assert_array_equal(t, log.truth.time)
    assert not minus.any()


def test_the_difference_is_b_minus_a_while_both_fly(record: Record) -> None:
    a, b = record(seconds=1.0, seed=1).log(), record(seconds=0.6, seed=2).log()
    t, minus = difference(a, b)
    assert t[-1] == b.truth.time[-1]
    np.testing.assert_allclose(minus[:, :3], b.truth.position - a.truth.position[: len(t)], rtol=0, atol=1e-15)


def test_b_is_interpolated_where_it_was_not_recorded(record: Record) -> None:
    a = record(seconds=1.0).log()
    thinned = Log(a.messages | {"/truth": type(a.messages["/truth"])(*(c[::2] for c in a.messages["/truth"]))})
    t, minus = difference(a, thinned)
    assert len(t) > len(thinned.truth.time)
    # A chord of 40 ms of a circle with 0.5 m radius at 2 rad/s lies r (dt omega)^2 / 8 = 0.4 mm inside it.
    assert 0 < np.abs(minus[:, :3]).max() < 5e-4


def test_nothing_is_common_to_a_flight_and_none(record: Record) -> None:
    log = record(seconds=0.5).log()
    for pair in ((log, Log({})), (Log({}), log)):
        t, minus = difference(*pair)
        assert len(t) == len(minus) == 0


# --- both in one file


def test_two_logs_are_replayed_into_one_file(runs: list[Path], tmp_path: Path) -> None:
    saved = tmp_path / "both.rrd"
    assert main(["replay", *map(str, runs), "--save", str(saved)]) == 0
    said = subprocess.run([RERUN, "rrd", "print", "-vvv", saved], capture_output=True, text=True, check=True).stdout
    for entity in (
        "/A/world/helicopter",
        "/B/world/helicopter",
        "/A/tracking/position",
        "/B/tracking/position",
        "/difference/position",
        "/difference/yaw",
        "/differences",
    ):
        assert f"{entity}" in said, entity
    subprocess.run([RERUN, "rrd", "verify", saved], check=True, capture_output=True)


def test_the_picture_tells_what_differs_in_columns_that_fit(record: Record) -> None:
    long_name = "20261126T200305Z-mujoco-circle-ltv_mpc-seed0.mcap"
    runs = [ComparedFlight(record(seconds=0.3).log(), Scales(), name) for name in (long_name, "b|c.mcap")]
    changed = [("plant.mass", "0.028", "0.031"), ("a.very.long.path.to.some.field", "x" * 50, "y")]
    lines = document(runs, changed).splitlines()
    assert lines[2] == "| plant.mass | 0.028 | 0.031 |"
    # Three cells and their borders, in letters: 400 pixels of a view of a third of a window of 1200.
    assert max(len(line) for line in lines if line.startswith("|")) <= 3 * 22 + 10
    assert lines[-3:] == [f"A (blue): {long_name}, completed", "", "B (pink): b/c.mcap, completed"]
    assert "| experiment | the same | the same |" in document(runs, [])
    cameras = runs[1]._replace(scales=Scales(source="cameras"))
    assert "| positions by | truth | cameras |" in document([runs[0], cameras], [])


@given(
    st.floats(-1e4, 1e4),
    st.sampled_from([0.0, 1e-4, 0.3, 1.1, 6.0, 9.0, 55.0, 700.0]),
    st.sampled_from([ROW_PX, TILE_PX]),
)
def test_every_axis_has_two_numbers(low: float, span: float, height: int) -> None:
    """Rerun writes the multiples of a power of ten that are at least some 25 pixels apart."""
    start, end = labelled(low, low + span, height)
    assert start < low <= low + span < end
    steps = [10.0**k for k in range(-9, 7) if 10.0**k * height / (end - start) >= 0.8 * LABEL_PX]
    assert floor(end / steps[0]) - ceil(start / steps[0]) >= 1
    # And the values keep a good part of it.
    assert end - start <= 30 * max(span, 1.0) if span < 1e-3 else end - start <= 12 * span


def tabs_of(picture: rrb.Blueprint) -> tuple[list[str], str]:
    """The names of the tabs, and of the one in front."""
    tabs = picture.root_container.contents[1]
    names = [tab.name for tab in tabs.contents]
    return names, names[tabs.active_tab]


def test_tabs_are_chosen_by_name_and_by_what_has_changed(record: Record) -> None:
    assert tabs_of(layout(Scales())) == (["Flight", "Position", "Inputs", "Air", "Computing"], "Flight")
    assert tabs_of(layout(Scales(), "inputs"))[1] == "Inputs"
    with pytest.raises(HeliTwinError, match="there is no tab 'input': did you mean 'inputs'"):
        layout(Scales(), "input")


def test_of_a_flight_that_was_solved_again_the_inputs_are_in_front(
    record: Record, monkeypatch: pytest.MonkeyPatch
) -> None:
    log, shown = record(seconds=0.3).log(), []
    monkeypatch.setattr(two_flights, "deliver", lambda destination, layout, fill: shown.append(tabs_of(layout)[1]))
    again = replace(log, metadata={**log.metadata, "origin": "resolve"})
    for other, tab in ((log, ""), (again, ""), (again, "difference")):
        pair = [ComparedFlight(one, Scales(), "") for one in (log, other)]
        show_both(*pair, [], Destination(), tab)
    assert shown == ["Errors", "Inputs", "Difference"]


def test_plots_without_data_are_left_out() -> None:
    seen = Scales(source="cameras", present=frozenset({"position/x/cameras", "world/trail"}))
    picture = layout(seen)
    assert tabs_of(picture) == (["Position"], "Position")
    scene, told = picture.root_container.contents[0].contents
    assert scene.name == "Flight: blue seen by the cameras"
    assert [view.name for view in told.contents] == ["Events"]


def test_the_mark_on_the_floor_lies_behind_the_path() -> None:
    path = np.array([[0.0, -1.0, 1.0], [2.0, 1.0, 1.5]])
    np.testing.assert_allclose(floor_mark(path), [0.5, 1.3, 0.003])


def test_poses_without_truth_are_replayed_as_the_flight(record: Record) -> None:
    log = record(seconds=1.0).log()
    alone = Log({topic: messages for topic, messages in log.messages.items() if topic == "/mocap/pose"})
    seen, pose = with_truth(alone).truth, log.pose
    stamps, first = np.unique(pose.stamp, return_index=True)
    np.testing.assert_array_equal(seen.time, stamps)
    np.testing.assert_array_equal(seen.position, pose.position[first])
    yaw = np.interp(1e-9 * seen.time, 1e-9 * log.truth.time, log.truth.yaw)
    # The circle's noise is in position only; the heading is read off a quaternion that banks 0.1 rad.
    np.testing.assert_allclose(seen.yaw, yaw, rtol=0, atol=1e-9)
    assert with_truth(log) is log


# --- a picture without a screen


@pytest.mark.parametrize("count", [1, 2])
def test_a_snapshot_is_a_picture_of_that_size_and_leaves_nothing_else(
    count: int, runs: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setenv("TMPDIR", str(folder))
    shot, seen = tmp_path / "shot.png", []
    quiet = ViewerClient.take_screenshot

    def take(self: ViewerClient) -> bytes:
        seen.append(self.get_state())
        return quiet(self)

    monkeypatch.setattr(ViewerClient, "take_screenshot", take)
    code = main(["snapshot", *map(str, runs[:count]), "--at", "1.2", str(shot), "--size", "900x600"])
    said = capsys.readouterr()
    if "graphics driver" in said.err:
        pytest.skip(said.err)
    assert (code, said.out) == (0, f"wrote {shot}\n")
    png = shot.read_bytes()
    assert png.startswith(b"\x89PNG")
    assert (int.from_bytes(png[16:20], "big"), int.from_bytes(png[20:24], "big")) == (900, 600)
    (state,) = seen
    assert [recording.current_time for recording in state.recordings] == [1_200_000_000]
    assert [report for view in state.views for report in view.reports] == []
    assert {path.name for path in tmp_path.iterdir()} == {"shot.png", "temporary"}
    assert not [*folder.iterdir()]


def test_without_a_driver_a_snapshot_says_what_to_install(
    runs: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, value in NO_DRIVER.items():
        monkeypatch.setenv(name, value)
    assert main(["snapshot", str(runs[0]), str(tmp_path / "shot.png")]) == 2
    said = capsys.readouterr().err
    if "mesa-vulkan-drivers" not in said:
        pytest.skip(f"this machine draws without Vulkan: {said}")
    assert said.count("\n") == 1
    assert not [*tmp_path.iterdir()]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["shot.png", "--at", "2.5"], "nothing was recorded at 2.5 s: give --at a time from 0 to 2 s"),
        (["shot.png", "--at", "nan"], "nothing was recorded at nan s: give --at a time from 0 to 2 s"),
        (["shot.jpg"], "cannot write shot.jpg: give the picture a name that ends in .png"),
    ],
)
def test_what_cannot_be_pictured(
    arguments: list[str], said: str, runs: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["snapshot", str(runs[0]), *arguments]) == 2
    assert capsys.readouterr().err == f"heli-twin: {said}\n"


@pytest.mark.parametrize("size", ["12", "0x0", "99999x900", "axb", "639x400", "640x399"])
def test_a_size_is_two_numbers(size: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["snapshot", "run.mcap", "shot.png", "--size", size])
    assert "such as 1600x900" in capsys.readouterr().err


# --- a recording of which nobody knows the truth


@pytest.fixture
def imported(tmp_path: Path) -> Path:
    rows = [f"{0.01 * i},{0.01 * i},0,1,0" for i in range(50)]
    (tmp_path / "poses.csv").write_text("\n".join(["time,x,y,z,yaw", *rows, ""]))
    assert main(["import", str(tmp_path / "poses.csv")]) == 0
    return tmp_path / "poses.mcap"


def series_names(saved: Path) -> list[str]:
    """The names of the lines of the plots of x, from a Rerun file."""
    said = subprocess.run([RERUN, "rrd", "print", "-vvv", saved], capture_output=True, text=True, check=True).stdout
    return [name for name in ("truth", "cameras") if f"[{name}]" in said]


def test_of_an_imported_recording_the_cameras_are_shown_and_no_truth(
    imported: Path, runs: list[Path], tmp_path: Path
) -> None:
    for log, name in ((imported, "cameras"), (runs[0], "truth")):
        saved = tmp_path / f"{name}.rrd"
        assert main(["replay", str(log), "--save", str(saved)]) == 0
        assert series_names(saved) == [name]
    saved = tmp_path / "both.rrd"
    assert main(["replay", str(imported), str(runs[0]), "--save", str(saved)]) == 0
    said = subprocess.run([RERUN, "rrd", "print", saved], capture_output=True, text=True, check=True).stdout
    assert "/A/position/x/cameras" in said
    assert "/B/position/x/truth" in said
    assert "/A/position/x/truth" not in said


@pytest.mark.parametrize(("source", "words"), [("truth", "blue flown"), ("cameras", "blue seen by the cameras")])
def test_the_title_says_who_saw_the_flight(source: Source, words: str) -> None:
    scene = layout(Scales(source=source)).root_container.contents[0].contents[0]
    assert words in scene.name


# --- in a browser


def test_flights_are_served_to_this_machine_alone_and_end_with_the_block(runs: list[Path]) -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    if port > 65000 or is_listening(port + 1):
        pytest.skip("no two free ports")
    with in_browser(flights(runs[:1]), port):
        page = urlopen(f"http://127.0.0.1:{port}/", timeout=10).read().decode()
        assert "<title>" in page
        assert is_viewer(port + 1)
        listening = {line.split()[1] for line in Path("/proc/net/tcp").read_text().splitlines()[1:]}
        assert {f"0100007F:{number:04X}" for number in (port, port + 1)} <= listening
        assert not {f"00000000:{number:04X}" for number in (port, port + 1)} & listening
        with pytest.raises(HeliTwinError, match=f"port {port} is taken"), in_browser(flights(runs[:1]), port):
            pass
    assert not is_listening(port)
