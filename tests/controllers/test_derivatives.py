"""Higher derivatives of planned flights: exact, as continuous as they say, and only where somebody asks for them."""

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from controllers.errors import MissingDerivatives
from controllers.flatness import FlatOutput, feed_forward, state
from controllers.jets import Jet, arctan2, at_pace, sine_cosine
from controllers.laws import extra_states, flat_derivatives
from controllers.laws.pid import Pid
from controllers.model import Model
from controllers.pace import ride_clock, ride_duration
from controllers.reference import ReferencePreview, with_flat
from controllers.signals import NamedState, Reference
from controllers.trajectories import ALL_DERIVATIVES, derivatives, fitted, smoothness
from controllers.trajectories.circle import Circle
from controllers.trajectories.hover import Hover
from controllers.trajectories.lemniscate import Lemniscate
from controllers.trajectories.takeoff_and_landing import TakeoffAndLanding
from heli_twin.experiment.families import members

T = np.linspace(0.0, 3.0, 7)
FAMILY = members("controllers.trajectories")


def clock(order: int = 6) -> Jet:
    return Jet.variable(T, 1.0, order)


def test_a_polynomial_has_the_derivatives_of_the_textbook() -> None:
    t = clock(4)
    cube = (t * t * t - 2.0 * t + 1.0).derivatives()
    np.testing.assert_allclose(cube, [T**3 - 2 * T + 1, 3 * T**2 - 2, 6 * T, 6 + 0 * T, 0 * T], atol=1e-12)


def test_sine_and_cosine_turn_into_each_other() -> None:
    s, c = sine_cosine(2.0 * clock())
    for k in range(7):
        np.testing.assert_allclose(s.derivatives()[k], 2.0**k * np.sin(2 * T + k * np.pi / 2), atol=1e-12)
        np.testing.assert_allclose(c.derivatives()[k], 2.0**k * np.cos(2 * T + k * np.pi / 2), atol=1e-12)


def test_a_quotient_times_its_divisor_is_the_dividend() -> None:
    s, c = sine_cosine(clock())
    np.testing.assert_allclose(((s / (c + 2.0)) * (c + 2.0)).coefficients, s.coefficients, atol=1e-12)


def test_the_direction_of_a_turning_vector_is_its_angle() -> None:
    angle = 0.3 * clock() * clock() - 1.0
    s, c = sine_cosine(angle)
    np.testing.assert_allclose(arctan2(3.0 * s, 3.0 * c).coefficients, angle.coefficients, atol=1e-12)


def test_a_curve_at_a_pace_follows_the_chain_rule() -> None:
    s, _ = sine_cosine(clock() * clock())
    curve = at_pace(
        lambda r, n: np.stack([sine_cosine(Jet.variable(r, 1.0, n))[0].derivatives()] * 4, -1), clock() * clock()
    )
    np.testing.assert_allclose(curve[..., 0], s.derivatives(), rtol=1e-10, atol=1e-9)


@pytest.mark.parametrize("kind", FAMILY)
def test_the_first_two_are_those_that_fly(kind: str) -> None:
    spec: Any = fitted(FAMILY[kind](), Model())
    t = np.linspace(0.0, 40.0, 2001)
    for highest in (2, 6):
        derivatives = spec.derivatives(t, highest)
        assert derivatives.shape == (highest + 1, len(t), 4)
        np.testing.assert_allclose(derivatives[:3], np.stack(spec.flat(t)), atol=1e-12)


def test_a_start_in_motion_has_every_derivative() -> None:
    assert smoothness(Circle(ramp=0.0)) == smoothness(Hover()) == ALL_DERIVATIVES
    assert smoothness(TakeoffAndLanding(flight=Hover())) == 2
    for kind, spec in members("controllers.trajectories").items():
        assert smoothness(spec()) == (ALL_DERIVATIVES if kind == "hover" else 2)
        if kind in ("circle", "ferris_wheel", "lemniscate", "pirouette", "pirouette_circle"):
            ramped: Any = replace(spec(), ramp=0.5)
            assert smoothness(ramped) == 2
            assert smoothness(replace(ramped, ramp=0.0)) == ALL_DERIVATIVES


