"""Two helicopters touch as upright cylinders."""

import numpy as np

from heli_twin.lab.plant.size import ABOVE_M, BELOW_M, RADIUS_M
from heli_twin.metrics.contact import touching


def test_who_is_near_in_the_plane_and_in_height_touches():
    first = np.array([0.0, 0.0, 1.0])
    beside, above = np.array([2 * RADIUS_M, 0.0, 0.0]), np.array([0.0, 0.0, BELOW_M + ABOVE_M])
    assert touching(np.array([first, first + 0.99 * beside])) == [(0, 1)]
    assert touching(np.array([first, first + 1.01 * beside])) == []
    assert touching(np.array([first, first + 0.99 * above])) == [(0, 1)]
    assert touching(np.array([first, first + 1.01 * above])) == []
    assert touching(np.array([first, first + 5.0, first - 0.5 * beside, first + 0.4 * beside])) == [
        (0, 2),
        (0, 3),
        (2, 3),
    ]
    assert touching(first[None]) == []


def test_its_size_is_that_of_the_mcx2():
    """A disc of 19 cm; from the skids, 47 mm below the centre of gravity, to the bar, 76 mm above it."""
    one = np.array([0.0, 0.0, 1.0])
    for apart, touches in (
        ([0.189, 0, 0], True),
        ([0.191, 0, 0], False),
        ([0, 0, 0.122], True),
        ([0, 0, 0.124], False),
    ):
        assert bool(touching(np.array([one, one + apart]))) is touches
