"""Ziegler and Nichols' experiment on the twin: the proportional gain at which one axis oscillates for ever.

The other axes keep their gains. The air is calm, everything else is as in the experiment: radio, cameras, estimator. A
quick move excites the axis; the gain is raised until the oscillation that follows grows instead of dying out, and the
border is then narrowed down. Height has no damping of its own, hence no ultimate gain: a derivative gain gives it
`HEIGHT_DAMPING` first.

Source: Ziegler and Nichols, Optimum settings for automatic controllers, Trans. ASME 1942.
"""

from collections.abc import Callable
from dataclasses import replace
from math import sqrt
from typing import NamedTuple

import numpy as np

from controllers.laws.pid import Pid
from controllers.signals import Array
from controllers.trajectories.waypoints import Waypoints
from heli_twin.errors import HeliTwinError
from heli_twin.experiment import Experiment
from heli_twin.metrics.tracking import AXES
from heli_twin.recording import Log

HEIGHT_DAMPING = 5.0
"""Damping that height is given first, 1/s: as much as the yaw has of its own."""
SWEEP_FACTOR = 1.4
"""Factor from one gain of the sweep to the next."""
REFINEMENTS = 4
"""Flights between the last gain that dies out and the first that grows: the gain is known within 2 %."""
FAILED_GROWTH = 1.0
"""Growth, 1/s, of a flight that ended early, or whose oscillation only the limits of the input bound."""
SATURATED_SHARE = 0.2
"""Share of commands at a limit above which the limits are taken to bound the oscillation."""
NOISE_STD = 0.003
"""Standard deviation of the motion that the cameras' noise alone can cause, m or rad."""
DEAD_GROWTH = -0.1
"""Growth, 1/s, of an oscillation that has sunk into the noise, at most."""
HIGHEST_GAIN = 50.0
"""Gain at which the sweep gives up, stick/m or stick/rad."""
LOWEST_SHARE = 0.01
"""Share of its first gain down to which the sweep looks for one that dies out."""


class Kick(NamedTuple):
    """The move that excites an axis."""

    size: float
    """m or rad."""
    move: float
    """Duration of the move, s."""
    watch: float
    """Duration of the measurement of the oscillation after the move, s."""
    start: float
    """First gain of the sweep, stick/m or stick/rad."""


KICKS = {
    "x": Kick(0.2, 1.0, 24.0, 1.0),
    "y": Kick(0.2, 1.0, 24.0, 1.0),
    "z": Kick(0.15, 0.6, 12.0, 1.0),
    "yaw": Kick(0.3, 0.5, 8.0, 0.7),
}


class Ultimate(NamedTuple):
    """An axis on the border between an oscillation that dies out and one that grows."""

    axis: str
    gain: float
    """Ku, stick/m or stick/rad."""
    period: float
    """Tu, s."""
    damping: float
    """Derivative gain that the axis had during the experiment, stick s/m; 0 except in z."""

    def gains(self) -> tuple[float, float, float]:
        """Ziegler and Nichols' p, i, d: 0.6 Ku, 1.2 Ku / Tu, 0.075 Ku Tu; the damping is added to d."""
        p = 0.6 * self.gain
        return p, 2.0 * p / self.period, 0.125 * p * self.period + self.damping


class Ringing(NamedTuple):
    """The oscillation after a move."""

    growth: float
    """1/s; negative if it dies out."""
    period: float
    """s."""


def find_ultimate(base: Experiment, axis: str) -> Ultimate:
    """The ultimate gain of one axis.

    Args:
        base: The lab to fly in; its controller is a Pid.
        axis: x, y, z or yaw.

    Raises:
        HeliTwinError: The controller is no PID, or the axis does not oscillate at any gain.
    """
    law = base.controller
    if not isinstance(law, Pid):
        raise HeliTwinError("Ziegler and Nichols' experiment is for PID gains: fly it with controller=pid")
    damping = HEIGHT_DAMPING / law.model.b_z if axis == "z" else 0.0

    def proportional(gain: float) -> Ringing:
        changed = {f"p_{axis}": gain, f"i_{axis}": 0.0, f"d_{axis}": damping}
        return _ringing(base, axis, replace(law, **changed))

    gain, period = border(proportional, KICKS[axis].start, f"gain of {axis}")
    return Ultimate(axis, gain, period, damping)


