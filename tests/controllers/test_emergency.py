"""Who its cameras have lost, who has left its plan, and how far others keep away: known values."""

import numpy as np

from controllers.committed_plan import CommittedPlan
from controllers.emergency import berth_of, lost_since, strayed
from controllers.right_of_way import Told
from controllers.signals import Estimate

MS = 1_000_000
KNOTS = np.zeros((3, 3, 4))
KNOTS[:, 0, :2] = [[0.0, 1.0], [0.1, 1.0], [0.2, 1.0]]
KNOTS[:, 1, 0] = 1.0
PLAN = CommittedPlan(0, 100 * MS, KNOTS)


def estimate(x: tuple[float, ...] = (0.0,) * 8, picture: int = 0) -> Estimate:
    return Estimate(100 * MS, np.array(x), np.zeros(4), np.zeros((4, 3)), picture, 0)


def test_the_cameras_have_lost_one_whose_newest_picture_is_older_than_a_tenth_of_a_second():
    assert lost_since(600 * MS, estimate(picture=500 * MS)) == np.inf
    assert lost_since(601 * MS, estimate(picture=500 * MS)) == 0.5
    assert lost_since(100 * MS, None) == np.inf
    assert lost_since(101 * MS, None) == 0.0


def test_who_is_further_than_15_cm_from_its_plan_at_the_time_of_its_estimate_has_left_it():
    assert strayed(PLAN, None) is None
    assert strayed(PLAN, estimate((0.1, 1.149, 2.0, 0.0, 9.0, 9.0, 9.0, 9.0))) is None
    # Its nose points west, to y.
    state = strayed(PLAN, estimate((0.251, 1.0, 2.0, 0.5 * np.pi, 0.3, 0.4, 0.5, 0.6)))
    assert state is not None
    expected = [[0.251, 1.0, 2.0, 0.5 * np.pi], [-0.4, 0.3, 0.5, 0.6], [0.0] * 4]
    np.testing.assert_allclose(state, expected, atol=1e-12)


def test_the_berth_grows_with_the_square_of_the_age_and_is_whole_for_one_that_lands():
    t = np.array([0.5, 1.0, 1.5, 2.0, 9.0])
    seen = Told(0, PLAN, (0.0, 0.0), -1, "a", is_down=False)
    assert not berth_of(seen, t, 0.2, 0.25).any()
    np.testing.assert_allclose(berth_of(seen._replace(lost=1.0), t, 0.2, 0.25), [0.0, 0.0, 0.03125, 0.125, 0.2])
    assert (berth_of(seen._replace(is_down=True, lost=1.0), t, 0.2, 0.25) == 0.2).all()
