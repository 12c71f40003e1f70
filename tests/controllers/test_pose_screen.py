from math import pi

import numpy as np
import pytest

from controllers.pose_screen import PoseScreen, ScreenSettings

MS = 1_000_000
HALF_TURN = np.array([0.0, 0.0, 0.0, pi])


@pytest.mark.parametrize(
    ("restarts", "now", "verdict"),
    [
        ((0,), 99, "refuse"),
        ((0,), 100, "fuse"),
        ((0, 90), 100, "fuse"),
        ((50,), 149, "refuse"),
        ((50,), 150, "fuse"),
        ((50, 90), 150, "fuse"),
    ],
)
def test_a_half_turn_is_the_tracker_s_from_a_jump_time_after_the_first_pose_on(restarts, now, verdict):
    """The first pose may have been the wrong one, so that a half turn soon after it may be true."""
    screen = PoseScreen(ScreenSettings(10.8, 5, True, 100 * MS, np.full(4, 1e-3), np.array([3.0, 3.0, 3.0, 5.0])))
    for stamp in restarts:
        screen.restart(stamp * MS)
    judged, innovation = screen.judge(now * MS, restarts[-1] * MS, HALF_TURN, np.full(4, 1e-6))
    assert judged == verdict
    assert abs(innovation[3]) == pytest.approx(0.0 if verdict == "fuse" else pi, abs=1e-12)
