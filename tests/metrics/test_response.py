import numpy as np
import pytest

from heli_twin.metrics.response import MAX_LAG_S, SETTLED_BAND_M, _rests, overshoot, phase_lag, settling_time
from heli_twin.reporting.words import metric

PERIOD = 0.02
TIME = PERIOD * np.arange(1001)
W = 1.0
"""rad/s of the circle."""


def circle(t):
    return 0.5 * np.sin(W * t)


def lag(reference, flown, **options):
    return phase_lag(reference, flown, PERIOD, **options)


@pytest.mark.parametrize("late", [-0.37, 0.0, 0.013, 0.2, 0.95])
def test_a_path_flown_late_is_late_by_as_much(late):
    # A parabola through three samples of a sinusoid's misfit.
    assert lag(circle(TIME), circle(TIME - late)) == pytest.approx(late, abs=1e-4)
    assert lag(circle(TIME), circle(TIME - late), start=100) == pytest.approx(late, abs=1e-4)


def test_a_flight_of_three_times_the_longest_lag_is_long_enough():
    t = TIME[:150]
    assert lag(np.cos(3.0 * t), np.cos(3.0 * (t - 0.2))) == pytest.approx(0.2, abs=1e-3)
    assert lag(np.cos(3.0 * t[:-1]), np.cos(3.0 * (t[:-1] - 0.2))) is None


def test_a_steady_error_is_no_lag():
    assert lag(circle(TIME), circle(TIME - 0.2) + 3.0) == pytest.approx(0.2, abs=1e-4)


def test_a_path_of_a_few_centimetres_tells_its_lag_and_one_of_millimetres_does_not():
    # 0.5 s late costs 0.25 of the amplitude, rms, beyond `TELLING`: 0.035 or 0.0035 m.
    assert lag(0.2 * circle(TIME), 0.2 * circle(TIME - 0.2)) == pytest.approx(0.2, abs=1e-4)
    assert lag(0.02 * circle(TIME), 0.02 * circle(TIME - 0.2)) is None


def test_the_lag_of_a_first_order_system_is_its_phase():
    slow = 0.4
    phase = np.arctan(W * slow)
    flown = 0.5 * np.cos(phase) * np.sin(W * TIME - phase)
    # 18 s are 2.9 turns: what is missing of the last weighs with the lost amplitude, 8 %.
    assert lag(circle(TIME), flown) == pytest.approx(phase / W, abs=0.02)


def test_noise_moves_the_lag_little():
    flown = circle(TIME - 0.2) + np.random.default_rng(0).normal(0.0, 0.02, len(TIME))
    # 0.02 m over 0.35 m/s rms and 900 samples: 2 ms is one deviation.
    assert lag(circle(TIME), flown) == pytest.approx(0.2, abs=0.008)


@pytest.mark.parametrize(
    ("reference", "flown"),
    [
        (np.ones(1001), 1.0 + 0.002 * np.sin(7 * TIME)),
        (0.3 * TIME, 0.3 * (TIME - 0.2)),
        (0.1 * np.sin(2 * np.pi * TIME), 0.1 * np.sin(2 * np.pi * (TIME - 0.2))),
        (circle(TIME), circle(TIME - MAX_LAG_S - 0.3)),
        (circle(TIME[:140]), circle(TIME[:140] - 0.2)),
        (np.zeros(0), np.zeros(0)),
    ],
    ids=["stands", "even", "repeats", "later", "short", "nothing"],
)
def test_where_no_lag_can_be_told_there_is_none(reference, flown):
    assert lag(reference, flown) is None


def test_a_decaying_error_has_settled_when_it_is_within_the_band():
    slow = 1.7
    # At the next sample.
    assert settling_time(TIME, np.exp(-TIME / slow)) == pytest.approx(slow * np.log(1 / SETTLED_BAND_M), abs=PERIOD)


