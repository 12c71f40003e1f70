import json
import math
import tomllib
from copy import deepcopy

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from controllers.markers import EachOf, OneOf
from heli_twin.cli import main
from heli_twin.experiment import Experiment
from heli_twin.experiment.families import members
from heli_twin.experiment.fields import fields_of
from heli_twin.experiment.past import PHYSICS_VERSION
from heli_twin.experiment.paths import put
from heli_twin.experiment.text import load
from heli_twin.experiment.toml_file import presets
from heli_twin.experiment.tree import ExperimentError, canonical_json, experiment_of, from_json, toml_of, tree_of
from heli_twin.experiment.values import LARGEST, SMALLEST
from heli_twin.mission import checked

FAMILIES = {name: part.family.package for name, part in fields_of(Experiment).items() if part.family}
ONE_OF = {n: p for n, p in FAMILIES.items() if isinstance(fields_of(Experiment)[n].family, OneOf)}
EACH_OF = {n: p for n, p in FAMILIES.items() if isinstance(fields_of(Experiment)[n].family, EachOf)}
MEMBERS = [(family, kind) for family, package in ONE_OF.items() for kind in members(package)]


def everything_on():
    return load("lab", [f"{family}.{kind}=on" for family, package in EACH_OF.items() for kind in members(package)])


def leaves(spec, path=""):
    """(path, part) of every single value in a spec, its parts included."""
    for name, part in fields_of(type(spec)).items():
        value = getattr(spec, name)
        if isinstance(part.family, EachOf):
            for member in value:
                yield from leaves(member, f"{path}{name}.{member.kind}.")
        elif not part.is_plain:
            yield from leaves(value, f"{path}{name}.")
        elif name != "kind":
            yield f"{path}{name}", part


def read(tree, path):
    for key in path.split("."):
        tree = tree[key]
    return tree


LEAVES = dict(leaves(everything_on()))
NUMBERS = {path: part for path, part in LEAVES.items() if part.type in (float, int)}


def allowed(part):
    """Values that a number's annotation allows."""
    schema = part.adapter.json_schema()
    if part.type is int:
        return st.integers(schema.get("minimum", -(10**6)), schema.get("maximum", 10**6))
    low, high = (schema.get(k, schema.get(f"exclusive{k.capitalize()}")) for k in ("minimum", "maximum"))
    return st.floats(
        -LARGEST if low is None else low,
        LARGEST if high is None else high,
        exclude_min="exclusiveMinimum" in schema,
        exclude_max="exclusiveMaximum" in schema,
    ).filter(lambda value: value == 0.0 or abs(value) >= SMALLEST)


def forbidden(part):
    """Values just beyond a bound."""
    schema = part.adapter.json_schema()
    step = (lambda v, to: v + (1 if to > 0 else -1)) if part.type is int else math.nextafter
    beyond = {"minimum": -math.inf, "maximum": math.inf}
    for key, to in beyond.items():
        if key in schema:
            yield step(schema[key], to)
        if f"exclusive{key.capitalize()}" in schema:
            yield schema[f"exclusive{key.capitalize()}"]


changes = st.sampled_from(sorted(NUMBERS)).flatmap(lambda path: st.tuples(st.just(path), allowed(NUMBERS[path])))


@pytest.mark.parametrize("name", presets())
def test_every_preset_can_be_flown(name):
    experiment = load(name)
    assert checked(experiment) == experiment


def test_there_are_the_presets_that_the_manual_names():
    assert {"lab", "ideal"} <= set(presets())
    assert load() == load("lab")
    assert tree_of(load("lab")) == tree_of(Experiment())


@pytest.mark.parametrize("name", presets())
def test_what_show_prints_is_what_fly_takes(name, tmp_path):
    experiment = load(name)
    file = tmp_path / "mine.toml"
    file.write_text(toml_of(experiment))
    assert load(str(file)) == experiment


