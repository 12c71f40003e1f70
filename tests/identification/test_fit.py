"""The numbers of the identification have known values: thresholds, intervals, shares."""

from types import SimpleNamespace

import numpy as np
import pytest

from controllers.signals import Command, Pose
from heli_twin.experiment import Experiment
from heli_twin.identification.data import ROW_S, Equation, Stretch, _Sent, stretches
from heli_twin.identification.fit import (
    MEMORY_S,
    AxisFit,
    IdentificationError,
    Parameter,
    _delay_and_lag,
    _directions,
    _slopes,
    check_answer,
    excited,
    fit_axis,
    half_widths,
)
from heli_twin.identification.flights import experiments
from heli_twin.identification.identify import Identified
from heli_twin.recording import Recorder

ACCEL = (np.array([1.0, -1.0]),)


def fit(b=(1.0, 0.1), k=(-1.0, 0.1), accel=ACCEL, residual=ACCEL):
    """A fit whose parameters are a value and a half-width."""
    b, k = (Parameter(value, value - width, value + width) for value, width in (b, k))
    return AxisFit(b, k, Parameter(0.1, 0.09, 0.11), 0.0, (), accel, residual)


@pytest.mark.parametrize(("swing", "directions"), [(0.0, 1), (0.09, 1), (0.11, 2), (0.8, 2)])
def test_a_push_has_two_directions_where_the_yaw_swings_by_a_tenth(swing, directions):
    # Yaw +- swing: the singular values are as 1 to its tangent, and the limit is 0.1.
    yaw = swing * (-1.0) ** np.arange(100)
    assert _directions(np.column_stack([np.cos(yaw), np.sin(yaw)])).shape == (100, directions)


def test_directions_span_the_push_and_keep_its_size():
    yaw = np.linspace(0.0, 3.0, 50)
    push = np.column_stack([np.cos(yaw), np.sin(yaw)])
    found = _directions(push)
    # A basis of the same plane, each vector as long as the largest singular value.
    np.testing.assert_allclose(found @ np.linalg.lstsq(found, push, rcond=None)[0], push, atol=1e-12)
    largest = np.linalg.svd(push, compute_uv=False)[0]
    np.testing.assert_allclose(np.linalg.norm(found, axis=0), largest)


def test_a_half_width_is_newey_and_wests():
    n, lags = 3000, round(MEMORY_S / ROW_S)
    assert lags == 30
    # With residuals and regressor of 1 each product is 1, so that the sums are counts of pairs.
    variance = n + 2.0 * sum((1 - lag / 31) * (n - lag) for lag in range(1, 31))
    share = 0.01
    critical = 1.96 + 2.9694 * share + 0.416 * share**2 - 0.5324 * share**3
    expected = critical * np.sqrt(variance) / n * np.sqrt(n / (n - 1))
    assert half_widths(np.ones((n, 1)), np.ones(n), np.array([n]))[0] == pytest.approx(expected, rel=1e-12)
    # 31 rows count as one, but for those at the ends.
    assert expected == pytest.approx(1.9897 * np.sqrt(31 / n), rel=0.005)


def test_stretches_shorter_than_the_memory_have_all_their_products():
    """Of 20 and 31 rows; those of one are independent of those of the other."""
    variance = sum(n + 2.0 * sum((1 - lag / 31) * (n - lag) for lag in range(1, n)) for n in (20, 31))
    share = 30 / 51
    critical = 1.96 + 2.9694 * share + 0.416 * share**2 - 0.5324 * share**3
    expected = critical * np.sqrt(variance) / 51 * np.sqrt(51 / 50)
    assert half_widths(np.ones((51, 1)), np.ones(51), np.array([20, 51]))[0] == pytest.approx(expected, rel=1e-12)


def test_independent_residuals_have_the_textbook_interval():
    rng = np.random.default_rng(0)
    residual = rng.standard_normal(200_000)
    width = half_widths(np.ones((len(residual), 1)), residual, np.array([len(residual)]))[0]
    # 1.96 deviations of a mean; the sums over 30 lags scatter by some percent.
    assert width == pytest.approx(1.96 / np.sqrt(len(residual)), rel=0.1)


