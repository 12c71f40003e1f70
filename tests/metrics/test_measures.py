"""Every metric of a study has the value that a flight of known errors and inputs gives it."""

import numpy as np
import pytest

from controllers.laws.pid import Pid
from controllers.signals import Command, QpReport, Reference
from heli_twin.lab.plant import Truth
from heli_twin.metrics.measures import measures, sustained
from heli_twin.recording import Log, Recorder

PERIOD_NS = 20_000_000
SAMPLES = 201
"""Four seconds: the first hundred samples are left out, a hundred and one count."""
LEFT_OUT, COUNTED = 100, 101
LEVEL = (1.0, 0.0, 0.0, 0.0)
HOVER = (0.0, 0.0, 0.5, 0.0)


def counted(values: object) -> np.ndarray:
    """Errors (201, 4) of 9 m and rad where they are left out, then these."""
    return np.vstack([np.full((LEFT_OUT, 4), 9.0), np.broadcast_to(values, (COUNTED, 4))])


def log_of(
    error: object = (0.0,) * 4, planned: object = (0.0,) * 4, quat_wxyz: object = LEVEL, u: object = HOVER
) -> Log:
    """A log of truth, reference and inputs, one row a control step."""
    shape = (SAMPLES, 4)
    rows = (np.broadcast_to(values, shape) for values in (error, planned, quat_wxyz, u))
    recorder = Recorder()
    for k, (off, plan, q, sent) in enumerate(zip(*rows, strict=True)):
        t = k * PERIOD_NS
        at, zero = plan + off, np.zeros(3)
        recorder.truth(t, Truth(t, at[:3], q, zero, zero, float(at[3]), 0.0, np.zeros(4), False))
        recorder.reference(t, Reference(t, np.array([[*plan, 0, 0, 0, 0]]), np.zeros((1, 4))))
        recorder.sent(t, Command(t, sent))
    recorder.close("completed", (SAMPLES - 1) * PERIOD_NS)
    return recorder.log()


def test_a_constant_error_has_a_bias_and_no_spread():
    m = measures(log_of(counted((0.03, -0.04, 0.0, 0.2))))
    assert m["rmse.position"] == pytest.approx(0.05, rel=1e-12)
    assert m["mse.position"] == pytest.approx(0.0025, rel=1e-12)
    assert m["max_abs_error.position"] == pytest.approx(0.05, rel=1e-12)
    for name, value in {"x": 0.03, "y": 0.04, "z": 0.0, "yaw": 0.2, "position": 0.05}.items():
        assert m[f"p95.{name}"] == pytest.approx(value, abs=1e-12)
        # Differences of cumulated sums of 81.
        assert m[f"sustained.{name}"] == pytest.approx(value, abs=1e-9)
    assert [m[f"bias.{axis}"] for axis in ("x", "y", "z", "yaw")] == pytest.approx([0.03, -0.04, 0.0, 0.2], abs=1e-12)
    assert [m[f"spread.{axis}"] for axis in ("x", "y", "z", "yaw")] == pytest.approx([0.0] * 4, abs=1e-12)


def test_an_error_that_grows_evenly_has_the_percentiles_of_a_ramp():
    ramp = np.linspace(0.0, 1.0, COUNTED)
    m = measures(log_of(counted(np.column_stack([ramp, 0 * ramp, 0 * ramp, -ramp]))))
    assert (m["p95.x"], m["p95.yaw"]) == pytest.approx((0.95, 0.95), rel=1e-12)
    assert (m["bias.x"], m["bias.yaw"]) == pytest.approx((0.5, -0.5), rel=1e-12)
    assert m["max_abs_error.position"] == pytest.approx(1.0, rel=1e-12)
    # Of n numbers that are evenly apart the variance is (n^2 - 1) / 12.
    assert m["spread.x"] == pytest.approx(0.01 * np.sqrt((COUNTED**2 - 1) / 12), rel=1e-12)
    # A second is fifty samples: the worst are the last.
    assert m["sustained.x"] == pytest.approx(np.sqrt((ramp[-50:] ** 2).mean()), rel=1e-9)


def test_sustained_is_the_worst_window():
    lengths = np.array([[0.0, 1.0], [3.0, 1.0], [4.0, 1.0], [0.0, 1.0]])
    np.testing.assert_allclose(sustained(lengths, 2), [np.sqrt(12.5), 1.0], rtol=1e-12)
    np.testing.assert_allclose(sustained(lengths, 4), [2.5, 1.0], rtol=1e-12)
    np.testing.assert_allclose(sustained(lengths, 0), [4.0, 1.0], rtol=1e-12)
    assert sustained(lengths, 5) is None


def test_the_window_follows_the_control_period():
    error = np.zeros((COUNTED, 4))
    error[:25, 0] = 1.0
    log = log_of(counted(error))
    assert measures(log, Pid(period=0.04))["sustained.x"] == pytest.approx(1.0, abs=1e-9)
    assert measures(log, Pid(period=0.02))["sustained.x"] == pytest.approx(np.sqrt(0.5), abs=1e-9)


@pytest.mark.parametrize("degrees", [1.0, 30.0, 90.0, 135.0, 180.0])
@pytest.mark.parametrize("axis", [0.0, 30.0, 90.0, 200.0])
def test_tilt_is_the_angle_between_mast_and_vertical(degrees: float, axis: float):
    half, axis, yaw = np.radians(degrees) / 2, np.radians(axis), np.radians(70.0)
    lean = np.array([np.cos(half), np.sin(half) * np.cos(axis), np.sin(half) * np.sin(axis), 0.0])
    c, s = np.cos(yaw / 2), np.sin(yaw / 2)
    w, x, y, _ = lean
    turned = np.array([c * w, c * x - s * y, c * y + s * x, s * w])
    quat = np.tile(LEVEL, (SAMPLES, 1))
    quat[3] = turned
    # The arc sine magnifies rounding at 180 deg, by the root of it.
    assert measures(log_of(quat_wxyz=quat))["tilt.max"] == pytest.approx(np.radians(degrees), abs=1e-7)


