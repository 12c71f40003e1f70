"""Verdicts on flights, imported logs and damaged ones; requirement files; the commands."""

import json
from dataclasses import replace

import numpy as np
import pytest

from heli_twin import fly, load
from heli_twin.cli import main
from heli_twin.errors import HeliTwinError
from heli_twin.metrics.measures import measures
from heli_twin.metrics.tracking import metrics
from heli_twin.recording import Log
from heli_twin.requirements import RequirementError, judge, requirements_of
from heli_twin.requirements.file import shipped
from heli_twin.requirements.signals import OTHERS, SIGNALS, trace_of


@pytest.fixture(scope="module")
def hover() -> Log:
    return fly(load("lab", ["trajectory=hover", "duration=4"]), log_dir=None).log


@pytest.fixture(scope="module")
def outage() -> Log:
    words = ["trajectory=hover", "duration=14", "faults.pose_outage=on", "faults.pose_outage.start=2"]
    return fly(load("lab", [*words, "faults.pose_outage.duration=60"]), log_dir=None).log


def test_margins_are_those_of_the_metrics(hover) -> None:
    verdicts = judge(
        requirements_of(
            {
                "position": "always[2s,end] error.position < 10 cm",
                "z": "always[2s,end] abs(error.z) < 10 cm",
                "yaw": "always[2s,end] abs(error.yaw) < 0.1 rad",
                "tilt": "always tilt < 0.5 rad",
                "solve": "always[20 ms,end] solve_ms < 100 ms",
            }
        ),
        hover,
    )
    greatest, also = metrics(hover)["max_abs_error"], measures(hover)
    assert verdicts["position"].margin == pytest.approx(0.1 - also["max_abs_error.position"], abs=1e-12)
    assert verdicts["z"].margin == pytest.approx(0.1 - greatest["z"], abs=1e-12)
    assert verdicts["yaw"].margin == pytest.approx(0.1 - greatest["yaw"], abs=1e-12)
    assert verdicts["tilt"].margin == pytest.approx(0.5 - also["tilt.max"], abs=1e-12)
    assert verdicts["solve"].margin == pytest.approx(100 - metrics(hover)["solve_ms"]["max"], abs=1e-9)
    assert (verdicts["position"].unit, verdicts["yaw"].unit, verdicts["solve"].unit) == ("m", "rad", "ms")
    assert verdicts["position"].normalised == pytest.approx(verdicts["position"].margin / 0.1)


def test_the_tightest_moment_is_that_of_the_greatest_error(hover) -> None:
    verdict = judge(requirements_of({"a": "always error.position < 1 cm"}), hover)["a"]
    error = trace_of(hover, {"error.position"}).signals["error.position"]
    assert not verdict.holds
    assert verdict.tightest_at == pytest.approx(0.02 * int(np.argmax(error)))
    assert verdict.reason == f"error.position is {100 * error.max():.4g} cm"
    assert verdict.margin_text == f"{100 * (0.01 - error.max()):.4g} cm"


def test_several_units_are_compared_by_their_limits(hover) -> None:
    of = {"a": "always (tilt < 20 deg and height < 1.5 m)", "t": "always tilt < 20 deg", "h": "always height < 1.5 m"}
    verdicts = judge(requirements_of(of), hover)
    assert verdicts["a"].normalised == pytest.approx(min(verdicts["t"].normalised, verdicts["h"].normalised))
    assert verdicts["a"].unit == "m"


def test_a_time_that_was_not_flown_keeps_no_requirement(hover) -> None:
    verdict = judge(requirements_of({"late": "always[9s,end] height > 1 m"}), hover)["late"]
    assert (verdict.holds, verdict.margin, verdict.reason) == (False, None, "the flight lasts 4 s: nothing to look at")


