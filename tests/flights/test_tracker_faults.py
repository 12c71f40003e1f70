"""Flights in the lab whose tracker is wrong for a while: the helicopter stays where it should be."""

from dataclasses import replace

import numpy as np
import pytest

from controllers.flatness import state
from controllers.rotations import wrap_angle
from controllers.signals import Pose
from heli_twin import load
from heli_twin.flight import Flight
from heli_twin.lab.mocap import Arrival
from heli_twin.logbook import begin_log
from heli_twin.recording import read_log

START = 3.0


class TrackerFault(Flight):
    """A flight whose poses are changed on their way."""

    def look(self, t, truth):
        sound = len(self.poses_under_way)
        super().look(t, truth)
        for at, pose in self.poses_under_way[sound:]:
            self.poses_under_way[-1] = Arrival(at, self.fault(pose))


class Frozen:
    def __init__(self, seed):
        self.last = None

    def __call__(self, pose):
        if self.last is None or not START <= 1e-9 * pose.stamp < START + 0.5:
            self.last = pose
        return self.last._replace(stamp=pose.stamp)


class Flipped:
    def __init__(self, seed):
        pass

    def __call__(self, pose):
        w, x, y, z = pose.quat_wxyz
        is_wrong = START <= 1e-9 * pose.stamp < START + 0.2
        return pose._replace(quat_wxyz=np.array([-z, y, -x, w])) if is_wrong else pose


class Swapped:
    def __init__(self, seed):
        direction = np.random.default_rng(seed).normal(size=3)
        self.leap = 0.3 * direction / np.linalg.norm(direction)

    def __call__(self, pose):
        is_wrong = START <= 1e-9 * pose.stamp < START + 0.3
        return Pose(pose.stamp, pose.position + self.leap, pose.quat_wxyz) if is_wrong else pose


def errors(trajectory, seed, fault):
    """Truth minus plan from the fault on: of position (m) along the worst axis, and of yaw (degrees)."""
    e = replace(load("lab", [f"trajectory={trajectory}"]), seed=seed, duration=START + 2.5)
    with begin_log(None, e) as recorder:
        plant = e.plant.start(state(e.trajectory.flat(np.zeros(1)))[0])
        flight = TrackerFault(e, plant, recorder)
        flight.fault = fault(seed)
        recorder.close("completed", flight.run().time)
    log = read_log(recorder.stream)
    since = log.truth.time >= START * 1e9
    position = log.truth.position[since] - log.reference.x[since, :3]
    return np.abs(position).max(), np.degrees(
        np.abs(wrap_angle(log.truth.yaw[since] - log.reference.x[since, 3]))
    ).max()


@pytest.mark.parametrize("trajectory", ["hover", "circle"])
@pytest.mark.parametrize("fault", [Frozen, Flipped, Swapped])
@pytest.mark.parametrize("seeds", [range(2), pytest.param(range(2, 20), marks=pytest.mark.long)], ids=["few", "many"])
def test_a_tracker_that_is_wrong_for_a_while_does_not_lead_the_flight_astray(trajectory, fault, seeds):
    position, yaw = np.max([errors(trajectory, seed, fault) for seed in seeds], axis=0)
    assert position < 0.10
    assert yaw < 5.0
