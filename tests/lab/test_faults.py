from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from controllers.signals import Pose
from heli_twin.experiment.families import members
from heli_twin.experiment.text import load
from heli_twin.lab.faults.pose_nan import PoseNan
from heli_twin.lab.faults.pose_outage import PoseOutage

FAMILY = members("heli_twin.lab.faults")
MS = 1_000_000


def pose(ms):
    return Pose(ms * MS, np.array([0.1, 0.2, 1.0]), np.array([1.0, 0, 0, 0]))


@pytest.mark.parametrize("kind", FAMILY)
class TestEveryFault:
    def test_is_a_value(self, kind):
        spec = FAMILY[kind]()
        assert spec.kind == kind
        assert spec == FAMILY[kind]()
        with pytest.raises(FrozenInstanceError):
            spec.kind = "other"

    def test_has_no_memory_and_leaves_the_pose_it_was_given_alone(self, kind):
        fault = FAMILY[kind]()
        for ms in range(0, 10_000, 10):
            given_pose = pose(ms)
            first, again = fault.pose(given_pose), fault.pose(given_pose)
            np.testing.assert_array_equal([*given_pose.position, *given_pose.quat_wxyz], [0.1, 0.2, 1, 1, 0, 0, 0])
            assert (first is None) == (again is None)
            if first is not None:
                assert first.stamp == given_pose.stamp
                np.testing.assert_array_equal(first.position, again.position)

    def test_does_something_and_not_always(self, kind):
        fault = FAMILY[kind]()
        poses = [pose(ms) for ms in range(10_000)]
        same = [(f := fault.pose(p)) is not None and np.array_equal(f.position, p.position) for p in poses]
        assert any(same)
        assert not all(same)

    def test_is_off_unless_asked_for(self, kind):
        assert load().faults == ()
        assert load("lab", [f"faults.{kind}=on"]).faults == (FAMILY[kind](),)


spans = st.tuples(st.integers(0, 5000), st.integers(0, 2000))


@given(spans, st.integers(0, 8000))
def test_an_outage_loses_the_poses_in_it_and_no_other(span, ms):
    begin, length = span
    found = PoseOutage(start=begin / 1000, duration=length / 1000).pose(pose(ms))
    # The bounds of an interval in floating seconds may fall a millisecond's rounding to either side.
    if ms not in (begin, begin + length):
        assert (found is None) == (begin < ms < begin + length)


@given(spans, st.integers(0, 8000))
def test_in_a_nan_fault_nothing_of_a_pose_is_a_number_but_its_stamp(span, ms):
    begin, length = span
    found = PoseNan(start=begin / 1000, duration=length / 1000).pose(pose(ms))
    assert found.stamp == ms * MS
    if ms not in (begin, begin + length):
        bad = begin < ms < begin + length
        np.testing.assert_array_equal(np.isnan([*found.position, *found.quat_wxyz]), bad)


def test_the_default_outage_lasts_as_long_as_in_the_field():
    lost = [ms for ms in range(10_000) if PoseOutage().pose(pose(ms)) is None]
    assert len(lost) == 300
