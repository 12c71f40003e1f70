"""Noise that is mixed of several seeds: as probable as that of one, none of it where the weights are 0."""

import numpy as np
import pytest
from scipy import stats

from heli_twin import fly, load
from heli_twin.errors import HeliTwinError
from heli_twin.experiment import Experiment
from heli_twin.experiment.tree import canonical_json
from heli_twin.lab.chance import generator, mixed

PAIR = ((5, 0.6), (6, 0.8))
DRAWS = {
    "standard_normal": (lambda g: g.standard_normal(4000), stats.norm.cdf),
    "normal": (lambda g: (g.normal(2.0, 3.0, 4000) - 2.0) / 3.0, stats.norm.cdf),
    "random": (lambda g: g.random(4000), stats.uniform.cdf),
    "uniform": (lambda g: (g.uniform(-3.0, 1.0, 4000) + 3.0) / 4.0, stats.uniform.cdf),
    "exponential": (lambda g: g.exponential(2.0, 4000) / 2.0, stats.expon.cdf),
}


@pytest.mark.parametrize("name", DRAWS)
def test_every_distribution_is_kept_where_the_squared_weights_add_up_to_one(name) -> None:
    draw, distribution = DRAWS[name]
    assert stats.kstest(draw(mixed(PAIR)(0, "gust")), distribution).pvalue > 0.01


def test_whole_numbers_are_equally_frequent_and_within_their_limits() -> None:
    drawn = mixed(PAIR)(0, "gust").integers(3, 8, 5000)
    assert set(drawn) == {3, 4, 5, 6, 7}
    assert stats.chisquare(np.bincount(drawn)[3:]).pvalue > 0.01
    assert set(mixed(((1, 100.0),))(0, "gust").integers(2, size=100)) == {0, 1}


def test_normal_numbers_are_the_weighted_sum() -> None:
    one, other = (generator(seed, "gust").standard_normal((3, 2)) for seed in (5, 6))
    assert mixed(PAIR)(0, "gust").standard_normal((3, 2)) == pytest.approx(0.6 * one + 0.8 * other)


def test_who_asks_for_no_parameters_gets_the_standard_distributions() -> None:
    def drawn(name: str, *parameters: float) -> np.ndarray:
        return getattr(mixed(PAIR)(0, "gust"), name)(*parameters, size=5)

    assert drawn("normal").tolist() == drawn("standard_normal").tolist()
    assert drawn("uniform").tolist() == drawn("random").tolist()
    assert drawn("exponential").tolist() == drawn("exponential", 1.0).tolist()


def test_another_distribution_is_refused_by_name() -> None:
    with pytest.raises(HeliTwinError, match="draws by `poisson`"):
        mixed(PAIR)(0, "gust").poisson(3.0)


def test_the_weights_and_not_the_seed_make_the_flight() -> None:
    words = ["trajectory=hover", "duration=1", "faults.pose_swap.rate=1"]
    flown = [
        fly(load("lab", [*words, f"noise={noise}", f"seed={seed}"]), log_dir=None).log
        for noise, seed in (("[[5, 0.6], [6, 0.8]]", 0), ("[[5, 0.6], [6, 0.8]]", 1), ("[[5, 0.8], [6, 0.6]]", 0))
    ]
    same, other = (np.array_equal(flown[0].pose.position, log.pose.position) for log in flown[1:])
    assert (same, other) == (True, False)


def test_without_noise_a_hover_stays_where_it_is() -> None:
    words = ["trajectory=hover", "duration=2", "disturbances.bias=off", "noise=[[0, 0]]"]
    log = fly(load("lab_simple", words), log_dir=None).log
    assert not log.disturbance.wind.any()
    assert np.abs(log.truth.position - [0.0, 0.0, 1.0]).max() < 0.005


def test_an_experiment_without_a_mixture_has_the_text_it_had() -> None:
    assert '"noise":' not in canonical_json(Experiment())
    assert '"noise":[[5,0.6]]' in canonical_json(Experiment(noise=((5, 0.6),)))