def test_without_cameras_it_lands_as_the_shipped_requirements_ask(outage) -> None:
    verdicts = judge(requirements_of("cameras_lost"), outage)
    assert {name: verdict.holds for name, verdict in verdicts.items()} == dict.fromkeys(verdicts, True)
    phases = judge(
        requirements_of(
            {
                "lost": "(not poses_lost) until[1.9s,2.4s] poses_lost",
                "lands": "eventually (landing and eventually touching)",
                "never_back": "always(poses_lost implies always poses_lost)",
                "wrong": "always[3s,end] flying",
            }
        ),
        outage,
    )
    assert [verdict.holds for verdict in phases.values()] == [True, True, True, False]
    assert phases["wrong"].reason == "flying is false"


def test_every_signal_is_in_a_flight_or_is_said_to_be_missing(hover) -> None:
    beside = replace(hover, others={"b": hover})
    for name in SIGNALS:
        if SIGNALS[name].topic == OTHERS:
            with pytest.raises(HeliTwinError, match=f"the log does not say '{name}'"):
                trace_of(hover, {name})
        values = trace_of(beside, {name}).signals[name]
        assert values.shape == (len(hover.truth.time),)
        assert SIGNALS[name].unit is not None or set(values) <= {0.0, 1.0}


@pytest.mark.parametrize("name", sorted(shipped()))
def test_shipped_requirements_are_read(name) -> None:
    assert requirements_of(name)


def test_the_poses_of_an_import_are_judged_as_the_motion(hover) -> None:
    cameras = replace(hover, messages={"/mocap/pose": hover.messages["/mocap/pose"]})
    verdicts = judge(requirements_of({"h": "always height > 0.5 m", "s": "always speed < 5 m/s"}), cameras)
    truth = judge(requirements_of({"h": "always height > 0.5 m"}), hover)
    assert verdicts["h"].margin == pytest.approx(truth["h"].margin, abs=0.01)
    assert verdicts["s"].holds
    with pytest.raises(HeliTwinError, match=r"the log does not say 'error.position': it has no `reference`"):
        judge(requirements_of("hover"), cameras)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "it is empty"),
        ("[requirements]", "has to hold lines such as"),
        ("[other]", "it has 'other'"),
        ("[requirements]\na = 3", "requirement 'a' has to be a formula in quotes or a table, it is 3"),
        ("[requirements]\na = 'tilt < 3 m'", "requirement 'a', column 1: 'tilt' is an angle (rad or deg), 3 m"),
        ("[requirements.a]\ntext = 'x'", "requirement 'a' has no formula"),
        ("[requirements.a]\nformulas = 'x'", "has no key 'formulas': did you mean 'formula'?"),
        ("[requirements", "is not TOML"),
    ],
)
def test_a_bad_file_is_one_sentence(tmp_path, text, sentence) -> None:
    path = tmp_path / "req.toml"
    path.write_text(text)
    with pytest.raises(RequirementError) as refused:
        requirements_of(path)
    assert sentence in str(refused.value)
    assert len(str(refused.value)) < 480


def test_the_commands_judge(tmp_path, capsys) -> None:
    path = tmp_path / "req.toml"
    path.write_text('[requirements]\nhigh = "always height > 0.5 m"\nquiet = "always height > 1.5 m"\n')
    words = ["fly", "ideal", "trajectory=hover", "duration=2", "--log-dir", str(tmp_path), "--json"]
    assert main([*words, "--require", str(path)]) == 3
    flown = json.loads(capsys.readouterr().out)
    assert [flown["requirements"][name]["holds"] for name in ("high", "quiet")] == [True, False]
    assert main(["judge", str(path), flown["log"], "--json"]) == 3
    assert json.loads(capsys.readouterr().out) == flown["requirements"]
    path.write_text('[requirements]\nhigh = "always height > 0.5 m"\n')
    assert main(["judge", str(path), flown["log"]]) == 0
    assert "all 1 hold" in capsys.readouterr().out
    assert main(["judge", "hoverr", flown["log"]]) == 2
    assert main(["judge", str(path)]) == 2


def test_an_empty_log_says_that_there_is_nothing_to_judge() -> None:
    with pytest.raises(HeliTwinError, match="there is nothing to judge"):
        judge(requirements_of("hover"), Log({}))
