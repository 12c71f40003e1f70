"""A multisine excites every input at frequencies of its own, within the limits of the inputs."""

from dataclasses import replace

import numpy as np
import pytest

from controllers.excitations.multisine import Multisine
from controllers.model import Model
from controllers.signals import Command
from heli_twin.experiment.text import load
from heli_twin.experiment.tree import ExperimentError
from heli_twin.mission import fly
from heli_twin.reanalysis.resolve import INPUT_TOLERANCE, resolve

RECORD = Multisine().inputs(np.arange(0.0, 10.0, 0.02))


def test_each_input_has_its_own_lines_between_the_limits():
    power = np.abs(np.fft.rfft(RECORD, axis=0)) / len(RECORD)
    hertz = np.fft.rfftfreq(len(RECORD), 0.02)
    # The FFT of an exact period is zero off the lines, up to rounding.
    lines = power > 1e-9
    assert (lines.sum(axis=1) <= 1).all()
    assert lines.any(axis=1).tolist() == ((hertz > 0.29) & (hertz < 8.01)).tolist()


def test_the_levels_are_root_mean_squares_and_peaks_are_low():
    assert RECORD.std(axis=0) == pytest.approx(Multisine().rms, rel=1e-9)
    # A single sine has a crest factor of 1.4; random phases of 20 lines have about 3.
    assert (np.abs(RECORD).max(axis=0) / Multisine().rms < 2.3).all()


def test_the_sum_keeps_the_limits_of_the_inputs():
    model = Model(u_yaw_max=0.05)
    u = np.array([Multisine().excited(k * 20_000_000, Command(0, np.zeros(4)), model).u for k in range(500)])
    assert np.abs(u[:, 3]).max() == 0.05
    assert u[:, :2] == pytest.approx(RECORD[:, :2], abs=1e-12)


def test_limits_without_a_line_for_each_input_are_refused():
    with pytest.raises(ExperimentError, match=r"excitation\.slowest = 3 Hz to fastest = 3.1 Hz holds 2 lines"):
        load("calibrate_plane", ["excitation.slowest=3", "excitation.fastest=3.1"])


def test_the_excitation_is_in_the_sent_command_and_a_control_problem_solved_again_has_it_too():
    flight = load("calibrate_plane", ["duration=3"])
    log = fly(flight, log_dir=None).log
    assert np.abs(resolve(log).difference).max() <= INPUT_TOLERANCE
    quiet = replace(flight, excitation=load("lab").excitation)
    assert np.abs(log.sent.u - fly(quiet, log_dir=None).log.sent.u).max() > 0.1


def test_the_lines_have_schroeders_phases():
    """Two lines an input: the first begins at a phase of 0, the second at -pi (2) / 2."""
    probe = Multisine(record=1.0, slowest=1.0, fastest=8.0)
    t = np.array([0.0, 0.013, 0.2])
    for i, rms in enumerate(probe.rms):
        first, second = (rms * np.sin(2.0 * np.pi * (i + 1 + 4 * n) * t - np.pi * n) for n in (0, 1))
        # The lines are those of 1 to 8 Hz, the next one on the next input; the first line is on the first input.
        lines = sorted(w / (2.0 * np.pi) for w in probe.frequencies[i])
        assert lines == pytest.approx([i + 1, i + 5])
        assert probe.inputs(t)[:, i] == pytest.approx(first + second, abs=1e-12)
