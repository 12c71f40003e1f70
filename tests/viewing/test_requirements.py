"""Requirements in Rerun: the tightest moment is where the judge has it, in the plot, in the scene and in words."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader

from heli_twin import HeliTwinError, Log, fly, load
from heli_twin.cli import main
from heli_twin.requirements import decisive, judge, requirements_of
from heli_twin.viewing.blueprint import Scales, requirements_tab
from heli_twin.viewing.delivery import Destination
from heli_twin.viewing.requirements import comparable, judged, table
from heli_twin.viewing.show import ShownFlights, flights

REQUIRED = {
    "a | b": "always[0.5s,end] error.position < 1 mm",
    "soft": "always(height < 8 cm implies speed.vertical > -50 cm/s)",
    "ends": "eventually completed",
    "late": "always[9s,end] touching",
}


@pytest.fixture(scope="module")
def log() -> Log:
    return fly(load("ideal", ["trajectory=hover", "duration=1", "disturbances.bias=on"]), log_dir=None).log


@pytest.fixture(scope="module")
def other() -> Log:
    words = ["trajectory=hover", "duration=1", "disturbances.bias=on", "disturbances.bias.x=0.3"]
    return fly(load("ideal", words), log_dir=None).log


def rows(file: Path, entity: str) -> list[dict]:
    """The rows in time of an entity."""
    found = []
    for chunk in RrdReader(file).stream():
        if chunk.entity_path == entity and not chunk.is_static:
            found += chunk.to_record_batch().to_pylist()
    return found


def test_the_moment_is_the_judges_in_plot_scene_and_events(log: Log, tmp_path: Path) -> None:
    required = requirements_of(REQUIRED)
    experiment = load("ideal", ["trajectory=hover", "duration=1"])
    shown = ShownFlights([log], [experiment], ["run"], requirements=required)
    shown.show(Destination(tmp_path / "run.rrd"))
    verdict = judge(required, log)["a | b"]
    (point,) = rows(tmp_path / "run.rrd", "/requirements/1/tightest")
    assert point["sim_time"].total_seconds() == pytest.approx(verdict.tightest_at)
    assert point["Scalars:scalars"][0] == pytest.approx(1.0 - 1e3 * verdict.margin)
    assert {row["Scalars:scalars"][0] for row in rows(tmp_path / "run.rrd", "/requirements/1/limit")} == {1.0}
    (mark,) = rows(tmp_path / "run.rrd", "/world/requirements/1/place")
    at = int(np.argmin(np.abs(1e-9 * log.truth.time - verdict.tightest_at)))
    np.testing.assert_allclose(mark["Points3D:positions"][0], log.truth.position[at], rtol=0, atol=1e-6)
    assert mark["Points3D:labels"] == ["", f"1 a | b: {verdict.told}"]
    events = {
        row["TextLog:text"][0]: row["TextLog:level"] for row in rows(tmp_path / "run.rrd", "/events/requirements")
    }
    assert len(events) == 3
    assert events[f"requirement a | b: {verdict.told}, {verdict.reason}"] == ["ERROR"]
    assert not rows(tmp_path / "run.rrd", "/requirements/4/signal")


def test_what_decides_is_shown_in_the_unit_of_the_formula(log: Log) -> None:
    verdict = judge(requirements_of(REQUIRED), log)["soft"]
    shown = decisive(verdict, log)
    assert (list(shown.signals), shown.unit, shown.limit) == (["height"], "cm", pytest.approx(8.0))
    np.testing.assert_allclose(shown.signals["height"], 100.0 * log.truth.position[:, 2])
    np.testing.assert_allclose(shown.time, 1e-9 * log.truth.time, atol=1e-9)


def test_a_table_tells_every_verdict_and_no_name_ends_a_cell(log: Log, other: Log) -> None:
    first, second = (judged(requirements_of(REQUIRED), each) for each in (log, other))
    assert "| 1 a / b | **broken by" in table([("", first)])
    both = table([("A", first), ("B", second)]).splitlines()
    assert both[0] == "| | A | B |"
    assert {line.count("|") for line in both} == {4}
    assert both[4] == "| 3 ends | holds, 1.00 s | holds, 1.00 s |"
    assert both[5] == "| 4 late | **broken** | **broken** |"


def test_two_flights_share_a_plot_only_where_the_same_signal_decides(log: Log) -> None:
    soft, near = judged(requirements_of({"soft": REQUIRED["soft"], "near": "always error.position < 1 m"}), log)
    _, falls = soft.verdict.requirement.parsed.leaves()
    assert falls != soft.verdict.decides
    tighter = soft._replace(verdict=replace(soft.verdict, decides=falls, normalised=0.1))
    for a, b in ((soft, tighter), (tighter, soft)):
        kept = comparable([a, near], [b, near])
        assert [each[0].signals is None for each in kept] == [a is soft, b is soft]
        assert [each[1].signals is None for each in kept] == [False, False]


def test_a_file_of_many_requirements_has_few_plots_and_a_whole_table(log: Log) -> None:
    required = requirements_of({f"r{i}": "always height > 0 m" for i in range(9)})
    assert len(requirements_tab(required).plots) == 6
    assert sum(each.signals is not None for each in judged(required, log)) == 5
    assert table([("", judged(required, log))]).count("\n") == 10
    assert Scales(required=required).required == required


def test_requirements_of_a_folder_and_wrong_ones_are_refused(tmp_path: Path, capsys) -> None:
    assert main(["replay", str(tmp_path), "--require", "hover", "--save", "x.rrd"]) == 2
    assert "one flight or two" in capsys.readouterr().err
    with pytest.raises(HeliTwinError, match="did you mean 'hover'"):
        flights([tmp_path / "no.mcap"], "hovr")
