"""The helicopter in more detail: attitude, servos and lags of thrust and yaw beside the paper's (1).

On each horizontal axis, in the frame that is turned by the heading alone, with a = g times the sine of the tilt:

    velocity  v' = k v + a + gust + push
    tilt      a' = j
    jerk      j' = w^2 (b (s + trim) - a + hub_drag (k v + gust)) - 2 zeta w j
    servo     s' = (u - s) / servo_lag

upwards and in yaw:

    thrust    z'' = T - g + push,        T' = (b_z u - T) / thrust_lag
    torque    yaw'' = n + k_yaw yaw' + push,  n' = (b_yaw u - n) / yaw_lag

Gust and push are accelerations: the gust pulls through the rotor's drag and, with `hub_drag`, tilts the helicopter; the
push acts at the centre of gravity. Without lags and with a fast attitude this is (1). With `servo_play`, the input u is
that of the swashplate, which follows the sent one with play: see `controllers.servo_play`. The
speed of the servos, `servo_slew`, is a bound on the changes of the planned inputs.

Source: the paper's future work ("more detailed models"); attitude and lags as in `heli_twin/lab/plant/mujoco.py`.
"""

from dataclasses import dataclass
from functools import lru_cache
from math import ceil, inf, log2
from typing import Annotated, NamedTuple

import numpy as np
from annotated_types import Ge, Gt, Le, Unit, doc

from controllers.model import Input, Model
from controllers.signals import Array, NamedState

EXTRA_STATES = (
    *(NamedState(f"{name}_{axis}", unit) for axis in "xy" for name, unit in
      (("tilt_acceleration", "m/s^2"), ("tilt_jerk", "m/s^3"), ("servo", "full stick"))),
    NamedState("thrust_acceleration", "m/s^2"),
    NamedState("yaw_torque", "rad/s^2"),
)  # fmt: skip
"""The states beyond the eight physical ones, in the order of the state vector."""
ESTIMATED_STATES = (
    *EXTRA_STATES,
    *(NamedState(f"gust_{axis}", "m/s^2") for axis in "xy"),
    *(NamedState(f"trim_{axis}", "full stick") for axis in "xy"),
)
"""The states of an estimate beyond the eight physical ones; the gust is in the world frame."""
N_DETAILED = 8 + len(EXTRA_STATES)
"""Number of states: the eight of (1), then a j s of x, a j s of y, T and n."""


@dataclass(frozen=True, slots=True)
class DetailedModel(Model):
    """The paper's parameters, and what lies between a command and the acceleration of (1).

    The defaults are those of the twin: attitude and lags are engineering estimates, and the gust is the one that is
    fitted to the hover errors of the paper's Fig. 4.
    """

    pitch_frequency: Annotated[float, Ge(1), Le(1000), Unit("rad/s"), doc("natural frequency of pitch")] = 14.0
    # 14 rad/s times the root of Iyy / Ixx = 3.9 / 2.8.
    roll_frequency: Annotated[float, Ge(1), Le(1000), Unit("rad/s"), doc("natural frequency of roll")] = 16.5
    attitude_damping: Annotated[float, Gt(0), Le(5), Unit("1"), doc("damping ratio of pitch and roll")] = 0.5
    servo_lag: Annotated[float, Ge(1e-4), Le(1), Unit("s"), doc("time constant of the swashplate servos")] = 0.03
    thrust_lag: Annotated[float, Ge(1e-4), Le(1), Unit("s"), doc("time constant of thrust")] = 0.06
    yaw_lag: Annotated[float, Ge(1e-4), Le(1), Unit("s"), doc("time constant of the yaw torque")] = 0.005
    hub_drag: Annotated[
        float, Ge(0), Le(10), Unit("1"), doc("acceleration by tilt that one of drag brings along: drag at the hubs")
    ] = 0.0
    servo_play: Annotated[
        float, Ge(0), Le(0.5), Unit("full stick"), doc("play between the cyclic servos and the swashplate, end to end")
    ] = 0.0
    servo_slew: Annotated[
        float, Gt(0), Le(1e4), Unit("full stick / s"), doc("greatest speed of the cyclic servos; 10000: no limit")
    ] = 1e4
    gust_strength: Annotated[float, Ge(0), Le(10), Unit("m/s"), doc("standard deviation of the wind")] = 0.25
    gust_time: Annotated[float, Gt(0), Le(1000), Unit("s"), doc("time in which the wind changes")] = 0.7

    @classmethod
    def of(cls, model: Model) -> "DetailedModel":
        """Return a believed model in detail; the defaults where a paper's model does not say."""
        if isinstance(model, cls):
            return model
        return cls(**{name: getattr(model, name) for name in Model.__dataclass_fields__})

    @property
    def u_slew(self) -> Input:
        """Greatest speeds of the inputs, full stick / s: those of the cyclic servos."""
        return (self.servo_slew, self.servo_slew, inf, inf)

    @property
    def frequencies(self) -> tuple[float, float]:
        """Natural frequencies of pitch and roll, rad/s."""
        return (self.pitch_frequency, self.roll_frequency)

    @property
    def gust_acceleration(self) -> Array:
        """(2,) standard deviations of the acceleration by gusts along the nose and to port, m/s^2."""
        return self.gust_strength * np.abs([self.k_x, self.k_y])


