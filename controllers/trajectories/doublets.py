"""Push each axis one way and back again: the flight that shows an axis' gain, damping and delay."""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt, Le, Unit, doc

from controllers.flatness import FlatOutput
from controllers.signals import Array

SHORT = 0.6
"""Every second pair of doublets is this much quicker: two frequencies tell delay from damping."""


@dataclass(frozen=True, slots=True)
class Doublets:
    """Doublets of acceleration on any of the four axes, for identification.

    A doublet moves the helicopter from rest to rest, the opposite one brings it back; they go on for ever. The
    feed-forward of such a flight is a doublet of the inputs, and the helicopter stays inside the cameras' view, which
    it would not do in open loop. Edges are ramps, so that the flat outputs are smooth enough to fly.
    """

    kind: Literal["doublets"] = "doublets"
    x: Annotated[float, Ge(0), Unit("m/s^2"), doc("acceleration north and south; 0 leaves the axis at rest")] = 0.85
    y: Annotated[float, Ge(0), Unit("m/s^2"), doc("acceleration west and east")] = 0.85
    z: Annotated[float, Ge(0), Unit("m/s^2"), doc("acceleration upwards and downwards")] = 0.0
    yaw: Annotated[float, Ge(0), Unit("rad/s^2"), doc("acceleration of the heading")] = 0.0
    plane_pulse: Annotated[float, Gt(0), Unit("s"), doc("length of half a doublet, north and west")] = 1.9
    height_pulse: Annotated[float, Gt(0), Unit("s"), doc("length of half a doublet, upwards")] = 0.6
    yaw_pulse: Annotated[float, Gt(0), Unit("s"), doc("length of half a doublet of the heading")] = 0.4
    edge: Annotated[float, Gt(0), Le(1 / 3), Unit("1"), doc("ramps of a pulse, as a share of its length")] = 0.2
    height: Annotated[
        float, Gt(0), Unit("m"), doc("height of the centre of gravity above the floor, in the middle")
    ] = 1.0

    def flat(self, t: Array) -> FlatOutput:
        """The four trains of doublets, each about its middle."""
        axes = [
            _train(t, self.x, self.plane_pulse, self.edge),
            _train(t, self.y, self.plane_pulse, self.edge),
            _train(t, self.z, self.height_pulse, self.edge),
            _train(t, self.yaw, self.yaw_pulse, self.edge),
        ]
        z, dz, ddz = (np.stack(column, axis=-1) for column in zip(*axes, strict=True))
        return FlatOutput(z + [0.0, 0.0, self.height, 0.0], dz, ddz)


def _train(t: Array, peak: float, pulse: float, edge: float) -> tuple[Array, Array, Array]:
    """Position, speed and acceleration of one axis at the times t (n,)."""
    times, shape = [0.0], [0.0]
    for sign, width in ((1.0, pulse), (-1.0, pulse), (1.0, SHORT * pulse), (-1.0, SHORT * pulse)):
        corners = (edge, 1.0 - edge, 1.0 + edge, 2.0 - edge, 2.0)
        times += [times[-1] + width * c for c in corners]
        shape += [sign * s for s in (1.0, 1.0, -1.0, -1.0, 0.0)]
    knots, a = np.array(times), peak * np.array(shape)
    # Acceleration is linear between knots: speed and position there follow exactly.
    h, jerk = np.diff(knots), np.diff(a) / np.diff(knots)
    v = np.concatenate([[0.0], np.cumsum(h * (a[:-1] + a[1:]) / 2)])
    p = (
        np.concatenate([[0.0], np.cumsum(h * v[:-1] + h**2 * (2 * a[:-1] + a[1:]) / 6)])
        - 0.5 * peak * (1.0 - edge) * pulse**2
    )
    within = np.mod(t, knots[-1])
    i = np.clip(np.searchsorted(knots, within, side="right") - 1, 0, len(h) - 1)
    s = within - knots[i]
    return (
        p[i] + s * (v[i] + s * (a[i] / 2 + s * jerk[i] / 6)),
        v[i] + s * (a[i] + s * jerk[i] / 2),
        a[i] + s * jerk[i],
    )
