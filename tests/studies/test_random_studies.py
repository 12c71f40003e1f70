"""Whatever a study file holds: a plan, or one sentence."""

import math
import time

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from heli_twin.errors import HeliTwinError
from heli_twin.studies.axes import Linspace, Logspace
from heli_twin.studies.plan import plan_of
from heli_twin.studies.study import Study, load_study, study_of

LONGEST_MESSAGE = 500
QUICK_S = 5.0
"""A plan is checked in far less; a loaded machine is slower."""
PATHS = ("plant.mass", "plant", "controller", "radio.latency", "controller.horizon", "faults", "volume", "seed")
FIELDS = ("name", "base", "alternatives", "axes", "design", "replicates", "seed", "score", "metrics", "tuning", "logs")

words = st.sampled_from((*PATHS, *FIELDS, "pid", "ideal", "linspace", "on", "off", "mine.toml", "$x$", "kind"))
texts = words | st.text(max_size=10)
numbers = st.integers(-3, 3) | st.integers() | st.floats() | st.sampled_from((0.028, 0.03, 1e12, 1e300, 10**400))
leaves = st.none() | st.booleans() | numbers | texts | st.dates()
values = st.recursive(leaves, lambda inner: st.lists(inner, max_size=4) | st.dictionaries(texts, inner, max_size=4))
ranges = st.sampled_from(("linspace", "logspace", "normal", "uniform")).flatmap(
    lambda kind: st.lists(numbers, min_size=2, max_size=3).map(lambda args: {kind: args})
)
kinds = st.sampled_from(
    ("grid", "ladder", "latin_hypercube", "margin", "morris", "boundary", "one_at_a_time", "sobol", "worst_case")
)
designs = kinds | st.fixed_dictionaries({"kind": kinds}, optional={"points": numbers, "n": numbers, "trials": numbers})
axes = st.dictionaries(st.sampled_from(PATHS) | texts, ranges | st.lists(values, max_size=4) | values, max_size=3)
studies = st.dictionaries(texts, values, max_size=3) | st.fixed_dictionaries(
    {},
    optional={
        "axes": axes,
        "design": designs | values,
        "base": st.dictionaries(st.sampled_from((*PATHS, "preset")) | texts, values, max_size=3),
        "alternatives": st.dictionaries(texts, st.dictionaries(st.sampled_from(PATHS), values) | values, max_size=3),
        "replicates": st.integers(1, 3) | values,
        "seed": numbers,
        "name": texts,
    },
)


def one_sentence(error: HeliTwinError) -> None:
    text = str(error)
    assert 0 < len(text) < LONGEST_MESSAGE, text
    assert "\n" not in text


@settings(max_examples=200, suppress_health_check=[HealthCheck.too_slow])
@given(studies)
def test_any_study_is_a_plan_or_one_sentence(tree):
    began = time.monotonic()
    try:
        plan = plan_of(study_of(tree))
        next(plan.runs(next(plan.batches())), None)
    except HeliTwinError as error:
        one_sentence(error)
    assert time.monotonic() - began < QUICK_S


def deep(levels: int) -> dict:
    tree: dict = {}
    for _ in range(levels):
        tree = {"a": tree}
    return tree


@pytest.mark.parametrize(
    ("tree", "words"),
    [
        ({"axes": {"plant.mass": {"linspace": [0.02, 0.03, 1e12]}}}, "1,000,000,000,000 flights, more than max_runs"),
        ({"axes": {"plant.mass": {"logspace": [0.02, 0.03, 10**18]}}}, "more than 10^15 flights"),
        ({"axes": {f"plant.{i}": {"linspace": [0, 1, 1e12]} for i in range(2000)}}, "2,000 axes: at most 100"),
        ({"base": deep(2000)}, "nested too deeply: at most 30"),
        ({"base": {"preset": 5}}, "base.preset = 5 names no preset. Available: calibrate_check, calibrate_height_yaw"),
        ({"name": "x" * 300}, "name has 300 characters, and it names a folder: at most 100"),
        ({"alternatives": {"x" * 300: {}}}, "is no name: write 1 to 100 characters"),
        ({"alternatives": {"a\x1b[2J": {}}}, "control character"),
        ({"base": {"duration": 10**400}}, "base.duration is a whole number of 1329 bits: at most 63"),
        ({"base": {"duration": math.nan}}, "base.duration = nan is not a finite number"),
        ({"axes": {"plant.mass": [0.03] * 5000}}, "same value twice"),
        ({"axes": {"plant.mass": {"linspace": list(range(9000))}}}, "linspace takes [start, stop, number]"),
    ],
)
def test_what_no_study_means_is_told_at_once(tree, words):
    began = time.monotonic()
    with pytest.raises(HeliTwinError) as refusal:
        plan_of(study_of(tree))
    assert time.monotonic() - began < QUICK_S
    one_sentence(refusal.value)
    assert words in str(refusal.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (f"replicates = {'9' * 5000}", "too many digits"),
        (f"axes.a = {'[' * 3000}{']' * 3000}", "nested too deeply"),
        (f"base{'.a' * 2000} = 1", "nested too deeply"),
        ("tuning = 5\nbase.controller = 'x.toml'", "cannot read x.toml"),
        ("base.duration = 2020-01-01", "base.duration = 2020-01-01: write a number"),
    ],
)
def test_files_that_break_parsers_are_told_in_one_sentence(tmp_path, text, words):
    path = tmp_path / "mine.toml"
    path.write_text(text)
    with pytest.raises(HeliTwinError) as refusal:
        plan_of(load_study(str(path)))
    one_sentence(refusal.value)
    assert words in str(refusal.value)


@pytest.mark.parametrize("source", ["x" * 300, "x" * 300 + ".toml", "a\0b.toml", ".toml"])
def test_names_of_files_that_cannot_be_are_told_in_one_sentence(source):
    with pytest.raises(HeliTwinError) as refusal:
        load_study(source)
    one_sentence(refusal.value)


@pytest.mark.parametrize(
    "words",
    [["axes=5", "axes.plant.mass=[0.03]"], [f"replicates={'9' * 5000}"], [f"base{'.a' * 2000}=1"], ["base.preset=5"]],
)
def test_overrides_that_make_no_study_are_told_in_one_sentence(words):
    with pytest.raises(HeliTwinError) as refusal:
        plan_of(load_study("mass", words))
    one_sentence(refusal.value)


@pytest.mark.parametrize("axis", [Linspace(0.02, 0.03, 4), Logspace(0.02, 0.03, 4), Linspace(1, 2, 1)])
def test_the_count_of_an_axis_is_that_of_its_levels(axis):
    assert axis.count() == len(axis.levels())


def test_a_study_of_one_flight_needs_nothing():
    assert plan_of(Study()).count() == 1
