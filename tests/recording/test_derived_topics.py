"""Topics that are derived for viewers, read as they do: by protobuf and as CDR."""

import struct
from collections.abc import Callable

import numpy as np
import pytest
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform

from controllers.signals import Command, Reference
from heli_twin.lab.plant import Truth, physical_state
from heli_twin.recording import Log, Recorder

Record = Callable[..., Recorder]


def joints(log: Log) -> np.ndarray:
    """Position, velocity and effort (n, 3, 4) of the plots: arrays of four doubles with a length in front of each."""
    return np.array([struct.unpack("<4d8x4d8x4d", data[-112:]) for data in log.messages["/view/error_and_input"].data])


def test_plots_are_truth_minus_reference_in_the_yaw_frame(record: Record) -> None:
    log = record().log()
    times = log.messages["/view/error_and_input"].times
    rows = np.searchsorted(log.truth.time, times)
    np.testing.assert_array_equal(log.truth.time[rows], times)
    off = physical_state(log.truth)[rows] - log.reference.x[np.searchsorted(log.reference.time, times)]
    # Two libraries' sines, and the turns that the yaw is rounded at.
    np.testing.assert_allclose(joints(log)[:, :8], off, rtol=0, atol=1e-14)


def test_transforms_are_the_truth(record: Record) -> None:
    log = record().log()
    transforms = log.messages["/tf"]
    rows = np.searchsorted(log.truth.time, transforms.times)
    for row, t, data in zip(rows, transforms.times, transforms.data, strict=True):
        message = FrameTransform.FromString(bytes(data))
        assert message.timestamp.ToNanoseconds() == t
        place, turn = message.translation, message.rotation
        np.testing.assert_array_equal([place.x, place.y, place.z], log.truth.position[row])
        np.testing.assert_array_equal([turn.w, turn.x, turn.y, turn.z], log.truth.quat_wxyz[row])


@pytest.mark.parametrize("yaw", [np.inf, -np.inf, np.nan])
def test_a_flight_that_diverged_is_plotted_too(yaw: float) -> None:
    recorder, turn = Recorder(), np.array([1.0, 0.0, 0.0, 0.0])
    truth = Truth(0, np.zeros(3), turn, np.zeros(3), np.zeros(3), yaw, 0.0, np.zeros(4), touching=False)
    recorder.reference(0, Reference(0, np.zeros((2, 8)), np.zeros((1, 4))))
    recorder.truth(0, truth)
    recorder.sent(0, Command(0, np.full(4, 0.5)))
    recorder.close("diverged", 0)
    (plot,) = joints(recorder.log())
    assert np.isnan(plot[3:6]).all()
    np.testing.assert_array_equal(plot[8:], 0.5)
