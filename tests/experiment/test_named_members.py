"""Two disturbances or faults of one kind are two: each has a name, which is its kind where it has no other."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from controllers.markers import Named, by_name
from heli_twin.experiment import Experiment
from heli_twin.experiment.differences import differences, fly_words
from heli_twin.experiment.text import changed, load
from heli_twin.experiment.tree import ExperimentError, canonical_json, experiment_of, from_json, toml_of, tree_of
from heli_twin.experiment.values import SMALLEST
from heli_twin.lab.chance import generator
from heli_twin.lab.disturbances.bias import Bias
from heli_twin.lab.disturbances.gust import Gust
from heli_twin.lab.faults.pose_nan import PoseNan
from heli_twin.lab.faults.pose_outage import PoseOutage
from heli_twin.lab.plant.mujoco import MuJoCo
from heli_twin.mission import fly


def air(*disturbances) -> np.ndarray:
    """The wind and the push (n, 6) of a short flight."""
    log = fly(Experiment(duration=0.5, disturbances=disturbances), log_dir=None).log
    return np.concatenate([log.disturbance.wind, log.disturbance.acceleration], axis=1)


def test_two_pushes_add_up() -> None:
    both = air(Bias(x=1.0, y=0.0), Bias(x=0.0, y=0.0, z=0.3))
    np.testing.assert_array_equal(both, air(Bias(x=1.0, y=0.0, z=0.3)))
    np.testing.assert_array_equal(both[0], [0, 0, 0, 1.0, 0, 0.3])


def test_two_gusts_are_two_and_a_second_one_does_not_change_the_first() -> None:
    first, both = air(Gust()), air(Gust(), Gust())
    second = both - first
    assert np.abs(second[:, :2]).min() > 0
    assert not np.allclose(first, second)
    # Chance goes by the name, not by the place.
    np.testing.assert_array_equal(both, air(Named("gust_2", Gust()), Gust()))
    assert not np.allclose(both, air(Gust(), Named("other", Gust())))


def test_a_disturbance_named_like_another_part_does_not_share_its_chance() -> None:
    second = air(Gust(), Named("mocap", Gust())) - air(Gust())
    draws_of_mocap = (
        Gust().start(generator(0, "mocap")).air(MuJoCo().start(np.array([0, 0, 1.0, 0, 0, 0, 0, 0])).truth()).wind
    )
    assert np.abs(second[0, :3] - draws_of_mocap).max() > 1e-3


def test_two_outages_are_two() -> None:
    faults = (PoseOutage(start=0.1, duration=0.1), PoseOutage(start=0.3, duration=0.1))
    stamps = fly(Experiment(duration=0.5, faults=faults), log_dir=None).log.pose.stamp * 1e-9
    for fault in faults:
        assert not ((stamps > fault.start + 1e-6) & (stamps < fault.start + fault.duration - 1e-6)).any()
    assert ((stamps > 0.2) & (stamps < 0.3)).any()


def test_names_are_kinds_where_nothing_else_is_said() -> None:
    assert by_name((Gust(), Bias())) == {"bias": Bias(), "gust": Gust()}
    three = (Bias(x=1.0), Bias(x=2.0), Named("bias_2", Bias(x=3.0)))
    assert {name: bias.x for name, bias in by_name(three).items()} == {"bias": 1.0, "bias_2": 3.0, "bias_3": 2.0}
    assert tree_of(Experiment(disturbances=(Named("gust", Gust()), Named("bias", Bias())))) == tree_of(Experiment())
    assert load("lab", ["disturbances.gust=gust"]) == load()


@pytest.mark.parametrize(
    "overrides",
    [
        ["disturbances.second=gust"],
        ["disturbances.second.kind=gust"],
        ["disturbances.second={kind='gust'}"],
        ["disturbances.second.strength=0.095", "disturbances.second=gust"],
        ["disturbances.second=bias", "disturbances.second.kind=gust"],
    ],
)
def test_text_adds_one_with_a_name(overrides: list[str]) -> None:
    assert load("lab", overrides).disturbances == (Bias(), Gust(), Named("second", Gust()))
    assert load("lab", [*overrides, "disturbances.second=off"]) == load()
    assert load("lab", [*overrides, "disturbances.second=on"]) == load("lab", overrides)


REFUSALS = {
    "disturbances.secnd=on": "unknown disturbances 'secnd': did you mean 'second'?",
    "disturbances.secnd.strength=1": "unknown disturbances 'secnd': did you mean 'second'?",
    "disturbances.third=off": "unknown disturbances 'third': ",
    "disturbances.third=gale": "unknown disturbances 'gale': ",
    "disturbances.bias=gust": "disturbances.bias: the name bias is for the kind bias: give the gust another, such as ",
    "disturbances.2nd=gust": "disturbances: '2nd' is not a name: take a letter",
    f"disturbances.{'n' * 300}=gust": f"disturbances: '{'n' * 40}' is not a name",
    "disturbances.second.x=1": "unknown field 'disturbances.second.x'",
    "disturbances.second=3": "disturbances.second = 3: write on, off, or one of its fields: kind, strength, time",
}


@pytest.mark.parametrize(("override", "said"), REFUSALS.items(), ids=[key[:30] for key in REFUSALS])
def test_what_names_nothing_is_refused_in_one_sentence(override: str, said: str) -> None:
    with pytest.raises(ExperimentError) as caught:
        load("lab", ["disturbances.second=gust", override])
    assert str(caught.value).startswith(said)
    assert len(str(caught.value)) < 500


@pytest.mark.parametrize(
    "disturbances",
    [(Named("a", Bias()), Named("a", Gust())), (Named("a b", Bias()),), (Named("gust", Bias()),), (3,), Bias(), None],
)
def test_objects_without_a_name_are_refused_in_one_sentence(disturbances) -> None:
    with pytest.raises(ExperimentError, match=r"^disturbances"):
        fly(Experiment(duration=0.5, disturbances=disturbances), log_dir=None)


names = st.sampled_from(["second", "a", "gust_2", "bias_2", "x-1"])
number = st.just(0.0) | st.floats(SMALLEST, 1)
disturbance = st.builds(Bias, x=number) | st.builds(Gust, strength=number)
several = st.lists(disturbance | st.builds(Named, names, disturbance), max_size=4)
faults = st.lists(st.builds(PoseOutage, start=number) | st.builds(PoseNan), max_size=3)


@given(several, faults, st.integers(0, 3))
@settings(max_examples=100)
def test_any_members_go_through_every_text_and_back(tmp_path_factory, disturbances, faults, seed) -> None:
    try:
        by_name(disturbances)
    except ValueError:
        return
    one = experiment_of(tree_of(Experiment(seed=seed, disturbances=tuple(disturbances), faults=tuple(faults))))
    assert by_name(one.disturbances) == by_name(disturbances)
    text = canonical_json(one)
    assert from_json(text) == one
    words = fly_words(text)
    source = words.pop(0) if words and "=" not in words[0] else None
    assert load(source, words) == one
    file = tmp_path_factory.getbasetemp() / "members.toml"
    file.write_text(toml_of(one))
    assert load(str(file)) == one
    told = {path for path, _, _ in differences(load(), one)}
    assert changed(load(), fly_words(text)) == one or source == "ideal"
    assert ("seed" in told) == (seed != 0)
