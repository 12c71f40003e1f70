from dataclasses import FrozenInstanceError
from math import exp

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from controllers.laws.ltv_mpc import LtvMpc
from heli_twin.experiment.families import members
from heli_twin.experiment.text import load
from heli_twin.experiment.tree import tree_of
from heli_twin.lab import disturbances
from heli_twin.lab.disturbances import ALONE, air_of, together
from heli_twin.lab.disturbances.bias import Bias
from heli_twin.lab.disturbances.doorway_jet import DoorwayJet
from heli_twin.lab.disturbances.gust import Gust
from heli_twin.lab.disturbances.mean_wind import MeanWind
from heli_twin.lab.disturbances.vertical_gust import VerticalGust
from heli_twin.lab.disturbances.wind_shear import WindShear
from heli_twin.lab.plant import STILL_AIR, Air
from heli_twin.lab.plant.ideal import Ideal

FAMILY = members("heli_twin.lab.disturbances")
HELICOPTER = Ideal().start(np.array([0.3, -0.2, 1.0, 0.7, 0.5, -0.4, 0.1, 1.5]))


def airs(spec, count=50, seed=0, u=(0.2, -0.1, 0.55, 0.05)):
    """What a disturbance does to one flight."""
    plant, member = Ideal().start(np.array([0, 0, 1.0, 0, 0, 0, 0, 0])), spec.start(np.random.default_rng(seed))
    found = []
    blow = air_of(member)
    for k in range(1, count + 1):
        air = blow(plant.truth(), ALONE)
        found.append(air)
        plant.advance(k * disturbances.PERIOD_NS, np.array(u), air)
    return found


@pytest.mark.parametrize("kind", FAMILY)
class TestEveryDisturbance:
    def test_is_a_value(self, kind):
        spec = FAMILY[kind]()
        assert spec.kind == kind
        assert spec == FAMILY[kind]()
        assert hash(spec) == hash(FAMILY[kind]())
        with pytest.raises(FrozenInstanceError):
            spec.kind = "other"

    def test_is_finite_and_the_same_for_the_same_seed(self, kind):
        first, again = (airs(FAMILY[kind]()) for _ in range(2))
        for a, b in zip(first, again, strict=True):
            assert np.shape(a.wind) == np.shape(a.acceleration) == (3,)
            assert np.isfinite([*a.wind, *a.acceleration, a.thrust_factor]).all()
            assert a.thrust_factor > 0
            np.testing.assert_array_equal([*a.wind, *a.acceleration], [*b.wind, *b.acceleration])
            assert a.thrust_factor == b.thrust_factor

    def test_leaves_two_flights_of_one_spec_alone(self, kind):
        spec = FAMILY[kind]()
        truth = HELICOPTER.truth()
        first = air_of(spec.start(np.random.default_rng(0)))
        alone = [first(truth, ALONE) for _ in range(5)]
        first, second = (air_of(spec.start(np.random.default_rng(seed))) for seed in (0, 1))
        mixed = []
        for _ in range(5):
            mixed.append(first(truth, ALONE))
            second(truth, ALONE)
        np.testing.assert_array_equal([a.wind for a in alone], [a.wind for a in mixed])

    def test_is_switched_on_and_off_by_its_name(self, kind):
        off = load("lab", [f"disturbances.{kind}=off"])
        on = load("ideal", [f"disturbances.{kind}=on"])
        assert kind not in {d.kind for d in off.disturbances}
        assert FAMILY[kind]() in on.disturbances
        assert kind in tree_of(on)["disturbances"]


def test_the_default_flight_is_disturbed_by_gust_and_bias():
    assert {d.kind for d in load().disturbances} == {"gust", "bias"}
    assert load("ideal").disturbances == ()


@given(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1))
def test_a_bias_is_the_same_push_at_all_times(x, y, z):
    for air in airs(Bias(x=x, y=y, z=z), 3):
        np.testing.assert_array_equal(air.acceleration, [x, y, z])
        np.testing.assert_array_equal(air.wind, np.zeros(3))
        assert air.thrust_factor == 1.0


def winds(strength, time, count, seed=0):
    gust, truth = Gust(strength=strength, time=time).start(np.random.default_rng(seed)), HELICOPTER.truth()
    return np.array([gust.air(truth).wind for _ in range(count)])


def test_a_gust_is_as_strong_and_as_slow_as_is_said():
    wind = winds(0.5, 0.1, 20_000)[:, :2]
    pieces = 20_000 * 0.02 / (2 * 0.1) * 2
    # Four deviations of a variance from so many independent pieces.
    assert (wind**2).mean() == pytest.approx(0.25, rel=4 * np.sqrt(2 / pieces))
    lag = 5
    correlation = (wind[lag:] * wind[:-lag]).mean() / (wind**2).mean()
    assert correlation == pytest.approx(exp(-1), abs=4 / np.sqrt(pieces))
    # North and west do not know of each other.
    assert abs((wind[:, 0] * wind[:, 1]).mean() / 0.25) < 4 / np.sqrt(pieces / 2)