def test_explained_share_and_rms_of_residuals():
    accel = (np.array([3.0, 1.0]), np.array([1.0, 3.0, 1.0]))
    residual = (np.array([0.5, -0.5]), np.array([-0.5, 0.5, 0.5]))
    found = fit(accel=accel, residual=residual)
    # Within the stretches: 1 + 1 and 8/9 + 2 * 4/9 * ... = 2 + 8/3; five squares of 0.5.
    assert found.explained == pytest.approx(1 - 1.25 / (2 + 8 / 3))
    assert found.residual_rms == 0.5


@pytest.mark.parametrize(
    ("b", "k", "name"),
    [
        ((1.0, 0.19), (-1.0, 0.19), ""),
        ((1.0, 0.21), (-1.0, 0.1), "b_x"),
        ((1.0, 0.1), (-1.0, 0.21), "k_x"),
        # A damping near 0 is judged by a fifth of 0.5 1/s.
        ((1.0, 0.1), (-0.1, 0.09), ""),
        ((1.0, 0.1), (0.1, 0.11), "k_x"),
        ((-1.0, 0.1), (-1.0, 0.1), "x accelerates against"),
    ],
)
def test_an_uncertain_answer_is_refused_from_a_fifth_of_its_value(b, k, name):
    if not name:
        check_answer("x", fit(b, k))
        return
    with pytest.raises(IdentificationError, match=name):
        check_answer("x", fit(b, k))


def piece(size, own=1.0):
    """A stretch whose input has this standard deviation, of which the speed leaves a share of the variance."""
    t = 2 * np.pi * np.arange(400) / 400
    speed, rest = np.sqrt(2) * np.sin(t), np.sqrt(2) * np.sin(2 * t)
    u = size * (np.sqrt(1 - own) * speed + np.sqrt(own) * rest)
    return Stretch("flight", t, {"x": Equation(u, lambda delay, lag: u, speed, np.ones((400, 1)))})


def test_what_excites_an_axis_is_enough_input_that_the_speed_does_not_explain():
    good = piece(0.101, own=0.021)
    assert excited("x", [piece(0.099), good, piece(0.2, own=0.019)]) == [good]
    with pytest.raises(IdentificationError, match=r"pitch input varies by 0\.099 of full stick, 0\.1 is needed"):
        excited("x", [piece(0.05), piece(0.099)])
    with pytest.raises(IdentificationError, match=r"its speed explains 98\.1 % of its pitch input, at most 98 %"):
        excited("x", [piece(0.2, own=0.019)])


@pytest.mark.parametrize(("axis", "least"), [("x", 0.1), ("y", 0.1), ("z", 0.015), ("yaw", 0.02)])
def test_each_axis_needs_its_own_excitation(axis, least):
    """Of what acts a tenth of a second later, without its mean."""
    t = 2 * np.pi * np.arange(400) / 400

    def stretch(size):
        def acting(delay, lag):
            return 0.5 + size * np.sqrt(2) * np.sin(t) * ((delay, lag) == (0.1, 0.0))

        return Stretch("flight", t, {axis: Equation(t, acting, None, np.ones((400, 1)))})

    enough = stretch(1.01 * least)
    assert excited(axis, [stretch(0.99 * least), enough]) == [enough]


@pytest.mark.parametrize("lag", [0.0, 0.004, 0.05])
def test_slopes_are_derivatives_by_delay_and_lag(lag):
    """Exact for what changes evenly."""
    t = np.linspace(0.0, 1.0, 5)
    equation = Equation(t, lambda delay, lag: 3.0 * delay * t - 5.0 * lag + 2.0 * t, None, np.ones((5, 1)))
    found = _slopes([equation], 0.2, lag, 7.0)
    np.testing.assert_allclose(found, np.column_stack([21.0 * t, np.full(5, -35.0)]), atol=1e-9)