@pytest.mark.parametrize(("family", "kind"), MEMBERS)
def test_every_member_goes_through_text_and_back(family, kind, tmp_path):
    experiment = load("lab", [f"{family}.kind={kind}"])
    of_the_lab, of_the_class = getattr(load(), family), members(FAMILIES[family])[kind]()
    assert getattr(experiment, family) == (of_the_lab if kind == of_the_lab.kind else of_the_class)
    assert load("lab", [f"{family}={kind}"]) == experiment
    file = tmp_path / "mine.toml"
    file.write_text(toml_of(experiment))
    assert load(str(file)) == experiment
    assert from_json(canonical_json(experiment)) == experiment


def test_every_field_says_what_it_means():
    experiment = everything_on()
    lines = toml_of(experiment).splitlines()
    for path, part in LEAVES.items():
        assert part.doc, f"{path} has no doc(...)"
        assert any(line.startswith(path.rpartition(".")[2] + " = ") and part.doc in line for line in lines)
        if part.unit:
            assert any(f"# {part.unit}: {part.doc}" in line for line in lines)


@given(changes)
@settings(max_examples=200)
def test_what_is_put_is_read_back_and_nothing_else_changes(change):
    path, value = change
    before = tree_of(everything_on())
    tree = deepcopy(before)
    put(tree, path, value)
    assert read(tree, path) == value
    try:
        after = tree_of(experiment_of(tree))
    except ExperimentError as refusal:
        # Some values do not go together; then the sentence names the part. `pytest.raises` would demand a refusal.
        assert path.split(".")[0] in str(refusal)  # noqa: PT017
        assume(False)
    assert after == tree
    put(after, path, read(before, path))
    assert after == before


@given(st.lists(changes, max_size=4))
def test_json_and_toml_keep_every_digit(several):
    tree = tree_of(everything_on())
    for path, value in several:
        put(tree, path, value)
    try:
        experiment = experiment_of(tree)
    except ExperimentError:
        assume(False)
    assert from_json(canonical_json(experiment)) == experiment
    assert canonical_json(from_json(canonical_json(experiment))) == canonical_json(experiment)
    again, written = tree_of(Experiment()), tomllib.loads(toml_of(experiment))
    assert written.pop("physics") == PHYSICS_VERSION
    for name, value in written.items():
        put(again, name, value)
    assert experiment_of(again) == experiment


def test_an_experiment_has_one_text():
    assert canonical_json(load()) == canonical_json(Experiment())
    assert canonical_json(load(overrides=["duration=5"])) == canonical_json(load(overrides=["duration=5.0"]))
    assert canonical_json(load(overrides=["seed=1"])) != canonical_json(load())


def refusal(*overrides, source="lab"):
    with pytest.raises(ExperimentError) as caught:
        checked(load(source, overrides))
    text = str(caught.value)
    assert "\n" not in text
    return text


@pytest.mark.parametrize("path", NUMBERS)
def test_a_number_out_of_bounds_is_refused_with_field_value_limit_unit_and_default(path):
    part = NUMBERS[path]
    tree = tree_of(everything_on())
    # Plant and supervisor of the lab have another value than their classes.
    default = 0.0 if path in ("plant.drag_z", "supervisor.heave_damping") else read(tree, path)
    for value in forbidden(part):
        put(tree, path, value)
        with pytest.raises(ExperimentError) as caught:
            experiment_of(tree)
        text = str(caught.value)
        assert text.startswith(f"{path} = {value!r}: it must be ")
        assert text.endswith(f"; the default is {json.dumps(default)} {part.unit}".rstrip())
        assert part.unit in text.partition(";")[0]


@pytest.mark.parametrize("path", NUMBERS)
def test_what_is_no_number_is_refused(path):
    for word, said in (("fast", "'fast'"), ("true", "True"), ("[1.0]", "[1.0]"), ("2020-01-01", "'2020-01-01'")):
        text = refusal(f"{path}={word}")
        assert text.startswith(f"{path} = {said}: ")
        assert "; the default is " in text
    for word in ("nan", "inf", "-inf"):
        text = refusal(f"{path}={word}")
        assert text.startswith(f"{path} = {word} is not a finite number; the default is ")


@pytest.mark.parametrize("path", LEAVES)
def test_a_misspelt_field_is_refused_with_what_there_is(path):
    table, _, name = path.rpartition(".")
    wrong = f"{table}.{name}x".lstrip(".")
    text = refusal(f"{wrong}=1")
    assert text.startswith(f"unknown field '{wrong}': did you mean '")
    assert name in text.partition("Available: ")[2].split(", ") or text.endswith("...")
    assert len(text) < 500


