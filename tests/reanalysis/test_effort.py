"""Work that takes hours is agreed to first."""

from pathlib import Path

import pytest

from heli_twin import HeliTwinError, fly, load
from heli_twin.cli import main
from heli_twin.reanalysis import effort
from heli_twin.reanalysis.effort import control_effort, flight_effort, require_agreement


def test_effort_grows_with_duration_period_step_and_horizon() -> None:
    # 30 s: 30 s of 0.03 s and 1000 steps of 6 us each, and 1500 control steps of 0.2 ms and 19 or 20 times 0.05 ms.
    lab = load("lab")
    assert flight_effort(lab) == pytest.approx(30 * 0.036 + 1500 * (0.2e-3 + lab.controller.steps * 0.05e-3))
    base = flight_effort(lab)
    for harder in ("duration=60", "controller.period=0.01", "plant.step=0.0001", "controller.horizon=60"):
        assert flight_effort(load("lab", [harder])) > 1.3 * base
    assert control_effort(lab, 2000) == 2 * control_effort(lab, 1000)


def test_long_work_is_refused_unless_it_is_agreed_to() -> None:
    require_agreement(600.0, "this", is_agreed=False)
    require_agreement(1e6, "this", is_agreed=True)
    with pytest.raises(HeliTwinError, match=r"^this takes about 11 minutes on this machine: say --yes to do it$"):
        require_agreement(660.0, "this", is_agreed=False)
    with pytest.raises(HeliTwinError, match="about 10 hours"):
        require_agreement(36_000.0, "this", is_agreed=False)


def test_the_commands_ask_before_hours_of_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = str(fly(load("lab", ["duration=0.2"]), log_dir=tmp_path).path)
    hours = ["duration=36000", "trajectory=hover", "plant.step=1e-5", "controller.period=0.001"]
    assert main(["refly", path, *hours]) == 2
    assert "takes about" in capsys.readouterr().err
    monkeypatch.setattr(effort, "ASK_ABOVE_S", 0.0)
    for command in ("refly", "resolve", "reestimate"):
        assert main([command, path]) == 2
        assert "say --yes" in capsys.readouterr().err
        assert main([command, path, "--yes"]) == 0
