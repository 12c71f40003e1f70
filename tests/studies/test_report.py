import json
import re
import shutil
from base64 import b64decode
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import monotonic

import hooks
import numpy as np
import pytest

from heli_twin.reporting.figure import Curve, Figure, Panel, edges, power
from heli_twin.reporting.svg import write_svg
from heli_twin.studies.campaign import StudyProgress, embedded, run_study
from heli_twin.studies.report import write_report
from heli_twin.studies.report.effort import _distribution
from heli_twin.studies.report.progress import ProgressPage
from heli_twin.studies.results import rows_of
from heli_twin.studies.study import study_of

GUST = "disturbances.gust.strength"
BIAS = "disturbances.bias.x"
BASE = {"preset": "ideal", "duration": 2.6, "disturbances": {"gust": "on", "bias": "on"}}
RANGES = {GUST: {"uniform": [0.0, 1.0]}, BIAS: {"uniform": [0.0, 0.5]}}
PAIR = {"first": {}, "second": {"controller": {"coupling": "full"}}}
STUDIES = {
    "sweep": {"axes": {GUST: {"linspace": [0.1, 0.9, 5]}}},
    "map": {"axes": {GUST: {"linspace": [0.1, 0.9, 4]}, BIAS: {"linspace": [0.0, 0.5, 3]}}},
    "named": {"axes": {"trajectory": ["hover", "circle"]}},
    "decades": {"axes": {GUST: {"logspace": [0.01, 1.0, 4]}, BIAS: {"linspace": [0.0, 0.5, 3]}}},
    "tornado": {"design": "one_at_a_time", "axes": RANGES},
    "cloud": {"design": {"kind": "latin_hypercube", "points": 8}, "axes": RANGES},
    "sobol": {"design": {"kind": "sobol", "n": 8}, "axes": RANGES},
    "margin": {"design": {"kind": "margin", "criteria": {"rmse.position": 0.4}}, "axes": {GUST: {"uniform": [0, 1]}}},
    "search": {"design": {"kind": "worst_case", "trials": 12, "round": 4}, "axes": RANGES},
    "ladder": {"design": {"kind": "ladder", "rungs": [{"name": "storm", "disturbances": {"gust": {"strength": 0.9}}}]}},
}


@pytest.fixture(scope="module")
def reports(tmp_path_factory):
    folder = tmp_path_factory.mktemp("reports")
    work = partial(hooks.rough, 0.8)
    for name, tree in STUDIES.items():
        study = study_of(
            {"name": name, "base": BASE, "alternatives": PAIR, "replicates": 2, "metrics": ["rmse.x"], **tree}
        )
        run_study(study, folder / name, backend=partial(_embedded, 2), work=work)
        write_report(folder / name)
    return folder


def _embedded(processes, plan, timeout):
    return embedded(plan, timeout, processes)


def text_of(reports: Path, name: str) -> str:
    page = (reports / name / "report.html").read_text()
    return re.sub(r"<script>.*?</script>", "", page, flags=re.S)


def figures_of(reports: Path, name: str) -> list[dict]:
    return [json.loads(spec) for spec in re.findall(r'application/json">(.*?)</script>', text_of(reports, name), re.S)]


@pytest.mark.parametrize("name", STUDIES)
def test_a_report_needs_no_network(reports, name):
    assert not re.search(r'(src|href)="(https?:)?//', text_of(reports, name))


@pytest.mark.parametrize("name", STUDIES)
def test_every_figure_says_in_a_sentence_what_it_shows(reports, name):
    sections = re.findall(r"<section.*?</section>", text_of(reports, name), re.S)
    assert len(sections) >= 4
    for section in sections:
        sentence = re.search(r"</h2><p>(.*?)</p>", section, re.S)
        assert sentence
        assert sentence[1].endswith((".", "d).", ")"))
        assert "nan" not in sentence[1]


@pytest.mark.parametrize("name", STUDIES)
def test_every_command_in_a_figure_names_a_run_of_the_study(reports, name):
    ids = {row["id"] for row in rows_of(reports / name)}
    shown = re.findall(r"study fly \S+ ([0-9a-f]{16})", json.dumps(figures_of(reports, name)))
    assert shown
    assert set(shown) <= ids


