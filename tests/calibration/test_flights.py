"""The calibration flights stay in the room, in every lab that comes with heli_twin."""

from dataclasses import replace

import numpy as np
import pytest

from heli_twin.experiment.text import load
from heli_twin.mission import fly


@pytest.mark.parametrize("lab", ["lab_simple", "lab"])
@pytest.mark.parametrize("flight", ["calibrate_plane", "calibrate_height_yaw"])
def test_a_calibration_flight_stays_in_the_room(flight: str, lab: str):
    planned, there = load(flight), load(lab)
    # The longest doublets of both flights are within the first 10 s.
    result = fly(
        replace(there, trajectory=planned.trajectory, excitation=planned.excitation, duration=10.0), log_dir=None
    )
    assert result.outcome.kind == "completed"
    position = result.log.truth.position
    # A third of the way to the walls of 2.5 m is left, and half a metre to the floor.
    assert np.abs(position[:, :2]).max() < 1.7
    assert position[:, 2].min() > 0.5
    assert position[:, 2].max() < 1.7
