import numpy as np
import pytest
from scipy.stats import sobol_indices, t

from heli_twin.reporting.intervals import (
    Interval,
    failure_interval,
    flights_to_show,
    grouped_mean,
    grouped_percent,
    mean_interval,
    median_interval,
    paired_interval,
    screening,
    seed_interval,
    shown_share,
    sobol,
    tolerance_bound,
    wilson,
)
from heli_twin.reporting.words import few_seeds, interval, listed, metric, number, percent

ONE_SEED = Interval(0.24, np.nan, np.nan, 1)


def test_a_mean_interval_is_students():
    # Mean 2, standard deviation 1, and the 97.5 % quantile of t with 2 degrees of freedom, 4.302653.
    found = mean_interval(np.array([1.0, np.nan, 2.0, 3.0]))
    assert found == pytest.approx((2.0, 2 - 4.302653 / np.sqrt(3), 2 + 4.302653 / np.sqrt(3), 3), rel=1e-6)


def test_a_paired_interval_is_that_of_the_differences():
    a, b = np.array([5.0, 7.0, np.nan, 1.0]), np.array([4.0, 4.0, 1.0, np.nan])
    # Differences 1 and 3: mean 2, standard deviation sqrt(2), 12.706205 with 1 degree of freedom.
    assert paired_interval(a, b) == pytest.approx((2.0, 2 - 12.706205, 2 + 12.706205, 2), rel=1e-6)


def test_a_median_interval_is_between_two_of_the_values():
    # Of 6 values the smallest and the greatest enclose the median with 1 - 2/64 = 97 %; of 5 with 94 %.
    assert tuple(median_interval(np.array([3.0, 1.0, 2.0, 6.0, 5.0, 4.0, np.nan]))) == (3.0, 1.0, 6.0, 6)
    assert np.isnan(median_interval(np.arange(5.0)).low)
    # Of 10 values the second and the ninth: 1 - 2 * 11/1024 = 98 %; the third and the eighth only 89 %.
    assert tuple(median_interval(np.arange(1.0, 11.0))) == (5.0, 2.0, 9.0, 10)
    assert median_interval(np.array([7.0, 1.0, 2.0])).value == 2.0


def test_failure_rates_have_wilsons_interval():
    # Wilson for 3 of 10: (p + z^2/2n +- z sqrt(p (1 - p)/n + z^2/4n^2)) / (1 + z^2/n).
    z, n, p = 1.959964, 10, 0.3
    middle, half = (p + z * z / (2 * n)), z * np.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    expected = (0.3, (middle - half) / (1 + z * z / n), (middle + half) / (1 + z * z / n), 10)
    assert wilson(3, 10) == pytest.approx(expected, rel=1e-6)
    # z^2 / (n + z^2) even when nothing failed.
    assert wilson(0, 10)[:3] == pytest.approx((0.0, 0.0, z * z / (n + z * z)), rel=1e-6, abs=1e-12)
    assert wilson(0, 0).n == 0


def test_only_seeds_are_independent():
    # Two masses and three seeds: means of the seeds 2, 3, 4.
    values, seeds = np.array([1.0, 2.0, 3.0, 3.0, 4.0, 5.0]), np.array([0, 1, 2, 0, 1, 2])
    assert seed_interval(values, seeds) == pytest.approx(tuple(mean_interval(np.array([2.0, 3.0, 4.0]))))
    one = seed_interval(values, np.zeros(6))
    assert (one.value, one.n) == (3.0, 1)
    assert np.isnan([one.low, one.high]).all()


def test_many_flights_of_one_seed_have_no_failure_interval():
    failed = np.array([True, False, False, False])
    assert tuple(failure_interval(failed, np.array([0, 0, 1, 1])))[:3] == tuple(wilson(1, 4))[:3]
    one = failure_interval(failed, np.zeros(4))
    assert (one.value, one.n) == (0.25, 1)
    assert np.isnan([one.low, one.high]).all()


