"""Figures of flights show what the logs hold, are the same for the same logs, and refuse what cannot be shown."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_hex

from heli_twin import HeliTwinError, Log, fly, load, plot, read_log
from heli_twin.cli import main
from heli_twin.metrics.motion import outages
from heli_twin.plots.figure import FlightFigure, rendered
from heli_twin.plots.marks import events, faults
from heli_twin.plots.runs import runs
from heli_twin.requirements import judge, requirements_of

LOST = ["duration=3", "trajectory=hover", "faults.pose_outage.start=1", "faults.pose_outage.duration=0.4"]


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    flown = fly(load("lab", LOST), log_dir=tmp_path_factory.mktemp("flight")).path
    assert flown is not None
    return flown


@pytest.fixture(scope="module")
def log(path: Path) -> Log:
    return read_log(path)


@pytest.fixture(scope="module")
def other() -> Log:
    return fly(load("lab", ["duration=1", "trajectory=hover", "seed=1"]), log_dir=None).log


def curve(figure: FlightFigure, row: int, label: str) -> np.ndarray:
    """Points (n, 2) of the curve of that name in the left or only column."""
    axes = [a for a in figure.axes if a.get_subplotspec().colspan.start == 0][row]
    line = next(line for line in axes.get_lines() if line.get_label() == label)
    return np.asarray(line.get_xydata())


def test_what_is_drawn_is_what_was_recorded(log: Log) -> None:
    flown = curve(plot(log), 2, "flown")
    np.testing.assert_allclose(flown[:, 0], 1e-9 * log.truth.stamp)
    np.testing.assert_allclose(flown[:, 1], log.truth.position[:, 2])
    sent = curve(plot(log, what="inputs"), 0, "sent")
    np.testing.assert_allclose(sent[:-1, 1], log.sent.u[:, 0])


def test_a_window_shows_no_more(log: Log) -> None:
    time = curve(plot(log, start=1.0, end=2.0), 0, "flown")[:, 0]
    assert (time[0], time[-1]) == pytest.approx((1.0, 2.0))


def test_an_outage_a_fault_and_the_supervisor_are_marked(log: Log) -> None:
    (run,) = runs([log])
    (gap,), (fault,) = outages(log), faults(run)
    # The first pose that is lost was seen up to one frame after the fault began.
    assert (gap.start, gap.end) == pytest.approx((1.0, 1.4), abs=0.03)
    assert fault == (1.0, 1.4, "pose_outage")
    assert [name for _, name in events(run)] == ["coasting", "flying"]


def test_flights_lie_over_each_other_in_their_own_colours(log: Log, other: Log) -> None:
    figure = plot(log, other, names=["long", "short"])
    lines = [line for line in figure.axes[0].get_lines() if line.get_label() in ("long", "short")]
    assert [line.get_label() for line in lines] == ["long", "short"]
    assert to_hex(lines[0].get_color()) != to_hex(lines[1].get_color())


def test_a_legend_says_what_differs(log: Log, other: Log) -> None:
    first, second = (run.name for run in runs([log, other]))
    assert "seed=1" in second
    assert "pose_outage" in first
    assert "trajectory=hover" not in first + second


def test_all_is_every_kind_on_one_page(log: Log) -> None:
    figure = plot(log, what="all", width=3.5)
    assert figure.get_figwidth() == 3.5
    assert [len(part.axes) for part in figure.subfigs] == [8, 4, 2, 4, 4]


@pytest.mark.parametrize("form", ["svg", "pdf"])
def test_the_same_log_gives_the_same_bytes(log: Log, form: str) -> None:
    first, second = (rendered(plot(log, what="path", end=1.5), form) for _ in range(2))
    assert first == second


def test_an_imported_recording_is_drawn_by_the_cameras(log: Log) -> None:
    seen = replace(log, messages={t: m for t, m in log.messages.items() if t in ("/mocap/pose", "/events")})
    assert len(curve(plot(seen), 0, "by the cameras")) == len(np.unique(log.pose.stamp))
    assert len(plot(seen).axes) == 4, "without a reference there is no error"
    with pytest.raises(HeliTwinError, match="no truth"):
        plot(seen, what="estimate")
    assert plot(seen, what="all").axes


def test_the_command_writes_whole_files_under_free_names(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / f"{path.stem}-path.svg").touch()
    assert main(["plot", str(path), "--what", "path"]) == 0
    assert {file.name for file in tmp_path.iterdir()} == {f"{path.stem}-path.svg", f"{path.stem}-path-2.svg"}
    (tmp_path / "t.pdf").write_bytes(before := b"mine")
    assert main(["plot", str(path), "--out", "t.pdf"]) == 2
    assert "t.pdf exists already" in capsys.readouterr().err
    assert (tmp_path / "t.pdf").read_bytes() == before
    assert main(["plot", str(path), "--what", "path", "--out", "t.pdf", "--force"]) == 0
    assert (tmp_path / "t.pdf").read_bytes().startswith(b"%PDF")


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--what", "pathh"], "did you mean 'path'"),
        (["--from", "5"], "0 and 3 s"),
        (["--from", "2", "--to", "1"], "0 and 3 s"),
        (["--from", "nan"], "0 and 3 s"),
        (["--names", "a,b"], "2 names for 1 flights"),
        (["--width", "0"], "2.5 to 30 inches"),
        (["--out", "flight.gif"], ".svg, .pdf or .png"),
        (["--out", "no/flight.svg"], "no folder"),
    ],
)
def test_a_mistake_is_one_sentence_and_leaves_nothing(
    words: list[str],
    sentence: str,
    path: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["plot", str(path), *words]) == 2
    error = capsys.readouterr().err
    assert sentence in error
    assert error.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_a_notebook_shows_it_and_no_window_opens(path: Path) -> None:
    code = (
        f"import sys, heli_twin; png = heli_twin.plot({str(path)!r}, what='path')._repr_png_();"
        " print(png[1:4], 'matplotlib.pyplot' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "b'PNG' False\n"


# --- requirements

REQUIRED = {
    "near": "always[0.5s,end] error.position < 1 mm",
    "high": "always height > 20 cm",
    "late": "always[9s,end] touching",
}


def test_the_tightest_moment_of_each_requirement_is_marked_with_its_margin(log: Log) -> None:
    verdicts = judge(requirements_of(REQUIRED), log)
    labels = {
        "near": f"1 near: broken by {verdicts['near'].margin_text[1:]} at {verdicts['near'].tightest_at:.2f} s",
        "high": f"2 high: margin {verdicts['high'].margin_text} at {verdicts['high'].tightest_at:.2f} s",
    }
    for what in ("tracking", "inputs", "estimate", "timing"):
        figure = plot(log, what=what, requirements=REQUIRED)
        lines = {line.get_label(): line for line in figure.axes[0].get_lines()}
        for name, label in labels.items():
            assert lines[label].get_xdata()[0] == verdicts[name].tightest_at
        assert to_hex(lines[labels["near"]].get_color()) != to_hex(lines[labels["high"]].get_color())
        # There is nothing to look at, so that no moment is marked.
        assert not len(lines["3 late: broken"].get_xdata())
        numbers = {text.get_text() for text in figure.axes[0].texts} & {"1", "2", "1, 2"}
        assert "".join(sorted(numbers)) in ("12", "1, 2")


def test_on_a_path_the_tightest_moment_is_where_the_helicopter_was(log: Log) -> None:
    verdict = judge(requirements_of(REQUIRED), log)["high"]
    at = log.truth.position[int(np.argmin(np.abs(log.truth.time - 1e9 * verdict.tightest_at)))]
    above, aside = plot(log, what="path", requirements=REQUIRED).axes
    for axes, point in ((above, (at[1], at[0])), (aside, (at[1], at[2]))):
        (diamond,) = (line for line in axes.get_lines() if line.get_label().startswith("2 high: margin"))
        np.testing.assert_allclose(np.ravel(diamond.get_data()), point)


def test_of_several_flights_each_has_its_own_mark_and_those_outside_the_window_are_told(log: Log, other: Log) -> None:
    figure = plot(log, other, names=["long", "short"], requirements={"high": "always height > 20 cm"})
    first, second = (line for line in figure.axes[0].get_lines() if line.get_label().startswith("1 high, "))
    assert (to_hex(first.get_color()), to_hex(second.get_color())) == tuple(
        run.color.lower() for run in runs([log, other])
    )
    assert [line.get_label().split(":")[0] for line in (first, second)] == ["1 high, long", "1 high, short"]
    shown = plot(log, start=0.0, end=0.04, requirements=REQUIRED).axes[0].get_lines()
    assert not len(next(line for line in shown if line.get_label().startswith("1 near: broken by")).get_xdata())


def test_the_command_draws_requirements_and_refuses_wrong_ones(path: Path, tmp_path: Path, capsys) -> None:
    out = tmp_path / "judged.svg"
    assert main(["plot", str(path), "--require", "hover", "--out", str(out)]) == 0
    assert "4 upright: margin" in out.read_text()
    assert main(["plot", str(path), "--require", "hovr", "--out", str(tmp_path / "no.svg")]) == 2
    assert "did you mean 'hover'" in capsys.readouterr().err
    assert not (tmp_path / "no.svg").exists()