def test_a_gust_blows_from_the_start():
    first = np.array([winds(0.5, 5.0, 1, seed)[0, :2] for seed in range(400)])
    # Stationary: four deviations of a variance from 800 draws.
    assert (first**2).mean() == pytest.approx(0.25, rel=4 * np.sqrt(2 / 800))


def test_a_gust_is_level_and_a_gust_of_no_strength_is_still_air():
    assert not winds(0.5, 0.7, 100)[:, 2].any()
    for air in airs(Gust(strength=0.0), 5):
        np.testing.assert_array_equal([*air.wind, *air.acceleration], np.zeros(6))


def test_a_gust_does_not_depend_on_the_flight():
    """Shared random numbers: two controllers meet the same wind."""
    here, there = airs(Gust(), u=(0, 0, 0.5, 0)), airs(Gust(), u=(1, -1, 1, 0.4))
    np.testing.assert_array_equal([a.wind for a in here], [a.wind for a in there])


def test_together_winds_and_pushes_add_up_and_factors_multiply():
    one = Air(np.array([1.0, 2.0, 3.0]), np.array([0.1, 0.2, 0.3]), 0.9)
    other = Air(np.array([-1.0, 1.0, 0.5]), np.array([0.5, 0.0, -0.3]), 0.8)
    both = together([one, other])
    # One sum and one product each.
    np.testing.assert_allclose(both.wind, [0.0, 3.0, 3.5], rtol=0, atol=1e-15)
    np.testing.assert_allclose(both.acceleration, [0.6, 0.2, 0.0], rtol=0, atol=1e-15)
    assert both.thrust_factor == pytest.approx(0.72, abs=1e-15)
    assert both.moment is None
    turning, more = (one._replace(moment=np.array(moment)) for moment in ([1.0, 2.0, 3.0], [0.5, -2.0, 1.0]))
    np.testing.assert_array_equal(together([other, turning, more]).moment, [1.5, 0.0, 4.0])
    still = together([])
    np.testing.assert_array_equal([*still.wind, *still.acceleration], np.zeros(6))
    assert still.thrust_factor == STILL_AIR.thrust_factor == 1.0


def test_updates_are_as_often_as_the_default_control_period():
    """A gust that changed within a control period would be smoothed by nobody and seen by nobody."""
    assert round(LtvMpc().period * 1e9) == disturbances.PERIOD_NS


# --- winds that are steady, or depend on the place --------------------------------------------------------------------


def wind_at(spec, *position):
    truth = HELICOPTER.truth()._replace(position=np.array(position, float))
    return spec.start(np.random.default_rng(0)).air(truth).wind


def test_a_mean_wind_is_the_same_everywhere():
    spec = MeanWind(x=0.3, y=-0.2, z=0.1)
    for place in ((0, 0, 1), (2, -1, 0.3)):
        np.testing.assert_array_equal(wind_at(spec, *place), [0.3, -0.2, 0.1])


@given(st.floats(0, 3), st.floats(-3, 3))
def test_shear_grows_with_height(height, direction):
    wind = wind_at(WindShear(gradient=0.4, direction=direction), 1.0, -1.0, height)
    np.testing.assert_allclose(wind, 0.4 * height * np.array([np.cos(direction), np.sin(direction), 0]), atol=1e-12)
    assert not wind_at(WindShear(gradient=0.4), 0, 0, -0.1).any()


def test_a_vertical_gust_is_vertical_and_as_strong_as_is_said():
    gust, truth = VerticalGust(strength=0.2, time=0.1).start(np.random.default_rng(0)), HELICOPTER.truth()
    wind = np.array([gust.air(truth).wind for _ in range(20_000)])
    assert not wind[:, :2].any()
    # Four deviations of a variance from the independent pieces of 400 s.
    assert (wind[:, 2] ** 2).mean() == pytest.approx(0.04, rel=4 * np.sqrt(2 / 2000))


def test_a_jet_blows_at_the_door_spreads_and_keeps_its_momentum():
    jet = DoorwayJet(x=0.0, y=0.0, z=1.0, direction=np.pi / 2, speed=0.8, width=0.3)
    np.testing.assert_allclose(wind_at(jet, 0, 0, 1), [0, 0.8, 0], atol=1e-12)
    assert not wind_at(jet, 0, -0.01, 1).any()
    # One width beside the axis: 37 %, and beyond it next to nothing.
    assert wind_at(jet, 0.3, 0, 1)[1] == pytest.approx(0.8 * np.exp(-1))
    assert wind_at(jet, 0, 0, 2.0)[1] < 1e-4
    # The momentum flux, the integral of the squared speed over a cross-section, is the same near and far.
    r = np.linspace(0, 5, 2001)
    near, far = (np.array([wind_at(jet, x, s, 1)[1] for x in r]) for s in (0.0, 3.0))
    assert np.trapezoid(near**2 * r, r) == pytest.approx(np.trapezoid(far**2 * r, r), rel=1e-4)