def test_a_quaternion_a_last_digit_too_long_has_a_tilt():
    quat = np.tile([0.0, np.nextafter(1.0, 2.0), 0.0, 0.0], (SAMPLES, 1))
    assert measures(log_of(quat_wxyz=quat))["tilt.max"] == pytest.approx(np.pi, abs=1e-12)


def test_effort_and_variation_of_an_input_that_alternates():
    u = np.tile(HOVER, (SAMPLES, 1))
    u[:, 0] = 0.1 + 0.2 * (np.arange(SAMPLES) % 2)
    u[:, 3] = np.linspace(0.0, 0.4, SAMPLES)
    u[:LEFT_OUT, :3] = np.random.default_rng(0).uniform(-1, 1, (LEFT_OUT, 3))
    m = measures(log_of(u=u))
    # 51 times 0.1 and 50 times 0.3; a ramp of 101 steps of 0.002.
    square = 0.04 * (51 / 101) * (50 / 101)
    assert m["effort"] == pytest.approx(square + 0.002**2 * (COUNTED**2 - 1) / 12, rel=1e-9)
    assert [m[f"variation.{a}"] for a in ("x", "y", "z", "yaw")] == pytest.approx([10.0, 0.0, 0.0, 0.1], abs=1e-9)


def test_saturated_is_the_share_of_time_at_the_limits():
    law = Pid()
    low, high = np.array(law.model.u_min), np.array(law.model.u_max)
    u = np.tile(HOVER, (SAMPLES, 1))
    assert measures(log_of(u=u), law)["saturated"] == 0.0
    u[:LEFT_OUT] = high
    assert measures(log_of(u=u), law)["saturated"] == 0.0
    u[LEFT_OUT : LEFT_OUT + 10, 3] = low[3]
    u[-15:, 3] = high[3]
    u[LEFT_OUT + 50, 0] = high[0]
    # The input that is at a limit longest counts.
    assert measures(log_of(u=u), law)["saturated"] == pytest.approx(25 / COUNTED, rel=1e-12)
    assert measures(log_of(u=0.999 * high), law)["saturated"] == 0.0
    assert measures(log_of(u=high), law)["saturated"] == 1.0
    assert measures(log_of(u=high))["saturated"] is None


def test_an_input_a_millionth_inside_its_limit_is_at_it():
    law = Pid()
    low, high = np.array(law.model.u_min), np.array(law.model.u_max)
    assert measures(log_of(u=low + 1e-6), law)["saturated"] == 1.0
    assert measures(log_of(u=high - 1e-6), law)["saturated"] == 1.0
    assert measures(log_of(u=high - 1.01e-6), law)["saturated"] == 0.0
    assert measures(log_of(u=low + 1.01e-6), law)["saturated"] == 0.0


def test_control_problems_and_late_steps_are_counted():
    recorder = Recorder()
    for k, status in enumerate(("solved", "softened", "solved", "safe_hover")):
        recorder.qp(k * PERIOD_NS, QpReport(status, 2 * k, 0, 0.0, 0.0))
    for k, took in enumerate((20_000_000, 20_000_001, 30_000_000, 1)):
        recorder.timing(k * PERIOD_NS, took, 0)
    recorder.close("completed", PERIOD_NS)
    m = measures(recorder.log(), Pid(period=0.02))
    assert (m["qp.iterations"], m["qp.unsolved"], m["deadline_misses"]) == (3.0, 2, 2)
    assert measures(recorder.log())["deadline_misses"] is None


def test_the_answer_to_a_step_is_that_of_the_reference_and_the_truth():
    planned, error = np.zeros((SAMPLES, 4)), np.zeros((SAMPLES, 4))
    planned[60:, 2] = 1.0
    error[60:90, 2] = -1.0
    error[100:110, 2] = 0.25
    m = measures(log_of(error, planned))
    assert (m["overshoot.z"], m["overshoot.x"]) == (0.25, None)
    # The last sample outside 0.1 m is at 2.18 s.
    assert m["settling_time"] == pytest.approx(2.2, rel=1e-12)


def test_the_phase_lag_leaves_out_the_start():
    t = 0.02 * np.arange(SAMPLES)
    planned, error = np.zeros((SAMPLES, 4)), np.zeros((SAMPLES, 4))
    planned[:, 1] = np.sin(2.0 * t)
    error[:, 1] = np.sin(2.0 * (t - 0.1)) - planned[:, 1]
    error[:LEFT_OUT, 1] = 5.0
    # A parabola through three samples of a sinusoid's misfit.
    assert measures(log_of(error, planned))["phase_lag.y"] == pytest.approx(0.1, abs=1e-3)


@pytest.mark.parametrize(("samples", "moves"), [(100, False), (101, False), (102, True), (126, True)])
def test_inputs_that_end_with_the_start_have_no_measures(samples, moves):
    recorder = Recorder()
    for k in range(samples):
        recorder.sent(k * PERIOD_NS, Command(k * PERIOD_NS, np.array(HOVER)))
    recorder.close("completed", samples * PERIOD_NS)
    assert measures(recorder.log())["effort"] == (0.0 if moves else None)


def test_a_flight_without_data_has_no_metrics():
    assert set(measures(Log({}), Pid()).values()) == {None}
