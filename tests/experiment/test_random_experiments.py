"""Any experiment inside its declared bounds has an outcome or is refused in one sentence; so does any command line."""

import numpy as np
import pytest
from experiment.test_text import LEAVES, MEMBERS, NUMBERS, allowed
from hypothesis import given, settings
from hypothesis import strategies as st

from heli_twin.cli import main
from heli_twin.experiment.text import load
from heli_twin.experiment.tree import ExperimentError
from heli_twin.mission import fly

OUTCOMES = {"completed", "crashed", "left_volume", "diverged"}
# Times that only make a flight long or its steps many: the flights here are short.
SLOW = {"duration", "plant.step", "mocap.rate"}
change = st.sampled_from(sorted(NUMBERS.keys() - SLOW)).flatmap(
    lambda path: allowed(NUMBERS[path]).map(lambda value: f"{path}={value!r}")
)
kinds = st.lists(st.sampled_from([f"{family}={kind}" for family, kind in MEMBERS]), max_size=2)


@given(kinds, st.lists(change, max_size=3), st.integers(0, 2**53))
@settings(max_examples=60)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_any_experiment_inside_its_bounds_has_an_outcome_or_is_refused(kinds, changes, seed) -> None:
    try:
        result = fly(load("lab", [*kinds, *changes, f"seed={seed}", "duration=0.1"]), log_dir=None)
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