@pytest.mark.parametrize(
    ("make", "truth", "draw"),
    [
        (mean_interval, 1.0, lambda rng, n: rng.normal(1.0, 1.0, n)),
        (mean_interval, 1.0, lambda rng, n: rng.exponential(1.0, n)),
        (median_interval, np.log(2), lambda rng, n: rng.exponential(1.0, n)),
    ],
    ids=["mean of normal", "mean of exponential", "median"],
)
def test_intervals_cover_as_often_as_they_say(make, truth, draw):
    rng = np.random.default_rng(1)
    for n, least in ((7, 0.82), (20, 0.88)):
        found = [make(draw(rng, n)) for _ in range(400)]
        hits = np.mean([f.low <= truth <= f.high for f in found])
        # 95 % nominal; 400 trials scatter by 1 %, and Student's t on few skewed values falls short: 86 % of 7.
        assert least <= hits <= 1.0
        assert all(f.low <= f.value <= f.high for f in found)


def test_pairs_see_what_separate_means_cannot():
    rng = np.random.default_rng(0)
    luck = rng.normal(0, 1.0, 30)
    a, b = 5 + luck, 4.9 + luck + rng.normal(0, 0.05, 30)
    assert paired_interval(a, b).low > 0
    assert mean_interval(a).low < mean_interval(b).high


@pytest.mark.parametrize("make", [mean_interval, median_interval])
def test_too_little_data_gives_no_interval(make):
    assert make(np.array([])).n == 0
    assert np.isnan(make(np.array([])).value)
    one = make(np.array([1.0, np.nan]))
    assert (one.value, one.n) == (1.0, 1)
    assert np.isnan([one.low, one.high]).all()


def test_equal_values_have_no_scatter():
    assert tuple(mean_interval(np.full(3, 0.1))) == (pytest.approx(0.1), pytest.approx(0.1), pytest.approx(0.1), 3)
    found = mean_interval(np.full(7, 0.1))
    assert found.low == found.high
    for value in (1.1e-7, 1.3e-7, 1.7e-7):
        tiny = mean_interval(np.full(7, value))
        assert tiny.low == tiny.high


def test_the_scatter_of_tiny_values_is_no_rounding():
    values = np.array([1.0, 2.0, 4.0])
    assert tuple(mean_interval(1e-12 * values))[:3] == pytest.approx(
        tuple(1e-12 * v for v in mean_interval(values)[:3])
    )


def test_grouped_means_are_the_means_of_the_groups():
    rng = np.random.default_rng(2)
    group, values = rng.integers(0, 5, 200), rng.normal(size=200)
    values[::7] = np.nan
    found = grouped_mean(group, values, 6)
    for i in range(5):
        mine = values[(group == i) & np.isfinite(values)]
        half = t.ppf(0.975, len(mine) - 1) * mine.std(ddof=1) / np.sqrt(len(mine))
        assert found.mean[i] == pytest.approx(mine.mean())
        assert (found.low[i], found.high[i], found.n[i]) == pytest.approx(
            (mine.mean() - half, mine.mean() + half, len(mine))
        )
    assert np.isnan(found.mean[5])


def test_a_number_without_an_interval_says_why():
    assert interval(Interval(0.2412, 0.239, 0.241, 8), 100, "cm") == "24.1 [23.9, 24.1] cm"
    assert interval(ONE_SEED, 100, "cm") == "24 cm (one seed)"
    assert interval(Interval(0.24, np.nan, np.nan, 3), 100, "cm") == "24 cm (3 seeds: too few for an interval)"
    assert interval(Interval(0.24, 0.24, 0.24, 1), 100, "cm") == "24 cm"
    assert interval(Interval(np.nan, np.nan, np.nan, 0)) == "-"
    assert percent(wilson(3, 10)) == "30 % [11, 60]"
    assert percent(ONE_SEED) == "24 % (one seed)"
    assert percent(wilson(0, 0)) == "-"
    assert few_seeds(Interval(1.0, 0.5, 1.5, 2)) == ""