@pytest.mark.parametrize("name", STUDIES)
def test_on_paper_every_figure_is_the_drawn_one(reports, name):
    page = text_of(reports, name)
    drawn = [
        b64decode(data) for data in re.findall(r'<img alt="[^"]+" src="data:image/svg\+xml;base64,([^"]+)">', page)
    ]
    assert drawn
    assert sorted(drawn) == sorted(path.read_bytes() for path in (reports / name / "figures").iterdir())
    assert len(drawn) == page.count('<div class="figure">')


def test_a_legend_is_never_wider_than_its_figure(tmp_path):
    x = np.arange(3.0)
    curves = [Curve(f"a controller with a long name, number {i}", x, x + i, color=i) for i in range(5)]
    write_svg(Figure("wide", "", "", [Panel("", "", "", curves)]), tmp_path / "wide.svg")
    legend = (tmp_path / "wide.svg").read_text().split('<g id="legend_1">')[1]
    assert min(float(x) for x in re.findall(r"translate\((\S+) ", legend)) > 0


@pytest.mark.parametrize("name", ["map", "ladder"])
def test_figures_are_the_same_bytes_every_time(reports, name):
    folder = reports / name
    first = {path.name: path.read_bytes() for path in (folder / "figures").iterdir()}
    write_report(folder)
    assert first
    assert {path.name: path.read_bytes() for path in (folder / "figures").iterdir()} == first


@pytest.mark.parametrize("name", [name for name in STUDIES if name not in ("named", "tornado")])
def test_failures_are_counted_not_averaged_away(reports, name):
    failed = sum(row["outcome"] != "completed" for row in rows_of(reports / name))
    assert failed
    verdict = text_of(reports, name).split("</section>")[0]
    assert sum(map(int, re.findall(r"(\d+) crashed", verdict))) == failed


def test_the_margin_is_where_the_criterion_is_crossed(reports):
    # The pretended error is the gust itself: acceptable up to 0.4.
    page = text_of(reports, "margin")
    assert re.search(r"0\.4\d?|0\.39\d?", re.search(r"<table>.*RMS position error.*?</table>", page, re.S)[0])
    finest = sorted(row["value"] for row in rows_of(reports / "margin"))
    assert min(abs(value - 0.4) for value in finest) < 0.02


def test_a_margin_that_is_never_reached_is_beyond_the_range(tmp_path):
    study = study_of({"name": "far", "base": BASE, **STUDIES["margin"]})
    study = replace(study, design=replace(study.design, criteria={"rmse.position": 5.0}))
    run_study(study, tmp_path, backend=partial(_embedded, 2), work=hooks.pretend)
    assert "&gt; 1" in text_of(tmp_path.parent, tmp_path.name) if write_report(tmp_path) else False


def test_the_search_finds_what_it_looks_for(reports):
    rows = [row for row in rows_of(reports / "search") if row["outcome"] == "completed"]
    best = {how: max(row[GUST] for row in rows if row["found_by"] == how) for how in ("search", "random")}
    assert best["search"] > 0.7


def test_an_axis_of_names_is_rows_in_the_order_of_the_study(reports):
    figure = figures_of(reports, "named")[0]
    assert figure["layout"]["yaxis"]["ticktext"] == ["hover", "circle"]
    # Rows of dots that no line joins.
    assert {trace["mode"] for trace in figure["data"]} == {"markers"}


def test_a_map_over_decades_is_logarithmic(reports):
    figure = figures_of(reports, "decades")[0]
    assert [figure["layout"][axis].get("type", "linear") for axis in ("xaxis", "yaxis")] == ["log", "linear"]
    heat = figure["data"][0]
    # Borders: the cells of four values that are a factor of 4.64 apart.
    np.testing.assert_allclose(np.diff(np.log10(heat["x"])), 2 / 3, rtol=1e-4)
    # A field that is never negative has no cell below zero.
    np.testing.assert_allclose(heat["y"], [0.0, 0.125, 0.375, 0.625])
    assert (figure["layout"]["xaxis"]["dtick"], figure["layout"]["xaxis"]["exponentformat"]) == (1, "power")