def test_only_what_stays_has_settled():
    assert SETTLED_BAND_M == 0.1
    distance = np.full(1001, SETTLED_BAND_M)
    assert settling_time(TIME, distance) == 0.0
    distance[500] = 2 * SETTLED_BAND_M
    assert settling_time(TIME, distance) == pytest.approx(TIME[501], abs=1e-12)
    distance[-1] = 2 * SETTLED_BAND_M
    assert settling_time(TIME, distance) is None
    distance[-1] = np.nan
    assert settling_time(TIME, distance) is None
    assert settling_time(TIME[:0], distance[:0]) is None


def second_order(t, damping, frequency=5.0):
    """The unit step response."""
    root = np.sqrt(1 - damping**2)
    swing = np.cos(frequency * root * t) + damping / root * np.sin(frequency * root * t)
    return np.where(t > 0, 1 - np.exp(-damping * frequency * t) * swing, 0.0)


@pytest.mark.parametrize("damping", [0.2, 0.5, 0.8])
@pytest.mark.parametrize("height", [0.3, -0.3])
def test_the_overshoot_of_a_second_order_system_is_the_textbooks(damping, height):
    reference, flown = 1.0 + height * (TIME > 2.0), 1.0 + height * second_order(TIME - 2.0, damping)
    expected = np.exp(-np.pi * damping / np.sqrt(1 - damping**2))
    # The peak lies between two samples.
    assert overshoot(reference, flown, PERIOD) == pytest.approx(expected, abs=0.003)


@pytest.mark.parametrize(("height", "is_step"), [(0.049, False), (0.051, True)])
def test_a_step_is_five_centimetres_high(height, is_step):
    assert (overshoot(height * (TIME > 2.0), height * (TIME > 2.0), PERIOD) is not None) == is_step


@pytest.mark.parametrize(("periods", "is_rest"), [(24, False), (25, True)])
def test_a_rest_lasts_half_a_second(periods, is_rest):
    reference = np.concatenate([np.arange(50.0), np.full(periods, 49.0), np.arange(50.0, 90.0)])
    assert bool(_rests(reference, PERIOD)) == is_rest


def test_what_comes_from_below_does_not_overshoot():
    assert overshoot(1.0 * (TIME > 2.0), np.where(TIME > 2.0, 1 - np.exp(2.0 - TIME), 0.0), PERIOD) == 0.0


def test_the_worst_step_counts_however_smooth():
    s = np.clip((TIME - 0.0) / 2.0, 0, 1), np.clip((TIME - 10.0) / 2.0, 0, 1)
    up, down = (10 * x**3 - 15 * x**4 + 6 * x**5 for x in s)
    reference = up - 0.5 * down
    flown = reference + 0.1 * ((TIME > 4) & (TIME < 5)) - 0.1 * ((TIME > 14) & (TIME < 15))
    assert overshoot(reference, flown, PERIOD) == pytest.approx(0.2, abs=1e-3)
    assert overshoot(reference[:600], flown[:600], PERIOD) == pytest.approx(0.1, abs=1e-3)


@pytest.mark.parametrize(("sample", "expected"), [(500, 0.3), (501, 0.0)])
def test_what_comes_after_the_rest_is_no_overshoot_of_it(sample, expected):
    reference = 1.0 * (TIME > 2.0) + np.interp(TIME, [10.0, 14.0], [0.0, 2.0])
    flown = reference.copy()
    flown[sample] += 0.3
    # The next move begins at sample 500.
    assert overshoot(reference, flown, PERIOD) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(
    "reference",
    [
        circle(TIME),
        np.ones(1001),
        0.02 * (TIME > 2.0),
        1.0 * (TIME > 19.8),
        np.interp(TIME, [2.0, 3.0, 4.0], [0.0, 1.0, 0.1]),
        np.zeros(0),
    ],
    ids=["circle", "hover", "small", "not arrived", "there and back", "nothing"],
)
def test_where_there_is_no_step_there_is_no_overshoot(reference):
    assert overshoot(reference, reference + 1.0, PERIOD) is None


def test_they_are_shown_in_units_that_a_person_reads():
    assert metric("phase_lag.x").label == "phase lag in x, ms"
    assert metric("overshoot.z").label == "overshoot in z, %"
    assert metric("settling_time").label == "settling time, s"