REFUSALS = {
    "unknown field 'trajectroy': did you mean 'trajectory'? Available: seed, duration, ": ["trajectroy.kind=circle"],
    "unknown field 'mass': did you mean 'plant.mass'? Available: seed, ": ["mass=0.03"],
    "unknown field 'radius': did you mean 'trajectory.radius'? Available: seed, ": ["radius=0.3"],
    "trajectory starts at x 3, y 0, z 1 m, outside the volume: volume.half_width = 2.5 m, ": [
        "trajectory.radius=3",
        "trajectory.rate=0.1",
    ],
    "trajectory starts at x 0.5, y 0, z 1 m, outside the volume: volume.half_width = 2.5 m, volume.height = 0.9 m": [
        "volume.height=0.9"
    ],
    "controller.model: the helicopter is believed too heavy to hover: it needs u_z = 0.545 ": [
        "controller.model.u_z_max=0.5"
    ],
    "trajectory.flight is a take-off and landing again: choose any other": [
        "trajectory=takeoff_and_landing",
        "trajectory.flight=takeoff_and_landing",
    ],
    "unknown field 'plant.masss': did you mean 'plant.mass'?": ["plant.masss=0.03"],
    "unknown field 'controller.model.b_w': did you mean 'controller.model.b_": ["controller.model.b_w=2"],
    "unknown trajectory 'cirle': did you mean 'circle'?": ["trajectory=cirle"],
    "unknown plant 'mujocco': did you mean 'mujoco'?": ["plant.kind=mujocco"],
    "unknown plant '[1]': Available: ": ["plant.kind=[1]"],
    "unknown disturbances 'gusts': did you mean 'gust'?": ["disturbances.gusts=on"],
    "trajectory = 3 names no trajectory. Available: ": ["trajectory=3"],
    "plant = {} names no plant. Available: ": ["plant={}"],
    "disturbances.gust = 3: write on, off, or one of its fields: kind, strength, time": ["disturbances.gust=3"],
    "disturbances is a table; set one of its fields: ": ["disturbances=off"],
    "controller.model is a table; set one of its fields: b_x, ": ["controller.model=3"],
    "plant.mass is a single value; it has no field 'kg'": ["plant.mass.kg=0.03"],
    "plant.mass = {}: it must be a valid number": ["plant.mass={}"],
    "controller.coupling = 'ful': did you mean 'full'? Available: removed, full": ["controller.coupling=ful"],
    "controller.Q[9] = ": ["controller.Q=[1,2,3,4,5,6,7,8,9]"],
    "controller.R[1] = -1: it must be greater than 0": ["controller.R=[1,-1,1,1]"],
    "controller.R = [1, nan, 1, 1] is not a finite number": ["controller.R=[1,nan,1,1]"],
    "'plant.mass' is not an override: write path.to.field=value": ["plant.mass"],
    "'=3' is not an override": ["=3"],
    "seed = -1: it must be greater than or equal to 0; the default is 0": ["seed=-1"],
    "plant.mass = -1: it must be greater than or equal to 0.01 kg; the default is 0.028 kg": ["plant.mass=-1"],
    "plant.inertias ": ["plant.inertia_xx=1e-3"],
    "plant.step is ": ["plant.step=0.0010000001"],
    "controller.period = 0.0215 s has to be a whole number of physics steps": ["controller.period=0.0215"],
    "trajectory: the trajectory cannot be flown: at t = ": ["trajectory.rate=9"],
}


@pytest.mark.parametrize(("said", "overrides"), REFUSALS.items(), ids=list(REFUSALS))
def test_what_cannot_be_flown_is_refused_in_one_sentence(said, overrides):
    assert refusal(*overrides).startswith(said)


@pytest.mark.parametrize("huge", ["9" * 5000, "[" * 5000, "{a=" * 3000])
def test_text_that_breaks_the_parser_is_refused_like_any_other(huge):
    assert refusal(f"duration={huge}").startswith("duration = '")


