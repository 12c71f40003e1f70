"""The wire from the helicopter to the ground station: motion capture with noise, delay and dropouts."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from math import exp, sqrt
from typing import Annotated, Literal, NamedTuple, Protocol

import numpy as np
from annotated_types import Ge, Gt, Le, Lt, Unit, doc

from controllers.signals import Array, Pose, nanoseconds
from heli_twin.lab.chance import BLOCK, coloured
from heli_twin.lab.plant import Truth


class Arrival(NamedTuple):
    """A pose on its way."""

    at: int
    """When it reaches the ground station, ns."""
    pose: Pose


class Mocap(Protocol):
    """Cameras in flight."""

    due: int
    """When the cameras next look, ns."""

    def capture(self, now: int, truth: Truth) -> Arrival | None:
        """Look at the helicopter; None if the frame is lost."""
        ...


class MocapSpec(Protocol):
    """Cameras as a value."""

    def start(self, rng: np.random.Generator) -> Mocap:
        """Cameras for one flight."""
        ...


@dataclass(frozen=True, slots=True)
class Vicon:
    """Four Vicon Bonita cameras over a small volume.

    Source: static error 0.15 mm, dynamic below 2 mm (Merriaux et al., Sensors 2017).
    """

    kind: Literal["vicon"] = "vicon"
    rate: Annotated[float, Ge(1), Le(1000), Unit("Hz"), doc("frames per second")] = 100.0
    latency: Annotated[float, Ge(0), Le(1), Unit("s"), doc("from the picture to the ground station")] = 0.010
    jitter: Annotated[float, Ge(0), Le(1), Unit("s"), doc("standard deviation of the latency")] = 0.001
    position_noise: Annotated[float, Ge(0), Unit("m"), doc("white noise of a position, standard deviation")] = 0.0003
    bias: Annotated[float, Ge(0), Unit("m"), doc("slow error of a position, standard deviation")] = 0.0005
    bias_time: Annotated[float, Gt(0), Unit("s"), doc("time in which the slow error changes")] = 5.0
    orientation_noise: Annotated[float, Ge(0), Unit("rad"), doc("white noise about each axis")] = 0.0052
    dropout: Annotated[float, Ge(0), Lt(1), doc("share of single frames lost")] = 0.005

    def start(self, rng: np.random.Generator) -> "ViconCameras":
        """Cameras for one flight."""
        return ViconCameras(self, rng)


Frame = tuple[Array, list[float], int, bool]
"""The errors of one frame, which do not depend on the helicopter.

They are the displacement (3,), world, m; a small rotation (3,) about the axes of the body, rad; the time from the
picture to the ground station, ns; and whether the frame is lost.
"""


class ViconCameras:
    """The cameras of one flight; their phase against the control loop is drawn once."""

    def __init__(self, spec: Vicon, rng: np.random.Generator) -> None:
        self._period = nanoseconds(1.0 / spec.rate)
        first_bias = spec.bias * rng.standard_normal(3)
        self.due = int(rng.integers(self._period))
        self._frames = frames(spec, first_bias, rng)

    def capture(self, now: int, truth: Truth) -> Arrival | None:
        """A noisy, delayed pose, or None if the frame is lost."""
        self.due += self._period
        displacement, turn, late, lost = next(self._frames)
        if lost:
            return None
        return Arrival(now + late, Pose(now, truth.position + displacement, rotated(truth.quat_wxyz, turn)))


def frames(spec: Vicon, bias: Array, rng: np.random.Generator) -> Iterator[Frame]:
    """Yield the errors of each frame, whose slow error before the first frame is `bias` (3,), m.

    Eleven numbers a frame, lost or not: chance must not depend on what happens to the frame.
    """
    keep = exp(-1.0 / (spec.rate * spec.bias_time))
    step_deviation = spec.bias * sqrt(1.0 - keep**2)
    normals, uniforms = np.empty((BLOCK, 10)), np.empty(BLOCK)
    while True:
        # In this order since the first version: a log of before flies as it flew.
        for k in range(BLOCK):
            normals[k], uniforms[k] = rng.standard_normal(10), rng.random()
        biases = coloured(bias, keep, step_deviation * normals[:, 0:3])
        bias = biases[-1]
        displacements = biases + spec.position_noise * normals[:, 3:6]
        turns = (spec.orientation_noise * normals[:, 6:9]).tolist()
        late = [max(0, nanoseconds(s)) for s in (spec.latency + spec.jitter * normals[:, 9]).tolist()]
        yield from zip(displacements, turns, late, (uniforms < spec.dropout).tolist(), strict=True)


@dataclass(frozen=True, slots=True)
class PerfectMocap:
    """Motion capture without errors: every pose is exact, but it can still be late."""

    kind: Literal["off"] = "off"
    rate: Annotated[float, Ge(1), Le(1000), Unit("Hz"), doc("frames per second")] = 100.0
    latency: Annotated[float, Ge(0), Le(1), Unit("s"), doc("from the picture to the ground station")] = 0.0

    def start(self, rng: np.random.Generator) -> "ExactCameras":
        """Cameras for one flight."""
        return ExactCameras(self)


class ExactCameras:
    """Cameras that see the truth, in step with the control loop."""

    def __init__(self, spec: PerfectMocap) -> None:
        self._period, self._latency = nanoseconds(1.0 / spec.rate), nanoseconds(spec.latency)
        self.due = 0

    def capture(self, now: int, truth: Truth) -> Arrival | None:
        """The true pose."""
        self.due += self._period
        return Arrival(now + self._latency, Pose(now, truth.position, truth.quat_wxyz))


def rotated(quat_wxyz: Array, small_angle: Iterable[float]) -> Array:
    """Rotate an attitude (4,) by a small body-frame rotation vector (3,), rad."""
    w, x, y, z = quat_wxyz.tolist()
    a, b, c = small_angle
    a, b, c = 0.5 * a, 0.5 * b, 0.5 * c
    n = 1.0 / sqrt(1.0 + a * a + b * b + c * c)
    aw, ax = n * (w - x * a - y * b - z * c), n * (x + w * a + y * c - z * b)
    return np.array((aw, ax, n * (y + w * b + z * a - x * c), n * (z + w * c + x * b - y * a)))
