"""The estimator run again on a log: the same estimates, their error and their consistency."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline
from scipy.stats import chi2

from controllers.signals import Array
from heli_twin import HeliTwinError, fly, load
from heli_twin.cli import main
from heli_twin.reanalysis.reestimate import CHI2_95, Consistency, _between, error, reestimate, same_bits
from heli_twin.recording import Log
from heli_twin.recording.records import Messages


@pytest.fixture(scope="module")
def log() -> Log:
    return fly(load("lab", ["duration=4"]), log_dir=None).log


def test_an_estimator_run_again_says_the_same_to_the_last_bit(log: Log) -> None:
    assert same_bits(reestimate(log).estimates, log.estimate)


def test_it_says_the_same_through_faults() -> None:
    flight = ["duration=2", "faults.pose_nan.start=0.5", "faults.pose_outage.start=1.0"]
    log = fly(load("lab", flight), log_dir=None).log
    assert log.estimate.rejected[-1] > 0
    assert same_bits(reestimate(log).estimates, log.estimate)


def test_the_quantiles_are_those_of_chi_squared() -> None:
    for freedom, bounds in CHI2_95.items():
        # They are written with five digits.
        np.testing.assert_allclose(bounds, chi2.ppf([0.025, 0.975], freedom), rtol=1e-4)


def test_the_truth_between_two_records_follows_a_cubic() -> None:
    rng = np.random.default_rng(0)
    knots = np.cumsum(rng.integers(1_000_000, 30_000_000, 20))
    p, v = rng.standard_normal((2, 20, 4))
    t = np.sort(rng.integers(knots[0], knots[-1], 50))
    spline = CubicHermiteSpline(1e-9 * knots, p, v)
    position, velocity = _between(knots, p, v, t)
    # Both sum the same few terms; velocities over 1 ms are some 1000 times larger.
    np.testing.assert_allclose(position, spline(1e-9 * t), rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(velocity, spline(1e-9 * t, 1), rtol=1e-6, atol=1e-5)


def test_a_perfect_estimate_has_no_error(log: Log) -> None:
    truth = log.truth
    c, s = np.cos(truth.yaw), np.sin(truth.yaw)
    vx, vy, vz = truth.velocity.T
    x = np.column_stack([truth.position, truth.yaw, c * vx + s * vy, c * vy - s * vx, vz, truth.yaw_rate])
    n = len(truth.stamp)
    perfect = log.estimate._replace(time=truth.time, stamp=truth.stamp, x=x)
    inside, errors = error(perfect, truth)
    assert len(inside) == n
    # Rounding of the turn into the yaw frame and back.
    assert np.abs(errors).max() < 1e-12


def test_the_error_is_the_filters_and_not_the_interpolations(log: Log) -> None:
    _, errors = error(log.estimate, log.truth)
    # The cameras are wrong by 0.5 mm, and a filter that works is not far from that.
    assert np.sqrt((errors[:, :3, 0] ** 2).mean()) < 0.003


def test_the_share_inside_the_bounds_is_095_for_chi_squared() -> None:
    values: Array = chi2.rvs(8, size=20_000, random_state=np.random.default_rng(1))
    # 3 standard deviations of a share of 20 000.
    assert abs(Consistency(8, values).inside - 0.95) < 3 * np.sqrt(0.95 * 0.05 / 20_000)


def test_a_filter_that_trusts_poses_too_much_is_found_out(log: Log) -> None:
    usual = reestimate(log).nis().values.mean()
    gullible = reestimate(log, ["estimator.position_noise=0.00002", "estimator.yaw_noise=0.0005"])
    assert gullible.nis().values.mean() > 4 > usual


def test_old_poses_taken_for_new_cost_consistency(log: Log) -> None:
    usual, late = reestimate(log), reestimate(log, ["estimator.roll_forward=false"])
    assert late.nees(log.truth).values.mean() > 2 * usual.nees(log.truth).values.mean()


def test_the_covariance_is_the_logged_variance_and_more(log: Log) -> None:
    again = reestimate(log)
    np.testing.assert_array_equal(np.diagonal(again.covariance, axis1=2, axis2=3), log.estimate.variance)


def test_without_truth_the_innovations_still_speak(log: Log) -> None:
    blind = replace(log, messages={**log.messages, "/truth": Messages((), ())})
    again = reestimate(blind)
    assert len(again.nees(blind.truth).values) == 0
    assert len(again.nis().values) > 300


def test_what_has_no_poses_or_is_no_estimator_is_refused(log: Log) -> None:
    with pytest.raises(HeliTwinError, match="no poses"):
        reestimate(Log({}, experiment="{}"))
    with pytest.raises(HeliTwinError, match=r"estimator\.\*"):
        reestimate(log, ["plant.mass=0.03"])
    with pytest.raises(HeliTwinError, match="'estimator' is not an override: write path=value, such as estimator"):
        reestimate(log, ["estimator"])


def test_the_command_tells_error_and_consistency(
    tmp_path_factory: pytest.TempPathFactory, capsys: pytest.CaptureFixture[str]
) -> None:
    path = fly(load("lab", ["duration=1"]), log_dir=tmp_path_factory.mktemp("flight")).path
    assert main(["reestimate", str(path)]) == 0
    out = capsys.readouterr().out
    assert "bit for bit" in out
    assert "NEES" in out
    assert "NIS" in out
    assert main(["reestimate", str(path), "estimator.roll_forward=false"]) == 0


@pytest.mark.parametrize("trajectory", ["hover", "circle"])
def test_in_the_lab_the_filter_knows_its_error(trajectory: str) -> None:
    log = fly(load("lab", [f"trajectory={trajectory}", "duration=12"]), log_dir=None).log
    nees = reestimate(log).nees(log.truth)
    # Of eight degrees of freedom, over 12 s of errors that a slow bias keeps alike: consistent to a third.
    assert 5.3 < nees.values.mean() < 10.7
    # With walks four times as large or 0.4 times, two in five are inside.
    low, high = CHI2_95[8]
    assert ((nees.values > low) & (nees.values < high)).mean() > 0.85