FILES = {
    "is not valid TOML: ": b"[plant\nmass = 3",
    "is not valid TOML: an integer has too many digits": b"seed = " + b"9" * 5000,
    "it is not UTF-8 text": b"\xff\xfe\x00",
    "unknown field 'plnt': did you mean 'plant'?": b"[plnt]\nmass = 0.03",
    "plant.mass = 'heavy'": b"[plant]\nmass = 'heavy'",
    "plant = [{'kind': 'ideal'}] names no plant": b"[[plant]]\nkind = 'ideal'",
}


@pytest.mark.parametrize(("said", "content"), FILES.items(), ids=list(FILES))
def test_a_bad_file_is_refused_in_one_sentence(said, content, tmp_path):
    file = tmp_path / "mine.toml"
    file.write_bytes(content)
    assert said in refusal(source=str(file))


def test_a_file_that_is_not_there_is_named(tmp_path):
    assert refusal(source=str(tmp_path / "none.toml")) == f"cannot read {tmp_path}/none.toml: No such file or directory"
    assert refusal(source=str(tmp_path)).startswith(f"unknown preset '{tmp_path}'")
    assert refusal(source="idael").startswith(
        "unknown preset 'idael': did you mean 'ideal'? Available: calibrate_check, "
    )


def test_a_file_changes_what_it_names_and_nothing_else(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text('duration = 3\n[plant]\nmass = 0.03\nkind = "mujoco"\n[disturbances]\ngust = "off"\nbias.z = 0.1\n')
    expected = tree_of(Experiment())
    expected["duration"], expected["plant"]["mass"], expected["disturbances"]["bias"]["z"] = 3.0, 0.03, 0.1
    del expected["disturbances"]["gust"]
    assert tree_of(load(str(file))) == expected


def test_disturbances_and_faults_go_off_and_on():
    assert [d.kind for d in load("lab", ["disturbances.gust=off"]).disturbances] == ["bias"]
    assert load("lab", ["disturbances.gust=off", "disturbances.bias=off"]).disturbances == ()
    assert [d.kind for d in load("ideal", ["disturbances.gust=on"]).disturbances] == ["gust"]
    # A field of one that is off switches it on; on keeps what was set.
    (gust,) = load("ideal", ["disturbances.gust.strength=0.4"]).disturbances
    assert gust.strength == 0.4
    (gust,) = load("ideal", ["disturbances.gust.strength=0.4", "disturbances.gust=on"]).disturbances
    assert gust.strength == 0.4
    assert load("ideal", ["disturbances.gust.strength=0.4", "disturbances.gust=off"]).disturbances == ()


def test_another_kind_starts_from_its_own_defaults_and_the_same_kind_keeps_its_fields(tmp_path):
    file = tmp_path / "small.toml"
    file.write_text("trajectory.radius = 0.3\ntrajectory.height = 0.7\n")
    for same in ([], ["trajectory=circle"], ["trajectory.kind=circle"]):
        assert load(str(file), same).trajectory.radius == 0.3
    assert load(str(file), ["trajectory=hover"]).trajectory.height == 1.0
    with pytest.raises(ExperimentError, match=r"unknown field 'trajectory\.radius'"):
        load("lab", ["trajectory.radius=0.3", "trajectory=hover"])


@pytest.mark.parametrize("kind", ["trajectory=hover", "trajectory.kind=hover", 'trajectory="hover"'])
def test_a_change_of_kind_counts_before_the_others(kind):
    for overrides in ([kind, "trajectory.yaw=1"], ["trajectory.yaw=1", kind]):
        hover = load("lab", overrides).trajectory
        assert (hover.kind, hover.yaw) == ("hover", 1.0)
    text = "controller.coupling=full"
    assert load("lab", [text, "plant=ideal"]).controller.coupling == "full"


def test_of_two_changes_the_later_one_holds():
    assert load("lab", ["seed=1", "seed=2"]).seed == 2


def test_spaces_and_quotes_are_as_in_toml():
    assert load("lab", ["plant.mass = 0.03"]).plant.mass == 0.03
    assert load("lab", ["controller.coupling = 'full'"]).controller.coupling == "full"
    assert load("lab", ["plant = {mass = 0.03}"]).plant.mass == 0.03
    assert load("lab", ["seed = 1_000"]).seed == 1000


anything = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)


