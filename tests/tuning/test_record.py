import tomllib
from dataclasses import replace
from inspect import getdoc
from pathlib import Path
from types import SimpleNamespace

import pytest

from controllers.laws.ltv_mpc import LtvMpc
from controllers.laws.pid import Pid
from controllers.model import Model
from heli_twin.errors import HeliTwinError
from heli_twin.experiment.text import load
from heli_twin.metrics.tracking import AXES
from heli_twin.studies.plan import plan_of
from heli_twin.studies.report.fairness import fairness
from heli_twin.studies.study import load_study, study_of, study_tree
from heli_twin.tuning.record import comment, origin, uncommented
from heli_twin.tuning.search import tune

GAINS = {"kind": "pid", "p_x": 1.25, "feed_forward": "flat"}
RECORD = {"command": 'heli-twin tune pid "a b"', "trials": 5, "budget": 37, "seeds": [1, 2], "controller": GAINS}
TUNED = Pid(p_x=1.25, feed_forward="flat")


def tuned_file(folder, controller="kind = 'pid'\np_x = 1.25\nfeed_forward = 'flat'\n"):
    path = folder / "tuned.toml"
    path.write_text(f"{comment(RECORD)}\n\n[controller]\n{controller}")
    return str(path)


def test_a_record_comes_back_and_its_file_is_still_a_controller(tmp_path):
    path = tuned_file(tmp_path)
    assert tomllib.loads(uncommented(Path(path).read_text())) == RECORD
    assert load(path).controller == TUNED
    assert uncommented("# a comment\n[controller]\nkind = 'pid'\n") == ""


@pytest.mark.parametrize(("law", "last_words"), [(Pid, "Ziegler and Nichols"), (LtvMpc, "weights (30)")])
def test_defaults_come_from_where_their_class_says(law, last_words):
    paragraphs = [text for text in (getdoc(law) or "").split("\n\n") if not text.startswith("Fields:")]
    last_paragraph = " ".join(paragraphs[-1].split())
    assert last_words in last_paragraph
    assert origin(law()) == f"{law().kind}, default values: \u201c{last_paragraph}\u201d"


def test_what_nobody_recorded_is_said_to_be_unrecorded():
    assert "but for offset_free = z, no tuning record" in origin(LtvMpc(offset_free="z"))
    assert "but for p_x = 1.0, no tuning record" in origin(Pid(p_x=1.0))


def test_a_record_speaks_for_what_it_found_and_nothing_else():
    said = 'pid, tuned: command heli-twin tune pid "a b", trials 5, budget 37, seeds [1, 2]'
    assert origin(TUNED, [RECORD]) == said
    assert origin(replace(TUNED, model=Model(b_x=2.5)), [RECORD]).startswith("pid, tuned but for model.b_x = 2.5: ")
    for other in (replace(TUNED, p_x=1.3), replace(TUNED, feed_forward="none"), replace(TUNED, i_z=0.3)):
        assert "no tuning record" in origin(other, [RECORD])
    assert origin(Pid(), [RECORD]) == origin(Pid())


def test_a_study_carries_along_how_its_controllers_were_tuned(tmp_path):
    path = tuned_file(tmp_path)
    study = load_study("gust", [f'alternatives.tuned={{controller="{path}"}}', f"base.controller={path}", "axes={}"])
    assert study.alternatives["tuned"]["controller"] == study.base["controller"] == GAINS
    assert study.tuning == (RECORD, RECORD)
    assert study_of(study_tree(study)) == study
    (table,) = fairness(SimpleNamespace(study=study, about={"base": plan_of(study).space.base}))
    told = dict(table.rows)
    # The one with feed-forward has the base's gains, and is what was tuned.
    for name in ("tuned", "PID with feed-forward"):
        assert told[name].startswith("pid, tuned: ")
    assert told["LTV-MPC"].startswith("ltv_mpc, default values: ")
    assert told.keys() == study.alternatives.keys()


def test_a_file_that_was_edited_has_no_record_any_more(tmp_path):
    path = tuned_file(tmp_path, "kind = 'pid'\np_x = 1.3\nfeed_forward = 'flat'\n")
    study = load_study("gust", [f'alternatives={{tuned={{controller="{path}"}}}}'])
    (table,) = fairness(SimpleNamespace(study=study, about={"base": plan_of(study).space.base}))
    assert "no tuning record" in dict(table.rows)["tuned"]


@pytest.mark.parametrize("record", [{"trials": 5}, {"controller": 5}])
def test_a_record_of_nothing_is_refused(record):
    with pytest.raises(HeliTwinError, match="needs `controller`"):
        study_of({"tuning": [record]})


def test_a_file_without_the_part_is_refused(tmp_path):
    path = tmp_path / "model.toml"
    path.write_text("[controller.model]\nb_x = 2.0\n")
    with pytest.raises(HeliTwinError, match=r"has no table \[trajectory\]"):
        load_study("gust", [f"base.trajectory={path}"])
    with pytest.raises(HeliTwinError, match="cannot read"):
        load_study("gust", [f"base.controller={tmp_path / 'nothing.toml'}"])


@pytest.mark.parametrize("kind", ["pid", "ltv_mpc"])
def test_what_tune_finds_is_recorded(kind):
    base = load("lab", [f"controller={kind}", "controller.period=0.04", "seed=3"])

    def run(work, flights):
        return [dict.fromkeys(AXES, 1.0 if flight.controller == base.controller else 0.5) for flight in flights]

    found = tune(base, run, 4)
    record = found.record()
    assert (record["trials"], record["budget"], record["seeds"]) == (4, 4, [9004, 9005])
    assert record["controller"]["period"] == 0.04
    assert tomllib.loads(uncommented(comment(record) + "\n")) == record
    assert origin(found.law, [record]).startswith(f"{kind}, tuned: trials 4, budget 4, criterion the MPC's cost (26)")