def test_numbers_are_told_in_the_units_of_people():
    assert (metric("rmse.x").label, metric("rmse.x").factor) == ("RMS error in x, cm", 100.0)
    assert (metric("rmse.yaw").unit, metric("rmse.yaw").factor) == ("deg", pytest.approx(57.29578))
    assert (metric("mse.z").unit, metric("mse.z").factor) == ("cm\u00b2", 1e4)
    assert metric("mse.yaw").factor == pytest.approx(57.29578**2)
    assert (metric("phase_lag.x").unit, metric("phase_lag.x").factor) == ("ms", 1e3)
    assert (metric("tilt.max").unit, metric("tilt.max").factor) == ("deg", pytest.approx(57.29578))
    assert (metric("overshoot.x").unit, metric("overshoot.x").factor) == ("%", 100.0)
    assert (number(0.012345), number(1234.5, 2), number(np.inf)) == ("0.0123", "1.2e+03", "-")
    assert (listed(["a"]), listed(["a", "b", "c"]), listed([])) == ("a", "a, b and c", "nothing")


def test_sobol_indices_of_ishigami():
    # Known indices: first 0.314 0.442 0, total 0.558 0.442 0.244.
    from scipy.stats import qmc

    n, d = 2048, 3
    shares = qmc.Sobol(2 * d, rng=0).random(n) * 2 * np.pi - np.pi
    A, B = shares[:, :d], shares[:, d:]

    def f(x):
        return np.sin(x[:, 0]) + 7 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0])

    mixtures = []
    for i in range(d):
        mixed = A.copy()
        mixed[:, i] = B[:, i]
        mixtures.append(f(mixed))
    found = sobol(f(A), f(B), np.array(mixtures))
    # 2048 quasi-random rows give two digits.
    assert [i.value for i in found.first] == pytest.approx([0.314, 0.442, 0.0], abs=0.03)
    assert [i.value for i in found.total] == pytest.approx([0.558, 0.442, 0.244], abs=0.03)
    assert all(i.low <= i.value <= i.high for i in found.total)
    # A wrong sign of a half-width would put the limits on the wrong side.
    assert all(i.low < i.high for i in found.first)


def test_the_same_scores_have_the_same_sobol_interval():
    rng = np.random.default_rng(0)
    A, B, AB = rng.normal(size=16), rng.normal(size=16), rng.normal(size=(2, 16))
    indices = sobol(A, B, AB)
    assert indices == sobol(A, B, AB)
    peer = sobol_indices(func={"f_A": A[None], "f_B": B[None], "f_AB": AB[:, None]}, n=16)
    # Sums of 16 numbers.
    assert [i.value for i in indices.first] == pytest.approx(peer.first_order.tolist(), abs=1e-12)
    assert [i.value for i in indices.total] == pytest.approx(peer.total_order.tolist(), abs=1e-12)


def test_scores_that_never_change_depend_on_no_axis():
    found = sobol(np.ones(8), np.ones(8), np.ones((3, 8)))
    assert found.first == found.total == [Interval(0.0, 0.0, 0.0, 8)] * 3


def test_screened_effects_have_students_and_the_chi_square_interval():
    found = screening(np.array([[1.0, 8.0], [-2.0, 8.2], [3.0, 8.1]]))
    # Student's t of two degrees of freedom is 4.30265; chi-square 0.0506356 and 7.37776.
    assert found.mu_star[0] == pytest.approx((2.0, 0.0, 2.0 + 4.30265 / np.sqrt(3), 3), rel=1e-5)
    assert found.mu_star[1] == pytest.approx(
        (8.1, 8.1 - 0.430265 / np.sqrt(3), 8.1 + 0.430265 / np.sqrt(3), 3), rel=1e-5
    )
    sigma = np.sqrt(19.0 / 3.0)
    assert found.sigma[0] == pytest.approx(
        (sigma, sigma * np.sqrt(2 / 7.37776), sigma * np.sqrt(2 / 0.0506356), 3), rel=1e-5
    )


