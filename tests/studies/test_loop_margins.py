"""Margins beside a study's verdict."""

import pytest

from heli_twin.cli import main
from heli_twin.errors import HeliTwinError
from heli_twin.metrics.margins import AXES, Margins
from heli_twin.studies.errors import StudyError
from heli_twin.studies.report.fairness import stability
from heli_twin.studies.report.loop_margins import FILE, read_margins
from heli_twin.studies.report.results import results_of

STUDY = """
margins = true

[base]
preset = "ideal"
duration = 1.0
controller = "pid"

[alternatives]
calm = { "controller.p_x" = 2.0 }
hard = { "controller.p_x" = 3.5 }
"""


def measured(experiment):
    """In place of flights of a minute, which tests/tuning flies."""
    if experiment.controller.p_x > 3.0:
        raise HeliTwinError("the loop has no margins: it left the volume")
    return dict.fromkeys(AXES, Margins(5.5, 0.123, 1.25, 3.0))


def test_a_study_measures_the_margins_of_each_alternative_and_its_report_shows_them(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("heli_twin.studies.report.loop_margins.law_margins", measured)
    file, out = tmp_path / "mine.toml", tmp_path / "out"
    file.write_text(STUDY)
    main(["study", "run", str(file), "--out", str(out), "--workers", "1"])
    assert "measuring the stability margins" in capsys.readouterr().out
    found = read_margins(out)
    assert found["calm"]["x"] == Margins(5.5, 0.123, 1.25, 3.0)
    assert "no margins" in found["hard"]
    (table,) = stability(results_of(out))
    calm, hard = table.rows
    assert calm[1] == "5.50, 123 ms, 1.25"
    assert hard[0] == "hard"
    assert "A law that errs less at a smaller margin is not better." in (out / "report.html").read_text()
    # They are measured once.
    main(["study", "run", str(file), "--out", str(out), "--workers", "1"])
    assert "measuring" not in capsys.readouterr().out
    for broken in ('{"calm": {"x": 1}}', "[", '{"calm": 7}', "[" * 10_000):
        (out / FILE).write_text(broken)
        with pytest.raises(StudyError, match="holds no margins"):
            read_margins(out)
