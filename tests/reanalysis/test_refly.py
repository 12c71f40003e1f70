"""A log flies again: the same flight, or where it first differs."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from heli_twin import HeliTwinError, fly, load, read_log
from heli_twin.cli import main
from heli_twin.commands.refly import judge
from heli_twin.logbook import flown_experiment
from heli_twin.reanalysis.refly import first_difference, refly
from heli_twin.recording import Log, recover
from heli_twin.recording.records import Messages


@pytest.fixture(scope="module")
def pid_flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short flight that is quick to fly again."""
    path = fly(load("lab", ["duration=2", "controller=pid"]), log_dir=tmp_path_factory.mktemp("flight")).path
    assert path is not None
    return path


def _with(log: Log, topic: str, index: int, data: bytes) -> Log:
    messages = list(log.messages[topic].data)
    messages[index] = data
    return replace(log, messages={**log.messages, topic: Messages(log.messages[topic].times, messages)})


def test_a_log_alone_gives_its_experiment_back() -> None:
    experiment = load("lab", ["seed=7", "duration=0.1", "faults.pose_nan=on", "trajectory=hover"])
    assert flown_experiment(fly(experiment, log_dir=None).log) == experiment


def test_flown_again_is_identical(pid_flight: Path) -> None:
    again = refly(read_log(pid_flight))
    assert again.verdict == "identical"
    assert again.difference is None
    assert again.position_deviation == 0.0


def test_the_mpc_flies_identically_again() -> None:
    log = fly(load("lab", ["duration=2"]), log_dir=None).log
    assert {refly(log).verdict for _ in range(3)} == {"identical"}


def test_a_change_keeps_the_seeds(pid_flight: Path) -> None:
    log = read_log(pid_flight)
    again = refly(log, ["plant.mass=0.03"])
    assert again.result.experiment.seed == flown_experiment(log).seed
    np.testing.assert_array_equal(again.result.log.disturbance.wind, log.disturbance.wind)
    assert again.difference is not None


def test_the_first_difference_is_named_by_topic_time_and_field(pid_flight: Path) -> None:
    log = read_log(pid_flight)
    one = bytes(log.messages["/estimate"].data[30])
    # The last number of x stands before the disturbance: 11 bytes of keys and stamp, and eight numbers.
    changed = bytearray(one)
    changed[11 + 7 * 8] ^= 1
    time = log.messages["/estimate"].times[30]
    found = first_difference(_with(log, "/estimate", 30, bytes(changed)), log)
    assert found is not None
    assert found[:3] == ("/estimate", time, "x[7]")
    assert found.logged != found.reflown


def test_the_earliest_difference_counts(pid_flight: Path) -> None:
    log = read_log(pid_flight)
    early = _with(log, "/command/sent", 3, bytes(log.messages["/command/sent"].data[4]))
    both = _with(early, "/truth", 50, bytes(log.messages["/truth"].data[51]))
    found = first_difference(both, log)
    assert found is not None
    assert found.topic == "/command/sent"


def test_a_missing_message_is_a_difference(pid_flight: Path) -> None:
    log = read_log(pid_flight)
    times, data = log.messages["/truth"]
    short = replace(log, messages={**log.messages, "/truth": Messages(times[:-1], data[:-1])})
    assert first_difference(short, log) is not None
    assert first_difference(log, short) is not None


def test_measured_times_are_no_difference(pid_flight: Path) -> None:
    log = read_log(pid_flight)
    assert first_difference(_with(log, "/timing", 5, bytes(log.messages["/timing"].data[6])), log) is None


def test_another_platform_may_round_differently(pid_flight: Path) -> None:
    log = read_log(pid_flight)
    changed = _with(log, "/command/sent", 3, bytes(log.messages["/command/sent"].data[4]))
    elsewhere = replace(changed, metadata={**log.metadata, "cpu": "another"})
    assert refly(changed).verdict == "different"
    again = refly(elsewhere)
    assert again.verdict == "within tolerance"
    assert again.platforms["cpu"][0] == "another"


def test_another_platform_may_not_fly_elsewhere(pid_flight: Path) -> None:
    log = replace(read_log(pid_flight), metadata={"cpu": "another"})
    other = fly(load("lab", ["duration=2", "controller=pid", "seed=1"]), log_dir=None).log
    assert refly(replace(log, messages=other.messages)).verdict == "different"


def test_a_recovered_log_is_compared_as_far_as_it_goes(pid_flight: Path, tmp_path: Path) -> None:
    broken = tmp_path / "run.mcap.part"
    broken.write_bytes(pid_flight.read_bytes()[: pid_flight.stat().st_size * 2 // 3])
    log = read_log(recover(broken))
    assert 0 < log.truth.time[-1] < 2e9
    assert refly(log).verdict == "identical"


@pytest.mark.parametrize("origin", ["import", "resolve"])
def test_what_was_not_flown_is_not_flown_again(pid_flight: Path, origin: str) -> None:
    with pytest.raises(HeliTwinError, match="log"):
        refly(replace(read_log(pid_flight), metadata={"origin": origin}))


def test_an_experiment_of_another_version_is_refused_in_one_sentence(pid_flight: Path) -> None:
    with pytest.raises(HeliTwinError, match="none of this version"):
        refly(replace(read_log(pid_flight), experiment='{"wings": 2}'))


def test_a_difference_is_told_with_its_size_and_the_host(pid_flight: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = read_log(pid_flight)
    one = bytearray(log.messages["/estimate"].data[30])
    one[11 + 7 * 8] ^= 1
    judge(refly(_with(log, "/estimate", 30, bytes(one))))
    out = capsys.readouterr().out
    assert re.match(
        r"different: first at 0\.\d{3} s on /estimate, x\[7\]\n  logged .*\n  flown again .*, [+-].*e-", out
    )
    assert "at most 0 mm and 0 deg apart" in out
    assert f"host and build are the same as far as the log tells ({log.metadata['cpu']}" in out


def test_the_command_says_identical_and_exits_0(pid_flight: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["refly", str(pid_flight)]) == 0
    assert capsys.readouterr().out.startswith("identical")
    assert main(["refly", str(pid_flight), "plant.mass=0.03", "--no-log"]) == 0
    assert "flown again" in capsys.readouterr().out
    assert main(["refly", str(pid_flight), "plant.mas=0.03"]) == 2
    assert "plant.mass" in capsys.readouterr().err


def test_it_tells_how_the_margin_of_each_requirement_changed(pid_flight: Path, tmp_path: Path, capsys) -> None:
    log = read_log(pid_flight)
    heavy = refly(log, ["plant.mass=0.032"]).result.log
    lowest = [float(each.truth.position[:, 2].min()) for each in (log, heavy)]
    assert lowest[1] < lowest[0]
    between = 50.0 * sum(lowest)
    file = tmp_path / "high.toml"
    file.write_text(f'[requirements]\nhigh = "always height > {between} cm"\nends = "eventually completed"\n')
    command = ["refly", str(pid_flight), "--no-log", "--require", str(file)]
    assert main([*command, "plant.mass=0.032"]) == 3
    out = capsys.readouterr().out
    row = next(line for line in out.splitlines() if line.strip().startswith("high "))
    margins = [100.0 * low - between for low in lowest]
    assert f"margin {margins[0]:.4g} cm" in row
    assert f"broken by {-margins[1]:.4g} cm" in row
    assert f" {margins[1] - margins[0]:.4g} cm" in row
    assert "1 of 2 broken: high\nbroken now and not before: high" in out
    assert main(command) == 0
    assert "+0 cm" in capsys.readouterr().out
