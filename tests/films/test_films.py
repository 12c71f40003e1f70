"""Films show where the helicopter was, whole files or none, and say in a sentence what is missing."""

import subprocess
import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from disks import disk_of
from PIL import Image

from heli_twin import HeliTwinError, Log, fly, load, read_log
from heli_twin.cli import main
from heli_twin.films.film import Take, film
from heli_twin.films.flights import CameraKind, cameras, drawing, pose, shown
from heli_twin.films.strip import Strip, axes
from heli_twin.lab.plant.renderer import Ball, Camera, Line, Pose, Renderer

av = pytest.importorskip("av")
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
ABOVE = Camera(np.array([0.0, 0.0, 1.0]), 2.0, 0.0, -89.9)


@pytest.fixture(scope="module")
def graphics() -> None:
    """A machine that can draw."""
    try:
        Renderer(None, 320, 180).close()
    except HeliTwinError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    words = ["duration=2", "faults.pose_outage.start=0.5", "faults.pose_outage.duration=0.5"]
    flown = fly(load("lab", words), log_dir=tmp_path_factory.mktemp("flight")).path
    assert flown is not None
    return flown


@pytest.fixture(scope="module")
def log(path: Path) -> Log:
    return read_log(path)


def changed(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Mean row and column of the pixels in which two pictures differ."""
    return np.argwhere((before.astype(int) - after).any(axis=2)).mean(axis=0)


@pytest.mark.usefixtures("graphics")
def test_the_helicopter_is_drawn_where_it_is() -> None:
    """From above, north is up and west is left."""
    with Renderer(load("lab").plant, 320, 240) as renderer:
        away = renderer.draw(Pose(np.array([0.0, 0.0, -5.0]), LEVEL), ABOVE).copy()
        row, column = changed(away, renderer.draw(Pose(np.array([0.0, 0.0, 1.0]), LEVEL), ABOVE))
        assert (row, column) == pytest.approx((120, 160), abs=6)
        north = changed(away, renderer.draw(Pose(np.array([0.4, 0.0, 1.0]), LEVEL), ABOVE))
        west = changed(away, renderer.draw(Pose(np.array([0.0, 0.4, 1.0]), LEVEL), ABOVE))
        # 0.4 m at 2 m distance; the picture is 40 deg high.
        pixels = 0.4 * 120 / (2.0 * np.tan(np.radians(20)))
        assert north - (row, column) == pytest.approx((-pixels, 0), abs=6)
        assert west - (row, column) == pytest.approx((0, -pixels), abs=6)
        # The tail is longer than the rotor: it points south, and east once the nose points west.
        per_metre = pixels / 0.4
        for heading, tail in ((0.0, (1, 0)), (np.pi / 2, (0, 1))):
            quat = np.array([np.cos(heading / 2), 0.0, 0.0, np.sin(heading / 2)])
            shape = renderer.draw(Pose(np.array([0.0, 0.0, 1.0]), quat), ABOVE)
            found = np.argwhere((away.astype(int) - shape).any(axis=2)) - (120, 160)
            reach = {d: (found @ d).max() / per_metre for d in ((1, 0), (-1, 0), (0, 1), (0, -1))}
            assert reach.pop(tail) == pytest.approx(0.132, abs=0.01)
            assert [*reach.values()] == pytest.approx([0.095] * 3, abs=0.015)


@pytest.mark.usefixtures("graphics")
def test_lines_and_balls_have_their_colours() -> None:
    nothing = Pose(np.array([0.0, 0.0, -5.0]), LEVEL)
    line = Line(np.array([[0.0, -0.5, 1.0], [0.0, 0.5, 1.0]]), (1.0, 0.0, 0.0, 1.0), 5.0)
    with Renderer(None, 320, 240) as renderer:
        red = renderer.draw(nothing, ABOVE, [line])[120, 160].tolist()
        dark = renderer.draw(nothing, ABOVE, [], [Ball(np.array([0, 0, 1.0]), (0, 0, 0, 1.0), 0.1)])[120, 160].tolist()
    assert red[0] > 200 > 60 > max(red[1:])
    assert max(dark) < 120


def test_between_samples_and_after_the_end_the_helicopter_is_somewhere(log: Log) -> None:
    flight = shown(log, "", 0)
    here = pose(flight, 1.01)
    between = 0.5 * (log.truth.position[50] + log.truth.position[51])
    np.testing.assert_allclose(here.position, between, atol=1e-9)
    np.testing.assert_allclose(pose(flight, 99.0).position, log.truth.position[-1])
    turned = flight.quat_wxyz * np.where(np.arange(len(flight.quat_wxyz)) % 2, 1.0, -1.0)[:, None]
    same = pose(flight._replace(quat_wxyz=turned), 1.01).quat_wxyz
    np.testing.assert_allclose(np.abs(same @ here.quat_wxyz), here.quat_wxyz @ here.quat_wxyz, rtol=1e-12)
    lines, (ball,) = drawing(flight, 1.0, here.position)
    np.testing.assert_allclose(ball.centre, log.reference.x[50, :3])
    (newest,) = log.plan.x[log.plan.time == 1_000_000_000]
    np.testing.assert_allclose(lines[-1].points, newest[:, :3])


@pytest.mark.parametrize("kind", ["room", "top"])
def test_a_still_camera_sees_all_that_is_flown(log: Log, kind: CameraKind) -> None:
    flight = shown(log, "", 0)
    placed = cameras([flight], kind, np.linspace(0, 2, 5), 2.0).still
    a, e = np.radians([placed.azimuth, placed.elevation])
    ahead = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    left = np.array([-np.sin(a), np.cos(a), 0.0])
    from_camera = log.truth.position - placed.target + placed.distance * ahead
    depth = from_camera @ ahead
    assert (np.abs(from_camera @ left) < 2.0 * np.tan(np.radians(20)) * depth).all()
    assert (np.abs(from_camera @ np.cross(ahead, left)) < np.tan(np.radians(20)) * depth).all()


def test_the_strip_marks_the_time_and_the_outage(log: Log) -> None:
    flight = shown(log, "", 0)
    strip = Strip(flight, 400, 60, axes([flight], 0.0, 2.0))
    at = [np.flatnonzero((np.asarray(strip.at(t))[30] < 60).all(axis=1)).max() for t in (0.5, 1.0, 1.5)]
    assert np.diff(at) == pytest.approx(np.diff(at)[0], abs=1)
    grey = np.flatnonzero((np.asarray(strip.at(2.0))[30] == 217).all(axis=1))
    assert (grey.min(), grey.max()) == pytest.approx((at[0], at[1]), abs=4)


@pytest.mark.usefixtures("graphics")
def test_an_mp4_is_played_back_frame_by_frame(path: Path, tmp_path: Path) -> None:
    told: list[tuple[int, int]] = []
    take = Take(start=0.5, end=1.5, fps=5, size=(320, 180), camera="follow")
    made = film([path, path], tmp_path / "two.mp4", take, lambda *count: told.append(count))
    assert told[-1] == (made.frames, 5)
    with av.open(str(tmp_path / "two.mp4")) as container:
        stream = container.streams.video[0]
        pictures = [np.asarray(frame.to_image()) for frame in container.decode(stream)]
        assert (stream.average_rate, stream.codec_context.name, len(pictures)) == (5, "h264", 5)
    assert pictures[0].shape == (180, 320, 3)
    assert [(a != b).any() for a, b in pairwise(pictures)] == [True] * 4
    assert [file.name for file in tmp_path.iterdir()] == ["two.mp4"]


@pytest.mark.usefixtures("graphics")
def test_a_gif_needs_no_pyav(path: Path, tmp_path: Path) -> None:
    """As a program of its own, which loads the engine without a graphics library until a film asks for one."""
    words = [str(path), "--from", "0", "--to", "0.4", "--fps", "5", "--size", "320x180"]
    code = "import sys; sys.modules['av'] = None; from heli_twin.cli import main; sys.exit(main())"
    gif, mp4 = (
        subprocess.run(
            [sys.executable, "-c", code, "film", *words, str(tmp_path / name)], capture_output=True, text=True
        )
        for name in ("f.gif", "f.mp4")
    )
    assert (gif.returncode, gif.stderr) == (0, "")
    with Image.open(tmp_path / "f.gif") as film:
        assert (film.n_frames, film.size, film.info["duration"]) == (2, (320, 180), 200)
    assert mp4.returncode == 2
    assert "heli-twin[film]" in mp4.stderr
    assert [file.name for file in tmp_path.iterdir()] == ["f.gif"]


@pytest.mark.usefixtures("graphics")
@pytest.mark.parametrize("name", ["f.mp4", "f.gif"])
def test_a_full_disk_leaves_no_half_film(name: str, path: Path, tmp_path: Path) -> None:
    with disk_of(3000), pytest.raises(HeliTwinError, match=r"cannot (be )?writ"):
        film([path], tmp_path / name, Take(end=0.4, fps=5, size=(320, 180)))
    assert not list(tmp_path.iterdir())


def test_an_imported_recording_is_filmed_by_the_cameras(log: Log) -> None:
    flight = shown(replace(log, messages={"/mocap/pose": log.messages["/mocap/pose"]}), "", 0)
    assert flight.moved.by_cameras
    assert np.linalg.norm(pose(flight, 1.5).position - log.truth.position[75]) < 0.01
    with pytest.raises(HeliTwinError, match="nothing to film"):
        shown(Log({}), "", 0)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["f.avi"], ".mp4 or .gif"),
        (["f.mp4", "--size", "321x180"], "even number"),
        (["f.mp4", "--size", "big"], "is no size"),
        (["f.mp4", "--fps", "1e9"], "1 to 120"),
        (["f.mp4", "--camera", "rom"], "did you mean 'room'"),
        (["f.mp4", "--from", "3"], "within 0 and 2 s"),
        (["f.mp4", "--from", "1", "--to", "1"], "within 0 and 2 s"),
        (["no/f.mp4"], "no folder"),
        (["taken.mp4"], "exists already"),
    ],
)
def test_a_mistake_is_one_sentence_and_leaves_nothing(
    words: list[str], sentence: str, path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("taken.mp4").write_bytes(b"mine")
    try:
        code = main(["film", str(path), *words])
    except SystemExit as stop:
        code = stop.code
    error = capsys.readouterr().err
    assert (code, error.count("\n")) == (2, 1)
    assert sentence in error
    assert len(error) < 500
    assert Path("taken.mp4").read_bytes() == b"mine"
    assert len(list(tmp_path.iterdir())) == 1


def test_a_machine_without_a_graphics_driver_says_how_to_get_one(monkeypatch: pytest.MonkeyPatch) -> None:
    def nothing(*_: object) -> None:
        raise ImportError("no libEGL")

    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setattr("heli_twin.lab.plant.renderer.import_module", nothing)
    with pytest.raises(HeliTwinError, match="apt install libegl1") as told:
        Renderer(None, 320, 180)
    assert len(str(told.value)) < 400