def test_a_figure_of_eight_backwards_keeps_its_heading() -> None:
    eight, t = Lemniscate(rate=-0.8), np.linspace(0.0, 20.0, 501)
    np.testing.assert_allclose(eight.derivatives(t, 1)[0], eight.flat(t).z, atol=1e-12)


@dataclass(frozen=True)
class Plain:
    """A stranger's trajectory of before."""

    kind: Literal["plain"] = "plain"

    def flat(self, t: np.ndarray) -> FlatOutput:
        return Hover().flat(t)


def test_a_plain_trajectory_says_what_it_lacks() -> None:
    for highest in (0, 1, 2):
        assert derivatives(Plain(), np.zeros(5), highest).shape == (highest + 1, 5, 4)
    assert smoothness(Plain()) == 2
    assert derivatives(Plain(), T, 2).shape == (3, 7, 4)
    for trajectory in (Plain(), TakeoffAndLanding(flight=Plain())):
        with pytest.raises(MissingDerivatives, match=r"Plain gives .* up to the 2nd, and the 5th are asked for: add a"):
            derivatives(trajectory, T, 5)


@given(st.integers(1, 6), st.integers(0, 300), st.integers(1, 20))
def test_a_preview_holds_the_derivatives_of_its_times(highest: int, first: int, steps: int) -> None:
    period = 20_000_000
    reference = ReferencePreview(Circle(), Model(), period, 0, highest)(first * period, steps)
    assert reference.flat is not None
    wanted = Circle().derivatives(0.02 * np.arange(first, first + steps + 1), highest)
    np.testing.assert_allclose(reference.flat, wanted, atol=1e-12)
    assert ReferencePreview(Circle(), Model(), period, 0)(0, 3).flat is None
    ahead = ReferencePreview(Circle(), Model(), period, 0, highest, lambda flat: flat[1])(first * period, steps)
    assert ahead.prepared is not None
    np.testing.assert_allclose(ahead.prepared, wanted[1], atol=1e-12)


def test_a_reference_of_a_supervisor_gets_the_flat_outputs_of_its_states_and_inputs() -> None:
    model, t = Model(), 0.02 * np.arange(30)
    flat = Circle().flat(t)
    bare = Reference(0, state(flat), feed_forward(model, flat)[:-1])
    filled = with_flat(bare, model, 4)
    assert filled.flat is not None
    # The last input is held, so the last acceleration is that of the row before.
    np.testing.assert_allclose(filled.flat[:3, :-1], np.stack(flat)[:, :-1], atol=1e-12)
    np.testing.assert_array_equal(filled.flat[3:], 0.0)
    assert with_flat(bare, model, 0) is bare
    assert with_flat(filled, model, 4) is filled


def test_laws_of_before_read_no_derivatives_and_have_no_further_states() -> None:
    assert flat_derivatives(Pid()) == 0
    assert extra_states(Pid()) == ()

    class Named:
        extra_states = (("tilt", "rad"),)

    assert extra_states(Named()) == (NamedState("tilt", "rad"),)


def test_a_fitted_flight_is_as_smooth() -> None:
    spec: Any = fitted(FAMILY["waypoints"](), Model())
    assert replace(spec, effort=0.2).smoothness == 2


@pytest.mark.parametrize("ramp", [0.0, 0.5, 3.0])
def test_a_ride_stops_as_it_starts(ramp: float) -> None:
    """Of length 3, with a ramp of 3 it never runs at full pace."""
    end = ride_duration(3.0, ramp)
    t = np.linspace(0.0, end, 41)
    there, back = ride_clock(t, 3.0, ramp, 3).coefficients, ride_clock(end - t, 3.0, ramp, 3).coefficients
    inside = slice(1, -1)
    assert there[0] + back[0] == pytest.approx(3.0)
    assert there[1][inside] == pytest.approx(back[1][inside])
    assert there[2][inside] == pytest.approx(-back[2][inside], abs=1e-12)