def test_cells_of_a_small_map_hold_their_numbers(reports):
    heat, texts = figures_of(reports, "map")[0]["data"][:2]
    assert (heat["type"], texts["mode"]) == ("heatmap", "text")
    values = [value for row in heat["z"] for value in row]
    assert texts["text"] == [f"{value:.3g}" if value is not None else "" for value in values]
    assert set(texts["x"]) == {0.1, 0.366667, 0.633333, 0.9}


@pytest.mark.parametrize("name", ["ladder", "tornado"])
def test_bars_of_all_alternatives_have_one_scale_and_their_grey_is_explained(reports, name):
    layout = figures_of(reports, name)[0]["layout"]
    assert layout["xaxis2"]["matches"] == "x"
    assert layout["xaxis"]["rangemode"] == "nonnegative"
    assert "grey ones lower it; thin lines are 95 % intervals over the seeds" in text_of(reports, name)


def test_a_distribution_of_few_values_is_a_step_for_each():
    curve = _distribution("", np.array([1.0, 2.0, 4.0]), 0)
    np.testing.assert_allclose(curve.x, [1, 1, 2, 4])
    np.testing.assert_allclose(curve.y, [0, 100 / 3, 200 / 3, 100])
    many = _distribution("", np.linspace(0, 1, 5000), 0)
    np.testing.assert_allclose(np.interp([0.1, 0.9], many.x, many.y), [10, 90], atol=0.3)


def test_few_points_are_large_enough_to_be_seen(reports):
    effort = next(f for f in figures_of(reports, "cloud") if "stick effort" in f["layout"]["xaxis"]["title"]["text"])
    assert {trace["marker"]["size"] for trace in effort["data"]} == {7}
    assert "stick\u00b2" in effort["layout"]["xaxis"]["title"]["text"]


def test_powers_of_ten_are_written_as_such():
    assert [power(value) for value in (1e-3, 1.0, 1e12)] == ["10\u207b\u00b3", "10\u2070", "10\u00b9\u00b2"]


def test_a_long_path_may_go_on_in_the_next_line(reports):
    assert "disturbances.<wbr>gust.<wbr>strength" in text_of(reports, "margin")


# --- while it runs


def test_a_running_study_has_a_page_that_refreshes_itself_until_it_stops(reports, tmp_path):
    shutil.copytree(reports / "map", tmp_path / "map", ignore=shutil.ignore_patterns("report.html"))
    page, file = (
        ProgressPage(study_of({"name": "map"}), tmp_path / "map", monotonic()),
        tmp_path / "map" / "report.html",
    )
    page(StudyProgress(total=100))
    assert not file.exists(), "nothing has been flown"
    page(StudyProgress(total=100, done=48, flown=48, failed={"crashed": 12}))
    text = file.read_text()
    for words in ('http-equiv="refresh"', "48 of 100 flights", "12 crashed", "image/svg", "The ten worst"):
        assert words in text
    assert "<script" not in text
    before = file.stat().st_mtime_ns
    page(StudyProgress(total=100, done=49, flown=49))
    assert file.stat().st_mtime_ns == before, "not more often than it has time for"
    page.close("stopped: the same command goes on")
    assert "refresh" not in file.read_text()
    assert "stopped: the same command goes on" in file.read_text()


def test_a_page_that_cannot_be_written_costs_nothing_else(tmp_path):
    (tmp_path / "report.html").mkdir()
    page = ProgressPage(study_of({"name": "map"}), tmp_path, monotonic())
    page(StudyProgress(total=100, done=1, flown=1))
    page.close("stopped")
    assert (tmp_path / "report.html").is_dir()


def test_the_borders_of_cells_lie_between_their_centres():
    np.testing.assert_allclose(edges(np.array([1.0, 2.0, 4.0]), log=False), [0.5, 1.5, 3.0, 5.0])
    np.testing.assert_allclose(edges(np.array([1.0, 4.0]), log=True), [0.5, 2.0, 8.0])
    np.testing.assert_allclose(edges(np.array([3.0]), log=False), [2.5, 3.5])
