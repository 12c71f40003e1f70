"""Reports of studies with hostile names, with one seed, and in awkward places."""

import json
import re
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from functools import partial
from html.parser import HTMLParser
from pathlib import Path

import hooks
import pytest
from in_process import InProcess

from heli_twin.reporting import plotly_json
from heli_twin.reporting.figure import Bars, Curve, Dots, Figure, Panel
from heli_twin.reporting.html_page import json_block
from heli_twin.reporting.svg import write_svg
from heli_twin.studies.campaign import run_study
from heli_twin.studies.errors import StudyError
from heli_twin.studies.report import write_report
from heli_twin.studies.study import study_of

NAMES = (
    "<script>alert(1)</script><!--<script>",
    "</script><b>&amp;",
    "a$\\frac$b",
    "]]>\"'<svg onload=x>",
    "\u96ea $x$",
)
GUST = "disturbances.gust.strength"
BASE = {"preset": "ideal", "duration": 2.6, "disturbances": {"gust": "on", "bias": "on"}}


def flown(folder: Path, **tree) -> Path:
    study = study_of({"base": BASE, "axes": {GUST: [0.1, 0.3]}, "metrics": ["rmse.x"], **tree})
    run_study(study, folder, backend=InProcess, work=partial(hooks.rough, 0.8))
    return folder


class Page(HTMLParser):
    """The elements that a browser would make, and the text of JSON blocks."""

    def __init__(self):
        super().__init__()
        self.tags, self.blocks, self.in_block, self.text = [], [], False, ""

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.in_block = ("type", "application/json") in attrs
        self.blocks += [""] if self.in_block else []

    def handle_endtag(self, tag):
        self.in_block = False

    def handle_data(self, data):
        if self.in_block:
            self.blocks[-1] += data
        else:
            self.text += data


def test_no_name_becomes_markup(tmp_path, monkeypatch):
    specs = []
    real = plotly_json.spec
    monkeypatch.setattr(plotly_json, "spec", lambda figure: specs.append(real(figure)) or specs[-1])
    monkeypatch.setattr(plotly_json, "library", lambda: "")
    alternatives = {name: {"controller": {"horizon": 10 + i}} for i, name in enumerate(NAMES)}
    rungs = [{"name": name, GUST: 0.1 + 0.1 * i} for i, name in enumerate(NAMES)]
    for number, tree in enumerate(({}, {"axes": {}, "design": {"kind": "ladder", "rungs": rungs}})):
        folder = flown(
            tmp_path / str(number),
            **{"name": "img $(x)", "question": NAMES[0], "alternatives": alternatives, "replicates": 2, **tree},
        )
        specs.clear()
        page = Page()
        page.feed(write_report(folder).read_text())
        assert specs
        assert [json.loads(block) for block in page.blocks] == json.loads(json.dumps(specs))
        assert page.tags.count("script") == len(specs) + 2
        assert not {"b", "svg"} & set(page.tags)
        assert all(name in page.text for name in NAMES)
        for drawn in (folder / "figures").glob("*.svg"):
            assert ElementTree.parse(drawn).getroot().tag.endswith("svg")


def test_json_in_a_page_holds_no_tag_and_is_the_data():
    data = {"name": [*NAMES, 1.5, None]}
    block = json_block(data)
    assert block.count("<") == 2
    assert json.loads(re.fullmatch(r"<script[^>]*>(.*)</script>", block)[1]) == data


def test_plotly_shows_names_as_they_are():
    import numpy as np

    one = np.ones(1)
    for mark in (Curve("<b>", one, one), Bars("<b>", ["<b>"], one, one), Dots("<b>", ["<b>"], one, one, one, ["<b>"])):
        text = json.dumps(plotly_json.spec(Figure("f", "", "", [Panel("<i>", "<b>", "<b>", [mark])])))
        assert text.replace("<b>&lt;i&gt;</b>", "").count("<") == 0, mark


def test_names_with_dollars_are_drawn_on_logarithmic_axes_too(tmp_path):
    import numpy as np

    x = np.array([0.01, 1.0, 100.0])
    figure = Figure("f", "", "", [Panel(name, name, name, [Curve(name, x, x)], True, True) for name in NAMES])
    write_svg(figure, tmp_path / "f.svg")
    assert ElementTree.parse(tmp_path / "f.svg").getroot().tag.endswith("svg")
    assert "mathdefault" not in (tmp_path / "f.svg").read_text()


