"""Accelerate axes in one direction and back: a flight for identifying gain, damping and delay of each axis."""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt, Le, Unit, doc

from controllers.flatness import FlatOutput
from controllers.signals import Array

SHORT_PULSE_FACTOR = 0.7
"""Relative pulse length of every second pair of doublets: two frequencies separate delay from damping."""


@dataclass(frozen=True, slots=True)
class Doublets:
    """Doublets of acceleration, for identification: in the plane, in height and heading, or of all axes at once.

    A doublet moves the helicopter from rest to rest, the opposite doublet brings it back, and so on. It is flown in
    closed loop, with feed-forward inputs that are doublets about hover: in open loop the helicopter would leave the
    cameras' view. The edges of the pulses are ramps, so that dynamics outside the paper's model are little excited.

    The defaults stay within the believed limits: 0.8 of full stick in the plane, which leaves a reserve for gusts, and
    1.6 m to each side. A heading that turns while the plane is flown needs gentler ones there: both directions may fall
    to one stick. An acceleration of 0 holds its axis.
    """

    kind: Literal["doublets"] = "doublets"
    axes: Annotated[Literal["plane", "height_and_yaw", "all"], doc("what moves; the other axes are held")] = "plane"
    x: Annotated[float, Ge(0), Unit("m/s^2"), doc("acceleration north and south")] = 0.95
    y: Annotated[float, Ge(0), Unit("m/s^2"), doc("acceleration west and east")] = 1.0
    z: Annotated[float, Ge(0), Unit("m/s^2"), doc("acceleration upwards and downwards")] = 1.0
    yaw: Annotated[float, Ge(0), Unit("rad/s^2"), doc("acceleration of the heading")] = 11.0
    plane_pulse: Annotated[float, Gt(0), Unit("s"), doc("length of half a doublet in the plane")] = 2.05
    z_pulse: Annotated[float, Gt(0), Unit("s"), doc("length of half a doublet of the height")] = 1.0
    yaw_pulse: Annotated[float, Gt(0), Unit("s"), doc("length of half a doublet of the heading")] = 0.6
    edge: Annotated[float, Gt(0), Le(0.5), Unit("1"), doc("each ramp of a pulse, as a share of its length")] = 0.25
    height: Annotated[float, Gt(0), Unit("m"), doc("of the centre of gravity above the floor, midway")] = 1.0

    def flat(self, t: Array) -> FlatOutput:
        """Return trains of doublets about the middle of the room."""
        position, speed, acceleration, _ = self._trains(t)
        return FlatOutput(position, speed, acceleration)

    @property
    def peaks(self) -> tuple[float, float, float, float]:
        """Acceleration of x, y, z (m/s^2) and heading (rad/s^2); 0 for an axis that is held."""
        plane, others = float(self.axes != "height_and_yaw"), float(self.axes != "plane")
        return plane * self.x, plane * self.y, others * self.z, others * self.yaw

    @property
    def smoothness(self) -> int:
        """Up to the acceleration, whose slope jumps at the edges of the pulses."""
        return 2

    def derivatives(self, t: Array, highest: int) -> Array:
        """Return the flat outputs and their time derivatives: from the 4th on, they are 0."""
        known = self._trains(t)[: highest + 1]
        return np.concatenate([known, np.zeros((highest + 1 - len(known), len(t), 4))])

    def _trains(self, t: Array) -> Array:
        """Position, velocity, acceleration and jerk (4, n, 4) of all axes."""
        rest, pulses = np.zeros((4, len(t))), (self.plane_pulse, self.plane_pulse, self.z_pulse, self.yaw_pulse)
        moved = zip(self.peaks, pulses, strict=True)
        trains = np.stack([_train(t, peak, pulse, self.edge) if peak else rest for peak, pulse in moved], axis=-1)
        trains[0] = np.array([0.0, 0.0, self.height, 0.0]) + trains[0]
        return trains


def _train(t: Array, peak: float, pulse: float, edge: float) -> tuple[Array, Array, Array, Array]:
    """Position, velocity, acceleration and jerk (n,) of one axis: a pair of opposite doublets, then a shorter pair."""
    times, shape = [0.0], [0.0]
    short = SHORT_PULSE_FACTOR * pulse
    for sign, length in ((1.0, pulse), (-1.0, pulse), (1.0, short), (-1.0, short)):
        corners = (edge, 1.0 - edge, 1.0 + edge, 2.0 - edge, 2.0)
        start = times[-1]
        times += [start + length * corner for corner in corners]
        shape += [sign, sign, -sign, -sign, 0.0]
    knots, a = np.array(times), peak * np.array(shape)
    # Acceleration is linear between knots; velocity and position at the knots are its exact integrals.
    h = np.diff(knots)
    v = np.concatenate([[0.0], np.cumsum(h * (a[:-1] + a[1:]) / 2)])
    p = np.concatenate([[0.0], np.cumsum(h * v[:-1] + h**2 * (2 * a[:-1] + a[1:]) / 6)])
    p -= 0.5 * peak * (1.0 - edge) * pulse * pulse
    since = np.mod(t, knots[-1])
    i = np.minimum(np.searchsorted(knots, since, side="right") - 1, len(h) - 1)
    jerk = (np.diff(a) / np.maximum(h, 1e-12))[i]
    s = since - knots[i]
    return (
        p[i] + s * (v[i] + s * (a[i] / 2 + s * jerk / 6)),
        v[i] + s * (a[i] + s * jerk / 2),
        a[i] + s * jerk,
        jerk,
    )
