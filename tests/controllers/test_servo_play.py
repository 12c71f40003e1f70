"""The play of the swashplate: as the twin has it, and crossed ahead of time."""

import numpy as np

from controllers.servo_play import ServoPlay

RNG = np.random.default_rng(3)


def test_the_plate_stands_still_within_its_play_and_is_dragged_along_beyond():
    play = ServoPlay(0.04)
    sent = np.array([[0.01, 0.0], [0.05, -0.05], [0.04, -0.02], [0.0, 0.0], [-0.1, 0.1]])
    plates = [play.follow(np.array([*u, 0.5, 0.1])) for u in sent]
    np.testing.assert_allclose(
        plates, [[x, y, 0.5, 0.1] for x, y in ((0, 0), (0.03, -0.03), (0.03, -0.03), (0.02, -0.02), (-0.08, 0.08))]
    )


def test_what_is_wanted_acts_where_it_moves_by_more_than_noise():
    law, twin = ServoPlay(0.03), ServoPlay(0.03)
    last = np.zeros(2)
    for wanted in 0.2 * RNG.standard_normal((100, 4)):
        acted = twin.follow(law.ahead(wanted))
        sure = np.abs(wanted[:2] - last) > 0.01
        np.testing.assert_allclose(acted[:2][sure], wanted[:2][sure], atol=1e-12)
        # A change that may be noise is off by the play's half at most.
        assert np.abs(acted - wanted).max() < 0.015
        last = acted[:2]


def test_without_play_nothing_is_added():
    play, u = ServoPlay(0.0), RNG.standard_normal(4)
    np.testing.assert_array_equal(play.ahead(u), u)
    np.testing.assert_array_equal(play.follow(u), u)
