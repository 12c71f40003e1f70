"""Several helicopters as a value and as text."""

import re
from pathlib import Path

import numpy as np
import pytest

from heli_twin.experiment import Experiment, families
from heli_twin.experiment.scenarios import CrossingCircles, Formation, Random, Swap
from heli_twin.experiment.several import Several, checked_several
from heli_twin.experiment.several_text import changed_several, load_several
from heli_twin.experiment.several_written import several_from_json, several_json, several_toml
from heli_twin.experiment.text import load
from heli_twin.experiment.toml_file import is_several, presets
from heli_twin.experiment.tree import ExperimentError

OWN = ("ships.a.plant.mass=0.03", "ships.c.trajectory=hover", "ships.c.trajectory.y=1.5", 'shared=["gust"]')


@pytest.mark.parametrize("name", presets("several"))
def test_presets_of_several_survive_text(name: str):
    several = load_several(name)
    assert several_from_json(several_json(several)) == several
    assert is_several(name)
    assert not is_several("lab")


def test_own_fields_survive_text(tmp_path: Path):
    several = load_several("pair", [*OWN, "base=lab_simple", "coordination=none", "network.loss=0.1"])
    file = tmp_path / "mine.toml"
    file.write_text(several_toml(several))
    assert is_several(str(file))
    assert load_several(str(file)) == several
    assert several_from_json(several_json(several)) == several
    assert several.every.plant == load("lab_simple").plant


def test_a_path_of_an_experiment_is_of_every_helicopter():
    several = load_several("pair", [*OWN, "duration=7", "controller.horizon=12"])
    assert [*several.fleet()] == ["a", "b", "c"]
    assert {e.duration for e in several.fleet().values()} == {7.0}
    assert {e.controller.steps for e in several.fleet().values()} == {13}
    assert several.fleet()["a"].plant.mass == 0.03
    assert several.fleet()["b"].plant.mass == 0.028
    changed = changed_several(several, ["scenario.ships=4", "plant.mass=0.027"])
    assert [*changed.fleet()] == ["a", "b", "c", "d"]
    assert changed.fleet()["a"].plant.mass == 0.027


def test_files_name_the_base_a_part_and_a_class_of_ones_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(families, "_named", {})
    (tmp_path / "mine.toml").write_text("[plant]\nmass = 0.029\n")
    (tmp_path / "pid.toml").write_text("[controller]\nkind = 'pid'\n")
    (tmp_path / "my_law.py").write_text((Path(__file__).parents[1] / "own" / "my_law.py").read_text())
    several = load_several("pair", ["base=mine.toml", "ships.b.controller=./my_law.py"])
    assert {e.plant.mass for e in several.fleet().values()} == {0.029}
    assert type(several.fleet()["b"].controller).__name__ == "MyLaw"
    assert load_several("pair", ["ships.a.controller=pid.toml"]).fleet()["a"].controller.kind == "pid"
    (tmp_path / "room.toml").write_text("scenario = 'swap'\nbase = 'lab'\n[ships.b]\ncontroller = './my_law.py'\n")
    assert load_several("room.toml").ships["b"].controller == several.ships["b"].controller


@pytest.mark.parametrize(
    ("overrides", "sentence"),
    [
        ("ships.a.duration=3", "ships.b.duration = 10.0 s, but 3.0 s for a: it has to be the same"),
        ("ships.b.plant.step=0.0005", "ships.b.plant.step"),
        ("ships.b.controller.period=0.04", "ships.b.controller.period = 0.04 s, but 0.02 s for a"),
        ("ships.b.estimator.command_delay=0.03", "ships.b.estimator.lead = 0.03 s, but"),
        ("ships.b.volume.height=2", "ships.b.volume.height = 2.0 m, but 2.5 m for a"),
        ("ships.b.volume.half_width=2", "ships.b.volume.half_width"),
        ("ships.b.seed=2", "ships.b.seed = 2, but 0 for a"),
        ("trajectory=hover", "what they fly is the scenario's"),
        ("ships.a.trajectory=hover", "ships.a.trajectory: what they fly is the scenario's"),
        ('shared=["gus"]', "shared: unknown component 'gus': did you mean 'gust'?"),
        ("scenario=swip", "unknown scenario 'swip': did you mean 'swap'?"),
        ("coordination=nune", "unknown coordination 'nune'"),
        ("scenario=own", "there are 0 helicopters: give 1 to 64"),
        ("ships.9x.plant.mass=0.03", "ships: '9x' is not a name"),
        ("ships.a=3", "ships is a table of helicopters by name"),
        ("ships.a.planet=1", "ships.a: unknown field 'planet': did you mean 'plant'?"),
        ("planet=1", "unknown field 'planet': did you mean"),
        ("network.loss=2", "network.loss = 2"),
        ("base=swap4", "swap4 is of several helicopters"),
        ("world=one", "world = 'one'"),
        ("base=3", "base = 3: give the name of a preset"),
    ],
)
def test_a_mistake_is_told_in_one_sentence(overrides: str, sentence: str):
    with pytest.raises(ExperimentError, match=re.escape(sentence)) as error:
        load_several("pair", [overrides])
    assert len(str(error.value)) < 500


