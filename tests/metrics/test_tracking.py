import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from controllers.signals import QpReport, Reference
from heli_twin.lab.plant import Truth
from heli_twin.metrics.tracking import SETTLING_S, metrics, tracking_error
from heli_twin.recording import Recorder, read_log

MS = 1_000_000
PERIOD = 20 * MS
SOLVED = QpReport("solved", 3, 0, 1.0, 0.0)


def log_of(error, planned=None, *, outcome="completed", reports=(), took=(), path=None):
    """A log whose truth is off its reference by `error` (n, 4), one row a control period."""
    error = np.asarray(error, float)
    planned = np.zeros((len(error), 4)) if planned is None else planned
    recorder = Recorder(path, experiment="{}")
    for k, (off, at) in enumerate(zip(error, planned, strict=True)):
        t = k * PERIOD
        x, y, z, yaw = at + off
        level = np.array([1.0, 0, 0, 0])
        truth = Truth(t, np.array([x, y, z]), level, np.zeros(3), np.zeros(3), yaw, 0.0, np.zeros(4), False)
        reference = Reference(t, np.array([[*at, 0, 0, 0, 0]] * 2), np.zeros((1, 4)))
        recorder.reference(t, reference)
        recorder.truth(t, truth)
    for k, report in enumerate(reports):
        recorder.qp(k * PERIOD, report)
    for k, (step, solve) in enumerate(took):
        recorder.timing(k * PERIOD, step, solve)
    recorder.close(outcome, max(len(error) - 1, 0) * PERIOD)
    return read_log(path or recorder.stream)


@given(st.lists(st.lists(st.floats(-3, 3), min_size=4, max_size=4), min_size=1, max_size=20))
def test_the_errors_are_the_truth_minus_the_reference(rows):
    error = np.array(rows)
    planned = np.random.default_rng(0).uniform(-5, 5, error.shape)
    settled = round(SETTLING_S * 1e9) // PERIOD
    before = np.full((settled, 4), 1e3)
    found = metrics(log_of(np.vstack([before, error]), np.vstack([np.zeros((settled, 4)), planned])))
    for i, axis in enumerate(("x", "y", "z", "yaw")):
        # A sum and a difference of numbers of up to 8.
        assert found["max_abs_error"][axis] == pytest.approx(np.abs(error[:, i]).max(), abs=1e-14)
        assert found["rmse"][axis] == pytest.approx(np.sqrt((error[:, i] ** 2).mean()), abs=1e-14)
        assert found["mse"][axis] == pytest.approx((error[:, i] ** 2).mean(), abs=1e-13)


def test_the_first_seconds_do_not_count_and_it_is_said_so():
    samples = round(2 * SETTLING_S * 1e9) // PERIOD
    error = np.zeros((samples, 4))
    error[round(SETTLING_S * 1e9) // PERIOD - 1] = 1.0
    found = metrics(log_of(error))
    assert found["settling"] == SETTLING_S == 2.0
    assert found["max_abs_error"] == dict.fromkeys(("x", "y", "z", "yaw"), 0.0)
    error[round(SETTLING_S * 1e9) // PERIOD] = 1.0
    assert metrics(log_of(error))["max_abs_error"] == dict.fromkeys(("x", "y", "z", "yaw"), 1.0)


@given(st.floats(-3.1, 3.1), st.integers(-20, 20))
def test_whole_turns_are_no_error(off, turns):
    found = tracking_error(log_of([[0, 0, 0, off + 2 * np.pi * turns]], np.array([[0, 0, 0, 31.0]])))
    # A heading of up to 160 rad, rounded a few times.
    assert found.error[0, 3] == pytest.approx(off, abs=1e-13)


def test_only_times_that_have_both_are_compared():
    recorder = Recorder(None, experiment="{}")
    level = np.array([1.0, 0, 0, 0])
    for k in range(5):
        truth = Truth(k * MS, np.full(3, float(k)), level, np.zeros(3), np.zeros(3), 0.0, 0.0, np.zeros(4), False)
        recorder.truth(k * MS, truth)
    for k in (1, 3):
        recorder.reference(k * MS, Reference(k * MS, np.zeros((2, 8)), np.zeros((1, 4))))
    recorder.close("completed", 5 * MS)
    found = tracking_error(read_log(recorder.stream))
    # A stamp in ns as s: rounding.
    np.testing.assert_allclose(found.time, [0.001, 0.003], rtol=1e-15)
    np.testing.assert_array_equal(found.error[:, 0], [1.0, 3.0])


def test_a_flight_that_was_over_before_has_no_errors_and_is_still_json():
    found = metrics(log_of(np.zeros((5, 4)), outcome="crashed"))
    assert found["outcome"] == "crashed"
    assert found["duration"] == pytest.approx(0.08, abs=1e-15)
    for key in ("max_abs_error", "rmse", "mse"):
        assert found[key] == dict.fromkeys(("x", "y", "z", "yaw"))
    for key in ("control_step_ms", "solve_ms"):
        assert found[key] == {"p50": None, "p99": None, "max": None}
    assert found["qp_status"] == {}
    json.dumps(found, allow_nan=False)


def test_control_problems_are_counted_by_how_they_were_solved():
    reports = [SOLVED] * 3 + [SOLVED._replace(status="softened")] * 2 + [SOLVED._replace(status="safe_hover")]
    found = metrics(log_of(np.zeros((6, 4)), reports=reports))
    assert found["qp_status"] == {"safe_hover": 1, "softened": 2, "solved": 3}


def test_measured_times_are_in_milliseconds():
    took = [(k * MS, k * MS // 2) for k in range(1, 102)]
    found = metrics(log_of(np.zeros((101, 4)), took=took))
    # 1 to 101 ms: the median is the 51st, the 99th percentile lies one from the last.
    assert found["control_step_ms"] == pytest.approx({"p50": 51.0, "p99": 100.0, "max": 101.0}, rel=1e-12)
    assert found["solve_ms"] == pytest.approx({"p50": 25.5, "p99": 50.0, "max": 50.5}, rel=1e-12)


@given(st.lists(st.integers(0, 10**12), min_size=1, max_size=20))
def test_percentiles_are_in_order_and_end_at_the_largest(values):
    found = metrics(log_of(np.zeros((1, 4)), took=[(v, 0) for v in values]))["control_step_ms"]
    # Interpolation between two values may round past the greater.
    assert min(values) * 1e-6 <= found["p50"] * (1 + 1e-15) <= found["p99"] * (1 + 2e-15) <= found["max"] * (1 + 3e-15)
    assert found["max"] == pytest.approx(max(values) * 1e-6, rel=1e-15)


def test_from_a_file_the_numbers_are_the_same(tmp_path):
    error = np.random.default_rng(0).normal(size=(150, 4))
    assert metrics(log_of(error, path=tmp_path / "flight.mcap")) == metrics(log_of(error))
