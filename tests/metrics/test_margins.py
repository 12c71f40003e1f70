"""Margins of a loop: python-control judges the arithmetic, a synthetic flight with a known sensitivity the reading."""

from types import SimpleNamespace

import control
import numpy as np
import pytest

from controllers.excitations.multisine import Multisine
from heli_twin.errors import HeliTwinError
from heli_twin.metrics.margins import AXES, LoopResponse, loop_responses, margins

PROBE = Multisine(record=2.0, slowest=0.5, fastest=8.0)
PERIOD = 0.02


@pytest.mark.parametrize(
    ("numerator", "denominator", "pade"),
    [
        ([2.0], [1, 3, 2, 0], 0),
        ([4.2], [1, 3, 2, 0], 0),
        ([4.0, 4.0], [1, 2, 0, 0], 0),
        ([2.0, 1.0], [1, 0.5, 0], 0.08),
    ],
)
def test_python_control_finds_the_same_margins(numerator, denominator, pade):
    loop = control.tf(numerator, denominator)
    if pade:
        loop *= control.tf(*control.pade(pade, 6))
    w = np.geomspace(0.1, 200.0, 4000)
    ours = margins(LoopResponse(w, loop(1j * w)))
    gain, phase, stability, _, crossover, _ = control.stability_margins(loop)
    assert ours.gain == pytest.approx(gain, rel=2e-3)
    assert ours.crossover == pytest.approx(crossover, rel=2e-3)
    assert ours.delay == pytest.approx(np.radians(phase) / crossover, rel=5e-3)
    assert ours.peak_sensitivity == pytest.approx(1.0 / stability, rel=5e-3)


def test_of_several_crossings_the_least_delay_and_the_highest_frequency_count():
    # |L| = 1 halfway between two points on a logarithmic scale, each time 30 degrees before the half circle.
    size, at = np.array([2.0, 0.5, 2.0, 0.5]), np.array([1.0, 2.0, 4.0, 8.0])
    ours = margins(LoopResponse(at, size * np.exp(-1j * np.radians(150.0))))
    assert ours.crossover == pytest.approx(4.0 * np.sqrt(2.0), rel=1e-6)
    assert ours.delay == pytest.approx(np.radians(30.0) / (4.0 * np.sqrt(2.0)), rel=1e-6)
    assert ours.gain == np.inf


def test_a_loop_that_has_turned_by_more_than_half_a_circle_has_the_rest_of_the_circle():
    at, phase = np.array([1.0, 2.0, 4.0, 8.0]), np.radians([-150.0, -180.0, -210.0, -210.0])
    ours = margins(LoopResponse(at, np.array([2.0, 2.0, 2.0, 0.5]) * np.exp(1j * phase)))
    assert ours.delay == pytest.approx(np.radians(330.0) / (4.0 * np.sqrt(2.0)), rel=1e-6)


@pytest.mark.parametrize("order", [1, -1])
def test_the_peak_sensitivity_may_be_at_the_first_or_the_last_frequency(order):
    ours = margins(LoopResponse(np.array([1.0, 2.0, 4.0]), np.array([-0.75, -0.5, -0.2], complex)[::order]))
    assert ours.peak_sensitivity == pytest.approx(4.0, rel=1e-12)


def test_a_loop_that_never_gets_unstable_has_infinite_margins():
    w = np.geomspace(0.1, 10.0, 50)
    ours = margins(LoopResponse(w, 0.3 / (1.0 + 1j * w)))
    assert (ours.gain, ours.delay, ours.crossover) == (np.inf, np.inf, 0.0)
    assert ours.peak_sensitivity == pytest.approx(1.0, abs=0.02)


def test_a_loop_that_ends_before_it_turns_by_half_a_circle_has_no_gain_margin():
    """It crosses the real axis once, where its real part is positive."""
    w = np.geomspace(0.1, 10.0, 200)
    loop = 0.5 * (1.0 + 0.4j * np.log(w))
    assert margins(LoopResponse(w, loop)).gain == np.inf


def flown(duration: float, sensitivity: float = 0.5, lag: float = 0.3) -> SimpleNamespace:
    """A log whose commands answer the probe with S = sensitivity e^(-j lag) from the last whole record on."""
    t = np.arange(round(duration / PERIOD) + 1) * PERIOD
    u = np.random.default_rng(0).uniform(-1.0, 1.0, (len(t), 4))
    whole = int((duration - 5.0) / PROBE.record + 1e-9) * PROBE.record
    steady = t > duration - whole + 1e-9
    for i, w in enumerate(PROBE.frequencies):
        at = np.exp(-1j * np.multiply.outer(w, t[steady]))
        probe = PROBE.inputs(t[steady])[:, i]
        lines = at @ probe / max(len(probe), 1)
        wanted = 2.0 * (sensitivity * np.exp(-1j * lag) * lines @ np.conj(at)).real
        u[steady, i] = wanted - probe
    return SimpleNamespace(sent=SimpleNamespace(time=np.round(1e9 * t).astype(np.int64), u=u))


@pytest.mark.parametrize("duration", [7.0, 8.5, 9.0])
def test_the_last_whole_records_tell_the_loop(duration):
    for axis, response in loop_responses(flown(duration), PROBE).items():
        assert response.loop == pytest.approx(np.exp(0.3j) / 0.5 - 1.0, abs=1e-6), axis
        assert response.frequency.tolist() == PROBE.frequencies[AXES.index(axis)].tolist()


@pytest.mark.parametrize(("duration", "told"), [(6.9, "6.9 s"), (None, "0.0 s")])
def test_a_flight_shorter_than_a_record_after_it_has_settled_has_no_margins(duration, told):
    empty = SimpleNamespace(sent=SimpleNamespace(time=np.empty(0, np.int64), u=np.empty((0, 4))))
    with pytest.raises(HeliTwinError, match=f"the flight lasts {told}: margins need 7 s, 5 s to settle"):
        loop_responses(flown(duration) if duration else empty, PROBE)
