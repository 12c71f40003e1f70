"""Commands in a file of their own join the poses of cameras that know none."""

import numpy as np
import pytest
from motive_take import commands_of, motive_take

from heli_twin.cli import main
from heli_twin.exchange.commands_file import read_commands
from heli_twin.exchange.formats import ImportRefused
from heli_twin.experiment.text import load
from heli_twin.mission import fly
from heli_twin.recording import read_log


@pytest.fixture(scope="module")
def flown():
    return fly(load("lab_simple", ["duration=3"]), log_dir=None).log


def test_a_motive_take_with_commands_is_the_flight(flown, tmp_path, capsys):
    take = motive_take(flown, tmp_path / "take.csv", gaps=[(1.0, 1.3)])
    sent = commands_of(flown, tmp_path / "sent.csv")
    assert main(["import", str(take), "--commands", str(sent)]) == 0
    assert "gaps, the longest 0.3" in capsys.readouterr().out
    log, start = read_log(tmp_path / "take.mcap"), flown.pose.stamp.min()
    # The command before the first frame still holds.
    assert log.sent.time[0] == 0
    assert np.abs(log.sent.time[1:] - (flown.sent.time[1:] - start)).max() <= 1
    np.testing.assert_array_equal(log.sent.u, flown.sent.u)
    _, ours, theirs = np.intersect1d(
        np.round(1e-3 * (flown.pose.stamp - start)), np.round(1e-3 * log.pose.stamp), return_indices=True
    )
    assert len(theirs) == len(log.pose.stamp) > 250
    # Six digits of a millimetre and of a quaternion.
    np.testing.assert_allclose(log.pose.position[theirs], flown.pose.position[ours], rtol=0, atol=1e-8)
    turned = np.abs((log.pose.quat_wxyz[theirs] * flown.pose.quat_wxyz[ours]).sum(axis=1))
    np.testing.assert_allclose(turned, 1.0, rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("t,ux\n0,0\n", "its first line is 't, ux': name the columns time"),
        ("time,ux\n0,0\n1,1.5\n", "line 3: ux = 1.5 is not a fraction of full stick"),
        ("time,ux\n0,\n", "ux = nan is not a fraction"),
        ("time,ux\n1,0\n0,0\n", "line 3: its time is before that of the line above"),
        ("time,ux\n,0\n", "time = nan is not a time in s"),
        ("time,ux\n0,zero\n", "'zero' is not a number"),
        ("time,ux\n", "no rows of numbers"),
        ("", "its first line is ''"),
    ],
)
def test_a_wrong_file_is_told_in_a_sentence(text, sentence, tmp_path):
    path = tmp_path / "sent.csv"
    path.write_text(text)
    with pytest.raises(ImportRefused) as error:
        read_commands(path)
    assert sentence in str(error.value)


def test_commands_of_another_clock_are_refused(flown, tmp_path, capsys):
    take = motive_take(flown, tmp_path / "take.csv")
    (tmp_path / "sent.csv").write_text("time,ux,uy,uz,uyaw\n1700000000,0,0,0.5,0\n1700000001,0,0,0.5,0\n")
    assert main(["import", str(take), "--commands", str(tmp_path / "sent.csv")]) == 2
    assert "both have to be on one clock" in capsys.readouterr().err
    assert not (tmp_path / "take.mcap").exists()
