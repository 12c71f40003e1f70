"""Helicopters blow on those below them."""

from dataclasses import replace

import numpy as np
import pytest

from controllers.signals import Array
from controllers.trajectories.hover import Hover
from heli_twin.experiment.several import Several
from heli_twin.experiment.text import load
from heli_twin.lab.disturbances import downwash
from heli_twin.lab.disturbances.downwash import Downwash, jet
from heli_twin.lab.plant import Air
from heli_twin.lab.plant.mujoco import MuJoCo
from heli_twin.several.fly import fly_several

HERE = np.array([0.4, -0.3, 1.2])


@pytest.fixture
def _on_the_axis(monkeypatch: pytest.MonkeyPatch) -> None:
    """The jet at a point, not over the disc."""
    monkeypatch.setattr(downwash, "DISC", np.zeros((1, 2)))


@pytest.mark.usefixtures("_on_the_axis")
@pytest.mark.parametrize(("above", "speed", "half"), [(0.5, 2.4, 0.12), (1.0, 1.8, 0.16)])
def test_a_jet_is_that_of_its_source(above: float, speed: float, half: float):
    assert jet(HERE, HERE + np.array([[0.0, 0.0, above]])) == pytest.approx(speed)
    assert jet(HERE, HERE + np.array([[half, 0.0, above]])) == pytest.approx(0.5 * speed)
    assert jet(HERE, HERE + np.array([[0.0, 1.0, above]])) < 0.02 * speed


@pytest.mark.usefixtures("_on_the_axis")
def test_a_jet_begins_over_twenty_centimetres():
    # 3.6 m^2/s over the distance from a metre above the rotors.
    assert jet(HERE, HERE + np.array([[0.0, 0.0, 0.1]])) == pytest.approx(0.5 * 3.6 / 1.1)
    assert jet(HERE, HERE + np.array([[0.0, 0.0, 0.2]])) == pytest.approx(3.6 / 1.2)


@pytest.mark.usefixtures("_on_the_axis")
def test_the_air_of_a_jet_takes_thrust_and_pushes_down():
    truth = MuJoCo().start(np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0])).truth()
    above = truth.position + np.array([[0.0, 0.0, 0.5]])

    def air(others: Array, **fields: float) -> Air:
        return Downwash(**fields).start(np.random.default_rng(0)).air(truth, others)

    # 2.4 m/s, half as strong.
    blown = air(above, strength=0.5)
    np.testing.assert_allclose(blown.acceleration, [0.0, 0.0, -0.09 * 1.2**2])
    assert blown.thrust_factor == pytest.approx(1.0 - 0.07 * 1.2)
    assert not blown.wind.any()
    assert air(above, strength=10.0).thrust_factor == 0.0
    calm = air(np.zeros((0, 3)))
    assert (calm.thrust_factor, *calm.acceleration) == (1.0, 0.0, 0.0, 0.0)


def test_only_those_above_blow_and_jets_add_up():
    above, below = HERE + np.array([[0.05, 0.0, 0.5]]), HERE + np.array([[0.0, 0.0, -0.5]])
    assert jet(HERE, below) == jet(HERE, np.zeros((0, 3))) == 0.0
    assert jet(HERE, np.concatenate([above, below, above])) == pytest.approx(2.0 * jet(HERE, above))
    # Over a disc the jet is weaker than on its axis, and it begins without a jump.
    assert 1.5 < jet(HERE, HERE + np.array([[0.0, 0.0, 0.5]])) < 2.4
    assert jet(HERE, HERE + np.array([[0.0, 0.0, 1e-6]])) < 1e-4


def test_the_jet_is_averaged_over_the_disc_alike_from_all_sides():
    # In its middle and at six points around it, at half a metre, where it is half as fast 12 cm beside its axis.
    ring = (1.0 + (2.0**0.5 - 1.0) * (0.067 / 0.12) ** 2) ** -2
    assert jet(HERE, HERE + np.array([[0.0, 0.0, 0.5]])) == pytest.approx(2.4 * (1.0 + 6.0 * ring) / 7.0, rel=1e-12)
    sides = np.radians(60.0) * np.arange(6)
    around = [jet(HERE, HERE + np.array([[0.1 * np.cos(side), 0.1 * np.sin(side), 0.5]])) for side in sides]
    assert around == pytest.approx([around[0]] * 6, rel=1e-12)


def test_one_that_hovers_half_a_metre_above_another_sinks_it():
    e = replace(load("lab_simple", ["disturbances.gust=off", "disturbances.bias=off"]), duration=2.0)
    lowest: list[float] = []
    for air in ((), (Downwash(),)):
        ships = {
            name: replace(e, trajectory=Hover(height=height), disturbances=air)
            for name, height in (("low", 1.0), ("high", 1.5))
        }
        log = fly_several(Several(ships=ships), log_dir=None).log
        assert log.ship("high").disturbance.thrust_factor.min() == 1.0
        lowest.append(float(log.ship("low").truth.position[:, 2].min()))
    without, with_jet = lowest
    assert without > 0.99
    assert 0.80 < with_jet < 0.95
