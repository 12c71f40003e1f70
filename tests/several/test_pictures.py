"""Films, figures, Rerun files and tables of several helicopters."""

import json
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from controllers.coordinations import CommittedPlan
from heli_twin import HeliTwinError
from heli_twin.cli import main
from heli_twin.experiment.several_text import load_several
from heli_twin.films.film import TOPICS
from heli_twin.films.ships import cylinder, planned_ahead, room_of, shown_ships
from heli_twin.lab.plant.renderer import Camera, Pose, Renderer
from heli_twin.plots import plot
from heli_twin.recording import Log, read_log
from heli_twin.recording.records import Committed
from heli_twin.several.fly import fly_several
from heli_twin.viewing.delivery import Destination
from heli_twin.viewing.show import ShownShips, flights

RERUN = Path(sys.executable).with_name("rerun")


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    several = load_several("swap4", ["base=lab_simple", "coordination=none", "duration=3", "scenario.radius=0.5"])
    found = fly_several(several, log_dir=tmp_path_factory.mktemp("flight")).path
    assert found is not None
    return found


@pytest.fixture(scope="module")
def log(path: Path) -> Log:
    return read_log(path)


def test_all_stand_in_one_rerun_file_with_plans_cylinders_and_distances(path: Path, tmp_path: Path):
    file = tmp_path / "room.rrd"
    assert main(["replay", str(path), "--save", str(file)]) == 0
    said = subprocess.run([str(RERUN), "rrd", "print", str(file), "-vv"], capture_output=True, text=True, check=True)
    for name in "abcd":
        for entity in ("helicopter", "safety", "committed", "trail"):
            assert f"/{name}/world/{entity}" in said.stdout
    for entity in ("flown", "planned", "promised", "touching"):
        assert f"/distance/{entity}" in said.stdout


def test_what_cannot_be_shown_is_told(path: Path, tmp_path: Path):
    with pytest.raises(HeliTwinError, match="no tab 'inputs'"):
        ShownShips(read_log(path)).show(Destination(file=tmp_path / "x.rrd"), "inputs")
    with pytest.raises(HeliTwinError, match="--require is for one helicopter"):
        flights([path], "hover")
    assert not list(tmp_path.iterdir())


def test_a_figure_has_the_least_distance_and_every_path(log: Log):
    figure = plot(log, what="distance")
    flown, planned, touching = figure.axes[0].lines
    assert [line.get_label() for line in (flown, planned, touching)] == ["flown", "planned", "rotors touch"]
    # They stand on a circle of 0.5 m, and touch in its middle.
    assert flown.get_ydata()[0] == pytest.approx(0.5 * 2**0.5, abs=0.01)
    assert flown.get_ydata()[-1] < 0.19
    above = plot(log, what="path").axes[0]
    assert {"a", "b", "c", "d"} <= {line.get_label() for line in above.lines}
    with pytest.raises(HeliTwinError, match="one flight of several"):
        plot(log.ship("a"), what="distance")


def test_a_film_tells_the_least_distance(log: Log):
    ships = shown_ships(log)
    assert len({ship.color for ship in ships}) == 4
    time, least = room_of(log, ships).distance(0.0, 0.1)
    assert time[0] == 0.0
    assert least[0] == pytest.approx(0.5 * 2**0.5, abs=0.01)


def test_a_film_has_the_plans_ahead_and_cylinders_as_wide_as_plans_are_apart(log: Log):
    rims = cylinder(0.4)
    assert np.linalg.norm(rims[..., :2], axis=2) == pytest.approx(0.2)
    assert np.ptp(rims[..., 2]) == pytest.approx(0.3)
    plan = CommittedPlan(2 * 10**8, 2 * 10**8, np.array([[[x, 0.0, 1.0, 0.0]] + [[0.0] * 4] * 2 for x in (0.0, 1.0)]))
    ship = shown_ships(log)[0]
    committed = [Committed(0, None), Committed(2 * 10**8, plan)]
    ship = ship._replace(log=SimpleNamespace(committed=committed))  # pyright: ignore[reportArgumentType]
    assert planned_ahead(ship, 0.1) == []
    (ahead,) = planned_ahead(ship, 0.3)
    assert ahead[0] == pytest.approx([0.5, 0.0, 1.0])
    assert ahead[-1] == pytest.approx([1.0, 0.0, 1.0])
    assert "/path" in TOPICS


def test_others_are_drawn_beside_the_first():
    above, level = Camera(np.array([0.0, 0.0, 1.0]), 2.0, 0.0, -89.9), np.array([1.0, 0.0, 0.0, 0.0])
    here, there = (Pose(np.array([x, 0.0, 1.0]), level) for x in (0.0, 0.4))
    try:
        renderer = Renderer(None, 320, 240)
    except HeliTwinError as error:
        pytest.skip(str(error))
    with renderer:
        one = renderer.draw(here, above).astype(int)
        two = renderer.draw(here, above, others=[there]).astype(int)
        rows, _ = np.nonzero((one != two).any(axis=2))
        # North is up: the other stands above the first, which is in the middle.
        assert rows.mean() < 110
        assert (one == renderer.draw(there, above, others=[here])).mean() < 1.0


def test_the_commands_tell_of_all_and_of_each(path: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["info", str(path), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert [*facts["ships"]] == ["a", "b", "c", "d"]
    assert facts["metrics"]["least_distance"] < 0.19
    assert main(["info", str(path)]) == 0
    assert "least distance in the plane" in capsys.readouterr().out
    assert main(["info", f"{path}#c"]) == 0
    assert "touched" in capsys.readouterr().out
    assert main(["resolve", f"{path}#b"]) == 0
    assert main(["refly", str(path)]) == 0
    assert "identical" in capsys.readouterr().out


def test_tables_of_logs_have_a_row_for_all(path: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["ls", str(path.parent), "--json"]) == 0
    (row,) = json.loads(capsys.readouterr().out)
    assert row["trajectory"] == "4 helicopters"
    assert row["controller"] == "none"
    assert row["changes"][0] == "swap4"
    assert row["least_distance"] < 0.19


def test_a_recovered_log_tells_what_each_lost(path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    part = tmp_path / "room.mcap.part"
    part.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    assert main(["recover", str(part)]) == 0
    assert "how the flight ended" in capsys.readouterr().out
    assert main(["refly", str(tmp_path / "room.mcap")]) == 0


def test_fly_prints_what_programs_need(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    require = tmp_path / "apart.toml"
    require.write_text('[requirements]\napart = "always distance > 0.25 m"\n')
    words = ["pair", "base=lab_simple", "duration=0.5", "--log-dir", str(tmp_path / "logs"), "--json"]
    assert main(["fly", *words, "--require", str(require)]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["least_distance"] > 1.5
    assert said["arrived"] == 0
    assert [*said["ships"]] == ["a", "b"]
    assert [*said["requirements"]] == ["a: apart", "b: apart"]
    meet = ["pair", "base=lab_simple", "coordination=none", "scenario.radius=0.4", "duration=2", "--no-log"]
    assert main(["fly", *meet, "--require", str(require)]) == 3
    assert main(["fly", *meet]) == 1


def test_messages_that_come_after_the_next_turn_are_told(capsys: pytest.CaptureFixture[str]):
    words = ["fly", "pair", "base=lab_simple", "duration=0.2", "--no-log", "network.delay=0.06"]
    assert main(words) == 0
    assert "network.delay = 0.06 s is more than the 0.05 s between the turns of 2" in capsys.readouterr().err
    assert main([*words, "coordination.hearing=0.072"]) == 0
    assert capsys.readouterr().err == ""
