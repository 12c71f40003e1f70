"""The paper's baseline: one PID controller per axis."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import cos, isfinite, sin
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Le, Unit, doc

from controllers.fallback import safe_hover
from controllers.model import Model
from controllers.rotations import wrap_angle
from controllers.signals import Command, Estimate, Reference

Four = tuple[float, float, float, float]
"""x y z yaw."""


@dataclass(frozen=True, slots=True)
class Pid:
    """Four PID controllers, x y z yaw, on the errors in the body frame.

    The position error is rotated to the body frame, so that pitch corrects the error ahead and roll the error to port.
    The hover thrust is fed forward. The derivative acts on the estimated velocity, so that a step of the reference
    gives no peak; `derivative = "error"` lets it act on the error's rate instead, so that a moving reference is not
    braked. The paper does not say which of the two it flew. The integrals are kept in the world frame, where a steady
    push is constant while the helicopter turns; each stops while its input is at its limit.

    The gains began as those of Ziegler and Nichols on the twin and were scaled by hand while that lowered (26) on steps
    under gusts: a step overshoots by about a tenth, and the gains of an axis can be doubled before it oscillates.
    `heli-twin tune pid` finds higher gains: their errors are a sixth smaller between way-points, equal in position and
    twice as large in heading in hover. Both are far better than the gains of Ziegler and Nichols.
    """

    kind: Literal["pid"] = "pid"
    period: Annotated[float, Ge(0.001), Le(0.2), Unit("s"), doc("control period")] = 0.02
    feed_forward: Annotated[
        Literal["none", "flat"], doc("feedback only, as in the paper, or with the planned inputs and velocities")
    ] = "none"
    derivative: Annotated[
        Literal["velocity", "error"],
        doc("of the measurement alone, or of the error; with feed_forward always of the error"),
    ] = "velocity"
    p_x: Annotated[float, Ge(0), Unit("stick/m"), doc("ahead, proportional")] = 3.5
    i_x: Annotated[float, Ge(0), Unit("stick/(m s)"), doc("ahead, integral")] = 0.7
    d_x: Annotated[float, Ge(0), Unit("stick s/m"), doc("ahead, derivative")] = 2.1
    p_y: Annotated[float, Ge(0), Unit("stick/m"), doc("to port, proportional")] = 3.5
    i_y: Annotated[float, Ge(0), Unit("stick/(m s)"), doc("to port, integral")] = 0.7
    d_y: Annotated[float, Ge(0), Unit("stick s/m"), doc("to port, derivative")] = 2.3
    p_z: Annotated[float, Ge(0), Unit("stick/m"), doc("upwards, proportional")] = 1.0
    i_z: Annotated[float, Ge(0), Unit("stick/(m s)"), doc("upwards, integral")] = 0.2
    d_z: Annotated[float, Ge(0), Unit("stick s/m"), doc("upwards, derivative")] = 0.65
    p_yaw: Annotated[float, Ge(0), Unit("stick/rad"), doc("heading, proportional")] = 0.39
    i_yaw: Annotated[float, Ge(0), Unit("stick/(rad s)"), doc("heading, integral")] = 0.12
    d_yaw: Annotated[float, Ge(0), Unit("stick s/rad"), doc("heading, derivative")] = 0.156
    model: Annotated[Model, doc("the helicopter as the controller believes it")] = field(default_factory=Model)

    @property
    def steps(self) -> int:
        """One: only the current reference is used."""
        return 1

    def start(self) -> "PidController":
        """Return a controller for one flight."""
        return PidController(self)


class PidController:
    """The PID controllers of one flight, with their integrals."""

    def __init__(self, spec: Pid) -> None:
        self._spec = spec
        # Proportional, integral and derivative gain and limits of each axis.
        p = (spec.p_x, spec.p_y, spec.p_z, spec.p_yaw)
        i = (spec.i_x, spec.i_y, spec.i_z, spec.i_yaw)
        d = (spec.d_x, spec.d_y, spec.d_z, spec.d_yaw)
        self._axes = [*zip(p, i, d, spec.model.u_min, spec.model.u_max, strict=True)]
        self._integral = (0.0, 0.0, 0.0, 0.0)
        """World, m s and rad s."""

    def step(self, now: int, estimate: Estimate, reference: Reference) -> Command:
        """Return the inputs for the current errors, clipped to the input limits.

        On Python floats, since NumPy takes three times as long for four.
        """
        spec, state = self._spec, estimate.x.tolist()
        if not all(map(isfinite, state)):
            return safe_hover(spec.model, now)
        x, y, z, yaw, *velocity = state
        x_ref, y_ref, z_ref, yaw_ref, *velocity_ref = reference.x[0].tolist()
        error = _rotated((x_ref - x, y_ref - y, z_ref - z, yaw_ref - yaw), -yaw)
        error = (*error[:3], wrap_angle(error[3]))
        feed_forward, wanted = spec.model.u_hover, [0.0, 0.0, 0.0, 0.0]
        if spec.feed_forward == "flat" or spec.derivative == "error":
            # The planned velocity in the body frame of the estimated yaw, not of the planned yaw.
            wanted = _rotated(velocity_ref, yaw_ref - yaw)
        if spec.feed_forward == "flat":
            feed_forward = reference.u[0].tolist()
        u: list[float] = []
        growth: list[float] = []
        integral = _rotated(self._integral, -yaw)
        columns = zip(self._axes, feed_forward, error, integral, wanted, velocity, strict=True)
        for (p, i, d, low, high), planned, e, sum_of_e, v_ref, v in columns:
            value = planned + p * e + i * sum_of_e + d * (v_ref - v)
            # At a limit, an integral may only change in the direction that leaves the limit.
            stuck = (value >= high and e > 0.0) or (value <= low and e < 0.0)
            growth.append(0.0 if stuck else spec.period * e)
            u.append(min(max(value, low), high))
        grown = zip(self._integral, _rotated(growth, yaw), strict=True)
        self._integral = (*[before + more for before, more in grown],)
        return Command(now, np.array(u))

    def explain(self, command: Command) -> Command:
        """Return the command unchanged: a PID has no plan."""
        return command


def _rotated(v: Sequence[float], angle: float) -> Four:
    """Rotate a vector x y z yaw about the vertical axis by an angle, rad."""
    c, s = cos(angle), sin(angle)
    return (c * v[0] - s * v[1], s * v[0] + c * v[1], v[2], v[3])
