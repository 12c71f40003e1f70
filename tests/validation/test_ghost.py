"""The ghost flies where the twin predicts, and nowhere else."""

import numpy as np
import pytest

from heli_twin.cli import main
from heli_twin.experiment.text import load
from heli_twin.mission import fly
from heli_twin.validation.forecast import BIN_S, HORIZON_BINS, Forecast
from heli_twin.validation.ghost import ghost_log
from heli_twin.viewing.show import flights


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return fly(load("ideal", ["duration=7"]), log_dir=tmp_path_factory.mktemp("flown")).path


def along(truth, begin):
    """A perfect prediction that begins at some times (w,), s."""
    middles = np.asarray(begin)[:, None] + BIN_S * (np.arange(HORIZON_BINS) + 0.5)
    tilt = np.zeros_like(middles)
    columns = [np.interp(middles, 1e-9 * truth.time, c) for c in (*truth.position.T, truth.yaw)]
    predicted = np.stack([*columns, tilt, tilt], axis=-1)
    # The last two bins of each were not seen.
    predicted[:, -2:] = np.nan
    return Forecast(np.asarray(begin), predicted, predicted, np.ones_like(predicted), predicted[:, 0])


def test_the_ghost_of_a_perfect_twin_is_the_helicopter(path):
    (log,) = flights([path]).logs
    # Of three that overlap, the second one is left out.
    ghost = ghost_log(log, along(log.truth, [1.0, 2.0, 3.0])).truth
    assert ghost.time[0] == 1_000_000_000
    assert 4.9e9 < ghost.time[-1] <= 5.0e9
    both = np.isin(log.truth.time, ghost.time)
    # A chord of 20 ms of a circle lies some micrometres inside it; before the first middle the path is held.
    assert np.abs(ghost.position - log.truth.position[both]).max() < 6e-3
    late = np.abs(ghost.position - log.truth.position[both])[ghost.time % 2_000_000_000 > 1_100_000_000]
    assert late.max() < 1e-4
    assert ghost.yaw == pytest.approx(log.truth.yaw[both], abs=0.012)


def test_a_ghost_is_shown_beside_one_flight(path, tmp_path, capsys, monkeypatch):
    made = flights([path, path])._replace(ghost="twin.toml")
    monkeypatch.setattr("heli_twin.validation.ghost.with_ghost", lambda shown, source: made)
    saved = tmp_path / "ghost.rrd"
    assert main(["replay", str(path), "--ghost", "twin.toml", "--save", str(saved)]) == 0
    assert saved.stat().st_size > 100_000
    monkeypatch.undo()
    assert main(["replay", str(path), str(path), "--ghost", "lab", "--save", str(saved)]) == 2
    assert "--ghost stands beside one flight: give one log" in capsys.readouterr().err