def test_a_saved_model_has_no_negative_damping():
    found = Identified({"x": fit(b=(2.0, 0.1), k=(0.04, 0.09))}, ("flight",), 10.0)
    assert found.as_toml().splitlines()[-2:] == ["b_x = 2  # 1.9 to 2.1", "k_x = 0  # -0.05 to 0.13"]
    assert found.as_json()["parameters"]["k_x"] == {"value": 0.04, "interval": pytest.approx([-0.05, 0.13])}


def sent(u, t):
    """Inputs, a new one every 20 ms, averaged over the 10 ms around each time but the first and last."""
    time = 20_000_000 * np.arange(len(u))
    columns = np.repeat(np.array(u, float)[:, None], 4, axis=1)
    return _Sent(SimpleNamespace(sent=SimpleNamespace(time=time, u=columns)), t)


def test_a_sent_input_is_held_until_the_next_and_the_last_one_for_a_period():
    t = 0.005 + 0.01 * np.arange(21)
    inputs = sent([3.0, 1.0, 4.0, 1.0, 5.0, 9.0, 2.0, 6.0, 5.0, 7.0], t)
    held = np.repeat([3.0, 1.0, 4.0, 1.0, 5.0, 9.0, 2.0, 6.0, 5.0, 7.0], 2)
    np.testing.assert_allclose(inputs(0, 0.0, 0.0), held[1:], atol=1e-12)
    np.testing.assert_allclose(inputs(3, 0.04, 0.0)[4:], held[1:-4], atol=1e-12)


def test_a_lagged_input_fades_from_one_value_to_the_next():
    t = 0.005 + 0.01 * np.arange(21)
    lag, ends = 0.03, 0.01 * np.arange(1, 20)
    # It begins at its first value; 1 from 40 ms on: the mean of 1 - exp(-t / lag) from each time to the next.
    rise = np.maximum(np.append(ends, 0.2) - 0.04, 0.0)
    means = np.diff(rise + lag * np.exp(-rise / lag)) / 0.01
    np.testing.assert_allclose(sent([0.0, 0.0] + [1.0] * 8, t)(1, lag, lag), means, atol=1e-12)


def still_log(poses):
    """A helicopter that stands in the air, seen every 10 ms from 1.005 s on."""
    recorder, at = Recorder(), np.array([0.0, 0.0, 1.0])
    for k in range(500):
        recorder.sent(20_000_000 * k, Command(20_000_000 * k, np.array([0.0, 0.0, 0.5, 0.0])))
    for k in range(poses):
        t = 1_005_000_000 + 10_000_000 * k
        recorder.pose(t, Pose(t, at, np.array([1.0, 0.0, 0.0, 0.0])))
    recorder.close("completed", 10**10)
    return recorder.log()


@pytest.mark.parametrize("poses", range(700, 710))
def test_a_stretch_reaches_from_its_first_pose_to_its_last(poses):
    (stretch,) = stretches(still_log(poses), "still")
    # The grid ends before the last pose, two samples go to the derivatives, 41 to the window; every tenth is kept.
    assert len(stretch.time) == (poses - 1 - 2 - 41) // 10 + 1
    # The middle of the first window.
    assert stretch.time[0] == pytest.approx(1.005 + 0.01 + 0.2, abs=1e-9)


def test_a_stretch_lasts_five_seconds():
    assert not list(stretches(still_log(500), "4.99 s"))
    assert list(stretches(still_log(502), "5.01 s"))


def test_the_default_flights_are_six_in_the_plane_and_two_in_height_and_yaw():
    flights = experiments(Experiment(seed=3))
    assert [(f.trajectory.axes, f.duration, f.seed) for f in flights] == [
        *(("plane", 60.0, 3 + i) for i in range(6)),
        *(("height_and_yaw", 40.0, 9 + i) for i in range(2)),
    ]


