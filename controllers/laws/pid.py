"""The paper's baseline: one PID controller per axis, as its users know it."""

from dataclasses import dataclass, field
from math import cos, pi, sin
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Le, Unit, doc

from controllers.laws import safe_hover
from controllers.model import Model
from controllers.signals import Array, Command, Estimate, Reference


@dataclass(frozen=True, slots=True)
class Pid:
    """Four PID controllers, x y z yaw, on the errors as the helicopter sees them.

    The position error is turned to the heading, so that pitch answers for ahead and roll for port; hovering thrust is
    fed forward; the derivative acts on the estimated velocity, not on the reference's steps; the integrals live in the
    room, where a steady push stays put while the helicopter turns, and stop while their input is at its limit.

    The gains began as Ziegler and Nichols' on the twin and were scaled by hand while that lowered (26) on steps under
    gusts: a step overshoots by about a tenth, and the gains of an axis can be doubled before it oscillates.
    `heli-twin tune pid` finds bolder ones: between way-points they err a sixth less, in hover as much in place and
    twice as much in heading. Both beat Ziegler and Nichols' own by far.
    """

    kind: Literal["pid"] = "pid"
    period: Annotated[float, Ge(0.001), Le(0.2), Unit("s"), doc("control period")] = 0.02
    feed_forward: Annotated[
        Literal["none", "flat"], doc("feedback only, as in the paper, or with the planned inputs and velocities")
    ] = "none"
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
        """It looks at the reference of now alone."""
        return 1

    def start(self) -> "PidController":
        """A controller for one flight."""
        return PidController(self)


class PidController:
    """One flight's PID: the integrals."""

    def __init__(self, spec: Pid) -> None:
        self._spec = spec
        self._p = np.array([spec.p_x, spec.p_y, spec.p_z, spec.p_yaw])
        self._i = np.array([spec.i_x, spec.i_y, spec.i_z, spec.i_yaw])
        self._d = np.array([spec.d_x, spec.d_y, spec.d_z, spec.d_yaw])
        self._low, self._high = np.array(spec.model.u_min), np.array(spec.model.u_max)
        self._hover = np.array(spec.model.u_hover)
        self._integral = np.zeros(4)
        """World, m s and rad s."""

    def step(self, now: int, estimate: Estimate, reference: Reference) -> Command:
        """Answer the errors of this moment, within the limits on the inputs."""
        x, x_ref = estimate.x, reference.x[0]
        if not np.isfinite(x).all():
            return safe_hover(self._spec.model, now)
        error = _turned(x_ref[:4] - x[:4], -x[3])
        error[3] = (error[3] + pi) % (2.0 * pi) - pi
        u, velocity_error = self._hover, -x[4:]
        if self._spec.feed_forward == "flat":
            # Seen from where the nose points, not from where it should.
            u, velocity_error = reference.u[0], _turned(x_ref[4:], x_ref[3] - x[3]) - x[4:]
        integral = _turned(self._integral, -x[3])
        u = u + self._p * error + self._i * integral + self._d * velocity_error
        # At a limit, an integral may only help to come off it.
        stuck = ((u >= self._high) & (error > 0.0)) | ((u <= self._low) & (error < 0.0))
        self._integral += _turned(np.where(stuck, 0.0, self._spec.period * error), x[3])
        return Command(now, np.clip(u, self._low, self._high))

    def explain(self, command: Command) -> Command:
        """It does not look ahead."""
        return command


def _turned(v: Array, angle: float) -> Array:
    """A vector x y z yaw turned about the vertical by an angle, rad."""
    c, s = cos(angle), sin(angle)
    return np.array([c * v[0] - s * v[1], s * v[0] + c * v[1], v[2], v[3]])
