"""Any experiment inside its declared bounds has an outcome or is refused in one sentence; so does any command line."""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from experiment.test_text import EACH_OF, LEAVES, MEMBERS, allowed, leaves
from hypothesis import given, settings
from hypothesis import strategies as st

from heli_twin.cli import main
from heli_twin.experiment.families import members
from heli_twin.experiment.text import load
from heli_twin.experiment.tree import ExperimentError
from heli_twin.experiment.values import LARGEST, SMALLEST
from heli_twin.lab.disturbances.bias import Bias
from heli_twin.lab.plant import Air
from heli_twin.mission import fly

OUTCOMES = {"completed", "crashed", "left_volume", "diverged"}
# Times that only make a flight long or its steps many: the flights here are short.
SLOW = {"duration", "plant.step", "mocap.rate"}


@cache
def numbers(kinds):
    """Each number of an experiment with these members and with every disturbance, fault and effect."""
    on = [f"{family}.{kind}=on" for family, package in EACH_OF.items() for kind in members(package)]
    if "plant=ideal" not in kinds:
        on += [f"plant.effects.{kind}=on" for kind in members("heli_twin.lab.plant.effects")]
    return {path: part for path, part in leaves(load("lab", [*kinds, *on])) if part.type in (float, int)}


@st.composite
def overrides(draw):
    kinds = draw(st.lists(st.sampled_from(MEMBERS), max_size=2, unique_by=lambda member: member[0]))
    kinds = tuple(f"{family}={kind}" for family, kind in kinds)
    parts = numbers(kinds)
    paths = draw(st.lists(st.sampled_from(sorted(parts.keys() - SLOW)), max_size=3, unique=True))
    return [*kinds, *(f"{path}={draw(allowed(parts[path]))!r}" for path in paths)]


@given(overrides(), st.integers(0, 2**53))
@settings(max_examples=200)
def test_any_experiment_inside_its_bounds_has_an_outcome_or_is_refused(lines, seed) -> None:
    try:
        result = fly(load("lab", [*lines, f"seed={seed}", "duration=0.1"]), log_dir=None)
    except ExperimentError as refusal:
        text = str(refusal)
        assert "\n" not in text
        assert len(text) < 500
        return
    assert result.outcome.kind in OUTCOMES
    log = result.log
    assert np.isfinite(log.sent.u).all()
    assert np.isfinite(log.reference.x).all()
    if result.outcome.kind == "completed":
        assert np.isfinite(log.truth.position).all()
        assert np.isfinite(log.estimate.x).all()


@pytest.mark.parametrize(
    "change",
    [
        "estimator.mean_time=0.001",
        f"estimator.mean_time={LARGEST}",
        f"estimator.gust_time={SMALLEST}",
        f"faults.servo_weak.rate={SMALLEST}",
        f"faults.pose_flip.rate={SMALLEST}",
    ],
)
def test_the_extremes_of_a_time_or_a_rate_can_be_flown(change) -> None:
    assert fly(load("lab", [change, "duration=0.1"]), log_dir=None).outcome.kind == "completed"


@pytest.mark.parametrize("value", ["1e13", "1" + 15 * "0"])
def test_a_number_beyond_any_size_is_refused(value) -> None:
    with pytest.raises(ExperimentError, match=r"volume.height = .*: it must be at most 1e\+12"):
        load("lab", [f"volume.height={value}"])


def test_a_number_that_has_no_finite_inverse_is_refused() -> None:
    with pytest.raises(ExperimentError, match=r"rate = 5e-324: it must be 0 or at least 1e-30 in size"):
        load("lab", ["faults.servo_weak.rate=5e-324"])


@dataclass(frozen=True)
class Blast(Bias):
    """A push that only a class of the user's own can have; its square overflows."""

    def air(self, truth):
        push = np.full(3, 1e200)
        return Air(push, push * (push * push > 0.0))


@pytest.mark.parametrize("plant", ["mujoco", "ideal"])
def test_a_flight_with_overflow_has_an_outcome_and_prints_nothing(plant, capfd) -> None:
    """Warnings are errors here, and MuJoCo's own warnings would appear in the output of the process."""
    experiment = replace(load("lab", [f"plant={plant}", "duration=0.1"]), disturbances=(Blast(),))
    assert fly(experiment, log_dir=None).outcome.kind in ("diverged", "left_volume")
    assert capfd.readouterr() == ("", "")


words = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=12)
path = st.sampled_from(sorted(LEAVES)) | st.lists(words, max_size=4).map(".".join)
value = words | st.sampled_from(
    ["off", "on", "1e999", "-1", "[]", "{}", "[[1]]", "nan", "9" * 500, "x.toml", "2020-01-01"]
)
line = st.tuples(path, st.sampled_from(["=", " = ", "=="]), value).map("".join)


@given(st.lists(line, min_size=1, max_size=4))
@settings(max_examples=200)
def test_any_override_line_is_shown_or_refused_in_one_sentence(lines) -> None:
    with pytest.MonkeyPatch.context() as patch:
        said: list[str] = []
        patch.setattr("builtins.print", lambda *texts, **_: said.append(" ".join(map(str, texts))))
        try:
            code = main(["show", "lab", "--", *lines])
        except SystemExit as stop:
            # argparse's own sentence: a word that looks like an option.
            code = stop.code
            said = ["heli-twin: usage"]
    assert code in (0, 2)
    if code == 2:
        assert len(said) == 1
        assert said[0].startswith("heli-twin: ")
        assert len(said[0]) < 500
        assert "\n" not in said[0]