def test_one_flight_shows_one_in_twenty():
    # log(0.05) / log(0.05) is 1, and rounding must not make two of it.
    assert [flights_to_show(share) for share in (0.05, 0.95, 0.99)] == [1, 59, 299]


def test_wilks_numbers_of_flights_are_the_textbooks():
    assert [flights_to_show(share) for share in (0.9, 0.95, 0.99, 0.999)] == [29, 59, 299, 2995]
    assert shown_share(0, 59) == pytest.approx(0.05 ** (1 / 59))
    assert shown_share(0, 58) < 0.95 < shown_share(0, 59)
    assert (shown_share(0, 0), shown_share(3, 3)) == (0.0, 0.0)
    # Clopper and Pearson for one failure: 93 flights show 95 %.
    assert shown_share(1, 92) < 0.95 < shown_share(1, 93)
    values = np.arange(93.0)
    # Of 59 the greatest is the bound, of 93 the second.
    assert tolerance_bound(values[:59]) == 58.0
    assert tolerance_bound(values) == 91.0
    assert tolerance_bound(values[:58]) == np.inf


@pytest.mark.parametrize("rate", [0.003, 0.02, 0.1, 0.35])
def test_bounds_on_failure_rates_hold_as_often_as_they_say(rate):
    n, studies = 120, 20_000
    failures = np.random.default_rng(0).binomial(n, rate, studies)
    shown = {k: shown_share(k, n) for k in np.unique(failures)}
    # An exact bound never holds less often; 3 standard deviations of 20 000 studies are 0.5 %.
    assert np.mean([1.0 - shown[k] >= rate for k in failures]) >= 0.95 - 0.005
    limits = {k: wilson(k, n) for k in shown}
    # Wilson's interval holds 95 % on the average of all rates; at a single one of these, between 92 % and 99.5 %.
    held = np.mean([limits[k].low <= rate <= limits[k].high for k in failures])
    assert 0.92 <= held <= 0.995


def test_wilsons_interval_holds_95_percent_on_average():
    rng = np.random.default_rng(1)
    rates = rng.uniform(0.0, 1.0, 40_000)
    failures = rng.binomial(60, rates)
    limits = np.array([wilson(k, 60)[1:3] for k in range(61)])[failures]
    held = np.mean((limits[:, 0] <= rates) & (rates <= limits[:, 1]))
    # 3 standard deviations of 40 000 studies are 0.3 %.
    assert held == pytest.approx(0.95, abs=0.006)


@pytest.mark.parametrize(("draw", "quantile"), [("standard_normal", 1.644854), ("standard_exponential", 2.995732)])
@pytest.mark.parametrize("n", [59, 200])
def test_the_bound_of_scores_holds_in_95_of_100_studies_of_any_distribution(draw, quantile, n):
    values = getattr(np.random.default_rng(2), draw)((2000, n))
    held = np.mean([tolerance_bound(row) >= quantile for row in values])
    # 3 standard deviations of 2000 studies are 1.5 %; the ranks are whole, so that it holds more often.
    assert 0.95 - 0.015 <= held <= 0.98


def test_rates_of_groups_have_wilsons_interval_each():
    found = grouped_percent(np.array([0, 0, 2, 2, 2]), np.array([True, False, False, False, False]), 3)
    assert (found.mean[0], found.mean[2], found.n.tolist()) == (50.0, 0.0, [2, 0, 3])
    assert np.isnan(found.mean[1])
    assert (found.low[0], found.high[0]) == pytest.approx([100.0 * limit for limit in wilson(1, 2)[1:3]])
    assert (found.low[2], found.high[2]) == pytest.approx([100.0 * limit for limit in wilson(0, 3)[1:3]])