def test_mistakes_in_python_are_told_like_those_in_text():
    with pytest.raises(ExperimentError, match=r"ships.a is of the class int"):
        checked_several(Several(ships={"a": 3}))  # pyright: ignore[reportArgumentType]
    with pytest.raises(ExperimentError, match=r"ships.b.duration = 3.0 s, but 30.0 s for a"):
        checked_several(Several(ships={"a": Experiment(), "b": Experiment(duration=3.0)}))
    with pytest.raises(ExperimentError, match=r"ships.a.duration = -1"):
        checked_several(Several(ships={"a": Experiment(duration=-1.0)}))


@pytest.mark.parametrize("name", presets("several"))
def test_a_base_of_another_law_is_taken_as_it_is(name: str, tmp_path: Path):
    file = tmp_path / "mine.toml"
    file.write_text("controller = 'pid'\n")
    assert load_several(name, [f"base={file}"]).every.controller == load(str(file)).controller
    assert load_several(name, ["base=lab_simple"]).every.controller == load("lab_simple").controller


@pytest.mark.parametrize(
    ("override", "sentence"),
    [
        ("ships.b.radio=off", "ships.b.radio = off: one transmitter for all has frames"),
        ("ships.b.radio.frame_period=0.011", "ships.b.radio.frame_period = 0.011 s, but 0.022 s for a"),
        ("radio.frame_period=0.6", "radio.frame_period = 0.6 s: 2 helicopters in turn wait 1.2 s, at most 1 s"),
    ],
)
def test_one_transmitter_sends_frames_to_all(override: str, sentence: str):
    assert load_several("pair", [override]).transmitters == "each"
    with pytest.raises(ExperimentError, match=re.escape(sentence)):
        load_several("pair", ["transmitters=one", override])


def _written(path: Path, text: str) -> str:
    path.write_text(text)
    return str(path)


def test_one_world_has_one_kind_of_plant(tmp_path: Path):
    with pytest.raises(ExperimentError, match=r"ships.b.plant = ideal: one shared world has the plant mujoco alone"):
        load_several("pair", ["world=shared", "ships.b.plant=ideal"])
    assert load_several("pair", ["ships.b.plant=ideal"]).world == "apart"
    assert is_several(_written(tmp_path / "one.toml", "world = 'shared'\n"))
    assert '"world"' not in several_json(load_several("pair"))


def test_random_starts_and_goals_are_apart_and_drawn_by_their_number():
    wishes = Random(ships=8).wishes()
    assert wishes == Random(ships=8).wishes()
    assert wishes != Random(ships=8, draw=1).wishes()
    for t in (0.0, 100.0):
        places = np.array([wish.flat(np.array([t])).z[0, :2] for wish in wishes.values()])
        between = np.linalg.norm(places[:, None] - places[None], axis=2)[np.triu_indices(8, 1)]
        # Places are rounded to a tenth of a millimetre.
        assert between.min() > 0.6 - 2e-4
    with pytest.raises(ValueError, match="no room for 60"):
        Random(ships=60, half_width=1.0).wishes()


@pytest.mark.parametrize("scenario", [Swap(ships=8), Random(), Formation(ships=5)])
def test_wishes_keep_their_limits_and_end_at_rest(scenario: Swap | Random | Formation):
    t = np.linspace(0.0, 30.0, 3001)
    for wish in scenario.wishes().values():
        flat = wish.flat(t)
        assert np.linalg.norm(flat.dz[:, :3], axis=1).max() <= scenario.speed + 1e-3
        assert np.linalg.norm(flat.ddz[:, :3], axis=1).max() <= scenario.acceleration + 1e-3
        assert not flat.dz[-1].any()


@pytest.mark.parametrize("scenario", [Swap(), Swap(ships=8), CrossingCircles()])
def test_wishes_meet(scenario: Swap | CrossingCircles):
    """Whoever flies them without a coordination collides."""
    t = np.linspace(0.0, 20.0, 2001)
    a, *others = (wish.flat(t).z[:, :2] for wish in scenario.wishes().values())
    assert min(np.linalg.norm(a - other, axis=1).min() for other in others) < 0.02