P, V, A, J, S, GUST, TRIM, PUSH, U = range(9)
"""Columns of a horizontal axis: position, velocity, tilt, jerk, servo, gust, trim, push and input."""


class Step(NamedTuple):
    """The exact solution of one step with constant input, trim and push, gusts fading; matrices on the right."""

    plane: Array
    """(2, 6, 9) of x and y in the turned frame: P V A J S GUST after the step from all nine columns before it."""
    z: Array
    """(3, 5) height, velocity, T after the step from these, the push minus g, and the input before it."""
    yaw: Array
    """(3, 5) yaw, rate, n after the step from these, the push and the input before it."""


@lru_cache(256)
def step(model: DetailedModel, dt: float) -> Step:
    """Return the solution over `dt` seconds."""
    plane = np.zeros((2, 9, 9))
    for axis, (rates, k, b, w) in enumerate(
        zip(plane, (model.k_x, model.k_y), (model.b_x, model.b_y), model.frequencies, strict=True)
    ):
        rates[P, V] = rates[A, J] = 1.0
        rates[V, [V, A, GUST, PUSH]] = k, 1.0, 1.0, 1.0
        hub = model.hub_drag * w * w
        rates[J, [V, A, J, S, TRIM]] = hub * k, -w * w, -2.0 * model.attitude_damping * w, w * w * b, w * w * b
        rates[J, GUST] = hub
        rates[S, [S, U]] = np.array([-1.0, 1.0]) / model.servo_lag
        rates[GUST, GUST] = -1.0 / model.gust_time
        plane[axis] = exponential(rates * dt)
    z, yaw = np.zeros((5, 5)), np.zeros((5, 5))
    for rates, k, b, lag in ((z, 0.0, model.b_z, model.thrust_lag), (yaw, model.k_yaw, model.b_yaw, model.yaw_lag)):
        rates[0, 1] = rates[1, 2] = rates[1, 3] = 1.0
        rates[1, 1] = k
        rates[2, [2, 4]] = np.array([-1.0, b]) / lag
    return Step(plane[:, :6].copy(), exponential(z * dt)[:3], exponential(yaw * dt)[:3])


def exponential(M: Array) -> Array:
    """Return the matrix exponential of M (n, n): a Taylor polynomial, scaled and squared."""
    norm = float(np.abs(M).sum(axis=0).max())
    squarings = max(0, ceil(log2(norm)) + 1) if norm > 0.0 else 0
    M = M / 2.0**squarings
    eye = np.eye(len(M))
    E = eye
    for k in range(16, 0, -1):
        E = eye + M @ E / k
    for _ in range(squarings):
        E = E @ E
    return E
