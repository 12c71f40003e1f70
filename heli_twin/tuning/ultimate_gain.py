"""Ziegler and Nichols' experiment on the twin: one axis under proportional control, at the gain where it keeps ringing.

The other axes fly with the gains they have. The air is calm, everything else is as the experiment says: radio, cameras,
estimator. A quick move excites the axis; the gain is raised until what follows grows instead of dying out, and then
narrowed down. Height has no damping of its own and no ultimate gain: it is given `DAMPING` by a derivative gain first.

Source: Ziegler and Nichols, Trans. ASME 1942.
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

DAMPING = 5.0
"""Damping that height is given first, 1/s: as much as the heading has of its own."""
RAISE = 1.4
"""Factor from one gain of the sweep to the next."""
REFINEMENTS = 4
"""Flights between the last gain that dies out and the first that grows: the gain is known within 2 %."""
LOST = 1.0
"""Growth, 1/s, of a flight that ended early or that only the limits of the input hold."""
SATURATED = 0.2
"""Share of the commands at a limit from which on that is so."""
NOISE = 0.003
"""Motion that the cameras' noise alone may show, m or rad, standard deviation."""
HIGHEST = 50.0
"""Gain at which the sweep gives up."""


class Kick(NamedTuple):
    """How an axis is excited and watched."""

    size: float
    """Of the move, m or rad."""
    move: float
    """Its duration, s."""
    watch: float
    """How long what follows is watched, s."""
    start: float
    """First gain of the sweep."""


KICKS = {
    "x": Kick(0.2, 1.0, 24.0, 1.0),
    "y": Kick(0.2, 1.0, 24.0, 1.0),
    "z": Kick(0.15, 0.6, 12.0, 1.0),
    "yaw": Kick(0.3, 0.5, 8.0, 0.7),
}


class Ultimate(NamedTuple):
    """An axis on the border between dying out and growing."""

    axis: str
    gain: float
    """Ku, stick/m or stick/rad."""
    period: float
    """Tu, s."""
    damping: float
    """Derivative gain that was there all along, stick s/m; 0 but in z."""

    def gains(self) -> tuple[float, float, float]:
        """Ziegler and Nichols' p, i, d."""
        p = 0.6 * self.gain
        return p, 2.0 * p / self.period, 0.125 * p * self.period + self.damping


class Ringing(NamedTuple):
    """What follows a move."""

    growth: float
    """1/s; below 0 it dies out."""
    period: float
    """s."""


def find_ultimate(base: Experiment, axis: str) -> Ultimate:
    """The ultimate gain of one axis.

    Args:
        base: What to fly with; its controller is a Pid.
        axis: x, y, z or yaw.

    Raises:
        HeliTwinError: The controller is no PID, or the axis does not ring at any gain.
    """
    law = base.controller
    if not isinstance(law, Pid):
        raise HeliTwinError("Ziegler and Nichols' experiment is for PID gains: fly it with controller=pid")
    damping = DAMPING / law.model.b_z if axis == "z" else 0.0

    def proportional(gain: float) -> Ringing:
        changed = {f"p_{axis}": gain, f"i_{axis}": 0.0, f"d_{axis}": damping}
        return _ringing(base, axis, replace(law, **changed))

    gain, period = border(proportional, KICKS[axis].start, f"gain of {axis}")
    return Ultimate(axis, gain, period, damping)


def border(ring: Callable[[float], Ringing], gain: float, name: str) -> tuple[float, float]:
    """The gain where growth changes its sign, and the period there."""
    low, high = gain, gain
    at_low = at_high = ring(gain)
    while at_low.growth > 0.0 and low > gain / 100.0:
        high, at_high = low, at_low
        low /= RAISE
        at_low = ring(low)
    while at_high.growth <= 0.0:
        low, at_low = high, at_high
        high *= RAISE
        if high > HIGHEST:
            raise HeliTwinError(f"the {name} has no limit below {HIGHEST:g}: this axis does not ring, tune it by hand")
        at_high = ring(high)
    for _ in range(REFINEMENTS):
        # Close to the border growth is a straight line; a saturated or lost flight is not close.
        share = float(np.clip(-at_low.growth / (at_high.growth - at_low.growth), 0.25, 0.75))
        middle = low + share * (high - low)
        found = ring(middle)
        if found.growth > 0.0:
            high, at_high = middle, found
        else:
            low, at_low = middle, found
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
        return Ringing(LOST, kick.watch)
    return ringing(result.log, axis, kick.move, law)


def ringing(log: Log, axis: str, after: float, law: Pid) -> Ringing:
    """How an axis moves about its mean from `after` (s) on, as the estimator saw it.

    Growth compares the second half with the first. A motion that sinks into the noise has died out, and one that
    only the limits of the input hold has grown.

    Args:
        log: The flight.
        axis: x, y, z or yaw.
        after: When what excited it was over, s.
        law: What flew it.
    """
    i = AXES.index(axis)
    t = 1e-9 * log.estimate.stamp.astype(np.float64)
    about, t = log.estimate.x[t > after, i], t[t > after]
    half = len(t) // 2
    first, second = (part - part.mean() for part in (about[:half], about[half:]))
    growth = float(np.log(second.std() / first.std())) / float(t[half] - t[0])
    u = log.sent.u[-half:, i]
    if np.mean((u <= law.model.u_min[i]) | (u >= law.model.u_max[i])) > SATURATED:
        growth = LOST
    elif second.std() < NOISE:
        growth = min(growth, -0.1)
    return Ringing(growth, _period(t[half:], second))


def _period(t: Array, about: Array) -> float:
    """Twice the mean time between zero crossings, s; the whole time if it hardly crosses."""
    crossings = t[1:][np.diff(np.sign(about)) != 0]
    if len(crossings) < 3:
        return float(t[-1] - t[0])
    return 2.0 * float(crossings[-1] - crossings[0]) / (len(crossings) - 1)
