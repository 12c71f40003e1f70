"""Requirements in studies: they decide what has failed, and their excess is a score, a criterion and a column."""

import pytest
from in_process import InProcess

from heli_twin.requirements import RequirementError, judge, requirements_of
from heli_twin.studies.campaign import run_study
from heli_twin.studies.errors import StudyError
from heli_twin.studies.plan import plan_of
from heli_twin.studies.report.results import results_of
from heli_twin.studies.results import rows_of
from heli_twin.studies.study import load_study, study_of
from heli_twin.studies.worst import worst_runs

PUSH = "disturbances.bias.x"
STEADY = "always[1s,end] error.position < 10 cm"
TREE = {
    "name": "pushed",
    "base": {"preset": "ideal", "trajectory": "hover", "duration": 2.4, "disturbances": {"bias": "on"}},
    "axes": {PUSH: [0.0, 0.6]},
    "requirements": {"steady": STEADY, "flies": "eventually completed"},
    "score": "excess.steady",
    "metrics": ["excess.steady"],
    "logs": {"failed": 5, "worst": 0, "sampled": 0},
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("requirements") / "pushed"
    run_study(study_of(TREE), out, backend=InProcess)
    return out


def test_a_flight_that_breaks_a_requirement_has_failed_and_keeps_its_score(folder) -> None:
    still, pushed = sorted(rows_of(folder), key=lambda row: row[PUSH])
    assert (still["outcome"], pushed["outcome"]) == ("completed", "broken")
    assert pushed["outcome_text"].startswith("requirement steady: error.position is ")
    assert still["excess.steady"] < 0.0 < pushed["excess.steady"]
    assert (still["excess.flies"], pushed["excess.flies"]) == (-1.0, -1.0)
    results = results_of(folder)
    assert results.failed.sum() == 1
    assert sorted(results.penalised) == sorted([still["excess.steady"], pushed["excess.steady"]])


def test_the_excess_is_the_margin_of_the_log_that_was_kept(folder) -> None:
    from heli_twin.recording import read_log

    (log,) = (folder / "logs").glob("*.mcap")
    (pushed,) = (row for row in rows_of(folder) if row["outcome"] == "broken")
    verdict = judge(requirements_of({"steady": STEADY}), read_log(log))["steady"]
    assert pushed["excess.steady"] == pytest.approx(-verdict.normalised, abs=1e-12)
    assert worst_runs(folder)[0].what.startswith("requirement steady: error.position is ")


def test_a_margin_is_bisected_on_a_requirement(tmp_path) -> None:
    design = {"kind": "margin", "criteria": {"excess.steady": 0.0}, "coarse": 2, "halvings": 3}
    tree = {**TREE, "design": design, "axes": {PUSH: {"uniform": [0.0, 0.6]}}}
    run_study(study_of(tree), tmp_path / "margin", backend=InProcess)
    rows = sorted(rows_of(tmp_path / "margin"), key=lambda row: row[PUSH])
    kept = [row["excess.steady"] <= 0.0 for row in rows]
    assert len(rows) == 5
    assert kept == sorted(kept, reverse=True)
    edge = kept.index(False)
    assert rows[edge][PUSH] - rows[edge - 1][PUSH] == pytest.approx(0.6 / 8)


@pytest.mark.parametrize(
    ("change", "error", "sentence"),
    [
        ({"requirements": {"steady": "always tilt < 3 m"}}, RequirementError, "'tilt' is an angle"),
        ({"score": "excess.stedy"}, StudyError, "did you mean 'excess.steady'"),
        ({"metrics": ["excess.other"]}, StudyError, "unknown metric 'excess.other'"),
    ],
)
def test_what_a_study_cannot_judge_is_refused_before_it_flies(change, error, sentence) -> None:
    with pytest.raises(error, match=sentence):
        plan_of(study_of({**TREE, **change}))


def test_a_study_names_a_file_beside_it_or_shipped_requirements(tmp_path) -> None:
    (tmp_path / "req.toml").write_text(f'[requirements]\nsteady = "{STEADY}"\n')
    (tmp_path / "mine.toml").write_text('requirements = "req.toml"\n')
    (tmp_path / "shipped.toml").write_text('requirements = "hover"\n')
    assert [r.name for r in load_study(str(tmp_path / "mine.toml")).required] == ["steady"]
    assert "steady" in load_study(str(tmp_path / "shipped.toml")).requirements