def lagged(u):
    """An `Equation.input` for a sum of sinusoids, amplitude by periods in 40 s, behind delay and lag."""
    t = 0.1 * np.arange(400)

    def acting(delay, lag):
        waves = [(a, 2 * np.pi * n / 40.0) for n, a in u.items()]
        parts = [a * np.sin(w * (t - delay + lag) - np.arctan(w * lag)) / np.hypot(1.0, w * lag) for a, w in waves]
        return np.sum(parts, axis=0)

    return acting


def found_lag(accel, acting):
    return _delay_and_lag([Equation(accel, acting, None, np.ones((400, 1)))], accel)


@pytest.mark.parametrize(("delay", "lag"), [(0.0, 0.0), (0.113, 0.02), (0.127, 0.06), (0.2, 0.2)])
def test_delay_and_lag_are_found_off_the_grid_of_the_search(delay, lag):
    acting = lagged({11: 1.0, 26: 0.6, 46: 0.4})
    # The last step is below 1e-6 s.
    assert found_lag(2.0 * acting(delay, lag), acting) == pytest.approx((delay, lag), abs=1e-5)


def test_the_longest_delay_is_four_tenths_of_a_second():
    acting = lagged({11: 1.0, 26: 0.6})
    assert found_lag(acting(0.45, 0.0), acting)[0] == 0.4


def test_what_acts_more_sharply_than_the_input_has_no_lag():
    """It has more of the high frequency: a lag would have to be negative, is held at 0, and the delay is found."""
    accel = lagged({11: 1.0, 46: 0.5})(0.113, 0.0)
    assert found_lag(accel, lagged({11: 1.0, 46: 0.4})) == pytest.approx((0.113, 0.0), abs=1e-5)


def test_a_delay_has_the_half_width_of_a_shifted_sine():
    t = 0.1 * np.arange(400)
    speed, noise = np.cos(1.3 * t), np.random.default_rng(0).normal(0.0, 0.05, 400)
    accel = 2.0 * np.sin(3.0 * (t - 0.1)) - 0.5 * speed + noise

    def shifted(delay, lag):
        return np.sin(3.0 * (t - delay))

    answer = fit_axis("x", [Stretch("flight", t, {"x": Equation(accel, shifted, speed, np.ones((400, 1)))})])
    width = 0.5 * (answer.delay.high - answer.delay.low)
    # 2 sin(3 t) changes by 6 / sqrt(2), rms, per second of delay: 0.05 over that and the root of 400, times the
    # critical value of 1.96 + 2.97 * 30 / 400. Thirty estimated correlations of white noise scatter by a third.
    assert width == pytest.approx(2.18 * 0.05 / (6.0 / np.sqrt(2.0) * 20.0), rel=0.5)
    assert answer.delay.value == pytest.approx(0.1, abs=2 * width)
    assert [len(residual) for residual in answer.residual] == [400]


def test_a_lag_that_is_held_at_zero_makes_the_delay_no_less_certain():
    """Its slope is 0.9 correlated with that of the delay: as an unknown, it would widen the interval 2.3 times."""
    t = 0.1 * np.arange(400)
    slope = -3.0 * np.cos(3.0 * (t - 0.1))
    lagging = 0.9 * slope + np.sqrt(1.0 - 0.81) * 3.0 * np.cos(5.0 * t)

    def acting(delay, lag):
        return np.sin(3.0 * (t - delay)) + lag * lagging

    noise = np.random.default_rng(0).normal(0.0, 0.05, 400)
    accel = 2.0 * (acting(0.1, 0.0) - 0.2 * 3.0 * np.cos(5.0 * t)) + noise
    answer = fit_axis("x", [Stretch("flight", t, {"x": Equation(accel, acting, None, np.ones((400, 1)))})])
    assert answer.lag == 0.0
    width = 0.5 * (answer.delay.high - answer.delay.low)
    left = answer.residual[0].std()
    assert width == pytest.approx(2.18 * left / (6.0 / np.sqrt(2.0) * 20.0), rel=0.6)