def border(ring: Callable[[float], Ringing], gain: float, name: str) -> tuple[float, float]:
    """The gain at which growth changes its sign, and the period there.

    Args:
        ring: From a gain to the oscillation with it.
        gain: Where to start.
        name: What the gain is called in messages.

    Returns:
        Gain, in the unit of `gain`, and period, s.

    Raises:
        HeliTwinError: There is no such gain below `HIGHEST_GAIN`.
    """
    low, high = gain, gain
    at_low = at_high = ring(gain)
    while at_low.growth > 0.0 and low > LOWEST_SHARE * gain:
        high, at_high = low, at_low
        low /= SWEEP_FACTOR
        at_low = ring(low)
    while at_high.growth <= 0.0:
        low, at_low = high, at_high
        high *= SWEEP_FACTOR
        if high > HIGHEST_GAIN:
            raise HeliTwinError(
                f"the {name} has no limit below {HIGHEST_GAIN:g}: this axis does not oscillate, tune it by hand"
            )
        at_high = ring(high)
    for _ in range(REFINEMENTS):
        # Near the border growth is linear in the gain; a saturated or failed flight is not near it.
        share = float(np.clip(-at_low.growth / (at_high.growth - at_low.growth), 0.25, 0.75))
        middle = low + share * (high - low)
        at_middle = ring(middle)
        if at_middle.growth > 0.0:
            high, at_high = middle, at_middle
        else:
            low, at_low = middle, at_middle
    return sqrt(low * high), at_low.period


def _ringing(base: Experiment, axis: str, law: Pid) -> Ringing:
    from heli_twin.mission import fly

    kick = KICKS[axis]
    there = np.array([0.0, 0.0, 1.0, 0.0])
    there[AXES.index(axis)] += kick.size
    x, y, z, yaw = there.tolist()
    move = Waypoints(points=((0.0, 0.0, 1.0, 0.0), (x, y, z, yaw)), times=(0.0, kick.move))
    flight = replace(base, trajectory=move, controller=law, duration=kick.move + kick.watch, disturbances=(), faults=())
    result = fly(flight, log_dir=None)
    if result.outcome.kind != "completed":
        return Ringing(FAILED_GROWTH, kick.watch)
    return ringing(result.log, axis, kick.move, law)


def ringing(log: Log, axis: str, after: float, law: Pid) -> Ringing:
    """The oscillation of an axis about its mean after a move, as the estimator saw it.

    Growth compares the standard deviation of the second half with that of the first. An oscillation that has sunk into
    the noise has died out, and one that only the limits of the input bound has grown.

    Args:
        log: The flight.
        axis: x, y, z or yaw.
        after: End of the move, s.
        law: The controller that flew it; its model says the limits of the input.
    """
    i = AXES.index(axis)
    t = 1e-9 * log.estimate.stamp.astype(np.float64)
    about, t = log.estimate.x[t > after, i], t[t > after]
    half = len(t) // 2
    first, second = (part - part.mean() for part in (about[:half], about[half:]))
    growth = float(np.log(second.std() / first.std())) / float(t[half] - t[0])
    u = log.sent.u[-half:, i]
    if np.mean((u <= law.model.u_min[i]) | (u >= law.model.u_max[i])) > SATURATED_SHARE:
        growth = FAILED_GROWTH
    elif second.std() < NOISE_STD:
        growth = min(growth, DEAD_GROWTH)
    return Ringing(growth, _period(t[half:], second))


def _period(t: Array, about: Array) -> float:
    """Twice the mean time between zero crossings, s; the whole time if there are fewer than three."""
    crossings = t[1:][np.diff(np.sign(about)) != 0]
    if len(crossings) < 3:
        return float(t[-1] - t[0])
    return 2.0 * float(crossings[-1] - crossings[0]) / (len(crossings) - 1)