@given(st.sampled_from([*sorted(LEAVES), *FAMILIES, *(f"{f}.kind" for f in ONE_OF), "disturbances.gust"]), anything)
@settings(max_examples=300)
def test_any_tree_is_an_experiment_or_an_experiment_error(path, value):
    tree = tree_of(everything_on())
    *tables, last = path.split(".")
    node = tree
    for table in tables:
        node = node[table]
    node[last] = value
    try:
        experiment = from_json(json.dumps(tree))
    except ExperimentError:
        return
    assert isinstance(experiment, Experiment)


@given(st.sampled_from([*sorted(LEAVES), *FAMILIES]) | st.text(max_size=8), st.text(max_size=8))
@settings(max_examples=300)
def test_any_override_is_an_experiment_or_an_experiment_error(path, value):
    try:
        experiment = load("lab", [f"{path}={value}"])
    except ExperimentError:
        return
    assert isinstance(experiment, Experiment)


@pytest.mark.parametrize("text", ["", "{", "[]", "3", "null", '{"plant": {"kind": [1]}}', "[" * 100_000])
def test_json_that_is_no_experiment_is_refused(text):
    with pytest.raises(ExperimentError):
        from_json(text)


def test_a_need_just_above_the_limit_is_not_printed_as_the_limit():
    text = refusal("trajectory.rate=2", "trajectory.radius=0.5", "controller.model.vx_max=0.9999999")
    needed, limit = text.partition("forward speed vx = ")[2].split(" m/s, the limit is ")
    assert float(needed) > float(limit.split()[0])


HOSTILE = {
    "digits": "duration = " + "9" * 5000,
    "hex": "duration = 0x" + "f" * 9000,
    "brackets": "duration = " + "[" * 3000 + "]" * 3000,
    "levels": "radio.levels = " + "9" * 400,
    "seed": "seed = -" + "9" * 400,
    "dots": ".".join(["a"] * 2000) + " = 1",
    "flights": "trajectory." + "flight." * 2000 + "kind = 'takeoff_and_landing'",
    "braces": "plant = " + "{a=" * 2000 + "1" + "}" * 2000,
    "name": "n" * 300 + " = 1",
    "deep name": "plant." + "n" * 300 + " = 1",
    "member": "disturbances." + "n" * 300 + " = 'gust'",
    "kind": "plant.kind = '" + "n" * 3000 + "'",
    "text": "duration = '" + "n" * 100_000 + "'",
    "choice": "controller.coupling = '" + "n" * 100_000 + "'",
    "list": "controller.Q = [" + "1," * 100_000 + "]",
    "infinite": "plant.mass = 1e999",
    "huge": "trajectory.radius = 1e308",
    "table": "plant = [{kind = 'ideal'}]",
    "rows": "trajectory = {kind = 'csv', rows = '/dev/zero'}",
    "long file": "trajectory = {kind = 'csv', rows = '" + "n" * 3000 + "'}",
    "points": "trajectory = {kind = 'waypoints', points = [[1e308, 0, 1, 0], [-1e308, 0, 1, 0]]}",
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_text_is_one_short_sentence_as_override_and_in_a_file(name, tmp_path, capsys):
    file = tmp_path / "mine.toml"
    file.write_text(HOSTILE[name])
    path, _, value = HOSTILE[name].partition(" = ")
    for words in ([f"{path}={value}"], [str(file)]):
        assert main(["fly", *words, "--no-log"]) == 2
        said = capsys.readouterr().err
        assert said.count("\n") == 1
        assert len(said) < 500
        assert said.startswith("heli-twin: ")


def test_a_takeoff_30_deep_is_refused_at_once(tmp_path):
    file = tmp_path / "nested.toml"
    inner = "{kind='hover'}"
    for _ in range(30):
        inner = f"{{kind='takeoff_and_landing',flight={inner}}}"
    file.write_text(f"trajectory={inner}")
    assert "flight is a take-off and landing again" in refusal(source=str(file))