def sections(page: Path) -> dict[str, str]:
    text = re.sub(r"<script>.*?</script>", "", page.read_text(), flags=re.S)
    return {
        re.search("<h2>(.*?)</h2>", part)[1]: part
        for part in re.findall(r"<section.*?</section>", text, re.S)
        if "application/json" not in part or "<p>" in part
    }


PAIR = {"first": {}, "second": {"controller": {"coupling": "full"}}}


@pytest.mark.parametrize(
    "tree",
    [
        {},
        {"design": "one_at_a_time", "axes": {GUST: {"uniform": [0.1, 0.5]}}},
        {"design": {"kind": "latin_hypercube", "points": 8}, "axes": {GUST: {"uniform": [0.1, 1.0]}}},
        {"design": {"kind": "margin", "criteria": {"rmse.position": 0.4}}, "axes": {GUST: {"uniform": [0, 1]}}},
        {"design": {"kind": "ladder", "rungs": [{"name": "storm", GUST: 0.5}]}, "axes": {}},
    ],
    ids=["grid", "tornado", "cloud", "margin", "ladder"],
)
def test_one_seed_has_no_interval_and_says_so(tmp_path, tree):
    page = write_report(flown(tmp_path, alternatives=PAIR, **tree))
    told = sections(page)
    assert "one seed" in told["Verdict"]
    assert "better" not in told["Verdict"] or "nobody is called better" in told["Verdict"]
    for title in ("Verdict", "Ladder in numbers", "Margins in numbers"):
        assert not re.search(r"\[[^\]]*, [^\]]*\]", told.get(title, "")), title
    for title in ("Tornado", "Margins", "Mismatch ladder", f"Along {GUST}", "One at a time"):
        assert "one seed" in told.get(title, "one seed"), title


def test_several_seeds_have_intervals_over_the_seeds_alone(tmp_path):
    told = sections(write_report(flown(tmp_path, alternatives=PAIR, replicates=3)))
    # Points 0.1 and 0.3, and a millimetre for each seed: mean 20.1 cm, and 0.1 cm times 4.303 / sqrt(3) for three.
    assert "20.1 [19.9, 20.3] cm" in told["Verdict"]
    assert "second is worse" in told["Verdict"]


def test_a_report_can_be_written_elsewhere(tmp_path):
    folder = flown(tmp_path / "study")
    before = sorted(folder.iterdir())
    page = write_report(folder, tmp_path / "away")
    assert page == tmp_path / "away" / "report.html"
    assert sorted(folder.iterdir()) == before


@pytest.mark.parametrize("taken", ["report.html", "figures"])
def test_a_place_that_is_taken_is_told(tmp_path, taken):
    folder = flown(tmp_path)
    if taken == "figures":
        (folder / taken).write_text("")
    else:
        (folder / taken).mkdir()
    with pytest.raises(StudyError, match=f"cannot write .*{taken}.*--out DIR"):
        write_report(folder)


READ_ONLY = """
mount --bind {0} {0} && mount -o remount,bind,ro {0} || exit 77
{heli_twin} study status {0} && {heli_twin} study worst {0} && {heli_twin} study report {0} --out {1}
echo code $?
{heli_twin} study report {0}
echo code $?
{heli_twin} study run {2} --out {0}
echo code $?
"""


def test_a_finished_study_on_read_only_media_can_be_read(tmp_path):
    folder = flown(tmp_path / "study")
    script = READ_ONLY.format(folder, tmp_path / "away", "ladder", heli_twin=f"{sys.executable} -m heli_twin")
    done = subprocess.run(["unshare", "-rm", "sh", "-c", script], capture_output=True, text=True, check=False)
    if done.returncode == 77 or "unshare:" in done.stderr:
        pytest.skip("this system has no name spaces of mounts for users")
    assert re.findall(r"code (\d)", done.stdout) == ["0", "2", "2"], done
    assert "Traceback" not in done.stderr
    assert (tmp_path / "away" / "report.html").exists()
    assert all("cannot" in line for line in done.stderr.splitlines()), done.stderr
