"""A committed plan is a trajectory: smooth between knots, and at rest after the last."""

import numpy as np

from controllers.coordinations import CommittedPlan
from controllers.trajectories import SmoothTrajectory, derivatives
from controllers.trajectories.circle import Circle

START, STEP = 1_000_000_000, 100_000_000


def sampled(knots: int = 21) -> CommittedPlan:
    """A circle, sampled at knots."""
    t = 1e-9 * (START + STEP * np.arange(knots))
    return CommittedPlan(START, STEP, np.stack(Circle(ramp=0.5).flat(t), axis=1))


def test_a_sampled_circle_is_the_circle():
    plan, t = sampled(), np.arange(1.0, 2.999, 0.013)
    # The rest of the Hermite interpolation: the 6th derivative, 1 rad/s to the 6th, times (0.1 s)^6 / 46080.
    for planned, wanted in zip(plan.flat(t), Circle(ramp=0.5).flat(t), strict=True):
        np.testing.assert_allclose(planned, wanted, atol=1e-7)


def test_it_stays_at_its_last_knot():
    plan = sampled()
    flat = plan.flat(np.array([3.5, 99.0]))
    np.testing.assert_allclose(flat.z, plan.knots[[-1, -1], 0], rtol=1e-15)
    assert not flat.dz.any()
    assert not flat.ddz.any()


def test_its_higher_derivatives_are_those_of_its_path():
    plan, t = sampled(), np.arange(1.05, 2.9, 0.1)
    assert isinstance(plan, SmoothTrajectory)
    third = (plan.flat(t + 1e-4).ddz - plan.flat(t - 1e-4).ddz) / 2e-4
    # Central differences of the acceleration in the middle between knots: (1e-4)^2 of the 5th derivative, about 1.
    np.testing.assert_allclose(derivatives(plan, t, 3)[3], third, atol=1e-5)
