"""The twin running beside a helicopter in flight: how far poses leave what the twin expects, pose by pose.

The detailed filter runs with the calibrated model. If the helicopter is as it was, its innovations are white with the
variance that it states, and the push, trim and torque that it has to assume stay where they were. A change of the
helicopter is seen in one or the other: a jump in the innovations, before the filter has got used to it, and what is
slow or lasts in what the filter assumes.

Source: Mehra and Peschon, Automatica 7 (1971) (innovations as the sign of a fault).
"""

from dataclasses import dataclass
from math import exp
from typing import NamedTuple

import numpy as np

from controllers.detailed_model import ESTIMATED_STATES, DetailedModel
from controllers.estimators.detailed_kalman import DetailedKalman
from controllers.markers import by_name
from controllers.model import GRAVITY
from controllers.signals import Array, Pose
from heli_twin.calibration.parameters import helicopter
from heli_twin.experiment import Experiment
from heli_twin.identification.data import MIN_HEIGHT_M
from heli_twin.lab.plant.effects.battery import BatterySpec, open_voltage

MEAN_TIME_S = 1.0
"""Time over which squares of innovations, and what the filter assumes, are averaged."""
SETTLING_S = 3.0
"""From the first pose: the filter finds the day's push and trim."""
LEARNING_S = 3.0
"""After that: what it assumes then is normal for this flight."""
STATISTICS = ("x", "y", "z", "yaw", "pitch", "roll", "thrust", "torque", "pitch_trim", "roll_trim")
"""Mean squares of normalised innovations of the first six, then how far the filter's assumptions have moved: share of
the weight, rad/s^2, full stick."""
_TRIM_X = [state.name for state in ESTIMATED_STATES].index("trim_x")


class Watched(NamedTuple):
    """The statistics at one pose."""

    time: int
    """Capture time of the pose, ns."""
    values: Array
    """(10,) in the order of `STATISTICS`; the last four are NaN until they are learned."""


@dataclass
class _Battery:
    """The calibrated battery: the share of the full thrust that it gives, from the commands alone."""

    spec: BatterySpec | None
    lift: float
    """Thrust at full stick by the weight."""
    factor: float = 1.0
    used: float = 0.0

    def throttle(self, u: float, seconds: float) -> float:
        """Return the throttle of a full battery that gives the same thrust, for a command that is held."""
        if self.spec is None:
            return u
        spec = self.spec
        current = spec.idle_current + spec.hover_current * max(self.lift * u * self.factor, 0.0) ** 1.5
        nominal = open_voltage(1.0) - spec.resistance * (spec.idle_current + spec.hover_current)
        voltage = max(open_voltage(max(spec.charge - self.used, 0.0)) - spec.resistance * current, 0.0)
        self.factor = (voltage / max(nominal, 1.0)) ** 1.6
        self.used += current * seconds / (3600.0 * spec.capacity)
        return u * self.factor


class Watch:
    """The filter of one flight, and the statistics of its innovations.

    Args:
        experiment: Of a calibration: what a detailed law and estimator believe, and the helicopter's battery.
    """

    def __init__(self, experiment: Experiment) -> None:
        estimator = experiment.estimator
        spec = estimator if isinstance(estimator, DetailedKalman) else DetailedKalman()
        self._filter = spec.start(DetailedModel.of(experiment.controller.model))
        plant = helicopter(experiment)
        battery = next((e for e in by_name(plant.effects).values() if isinstance(e, BatterySpec)), None)
        self._battery = _Battery(battery, plant.thrust_gain / (plant.mass * GRAVITY))
        self._levels = int(getattr(experiment.radio, "levels", 0))
        self._mean = np.ones(6)
        self._assumed = np.zeros(4)
        self._learned: tuple[int, Array] = (0, np.zeros(4))
        self._began = self._last = self._sent = -1

    def command(self, time: int, u: Array) -> None:
        """Take a command (4,) that was sent at `time` (ns)."""
        u = np.clip(u, (-1.0, -1.0, 0.0, -1.0), 1.0)
        if self._levels:
            u = np.round(u * (0.5 * self._levels)) / (0.5 * self._levels)
        u[2] = self._battery.throttle(float(u[2]), 1e-9 * (time - self._sent) if self._sent >= 0 else 0.0)
        self._sent = time
        self._filter.command_sent(time, u)

    def pose(self, arrival: int, pose: Pose) -> Watched | None:
        """Take a pose that arrived at `arrival` (ns); None for one that says nothing."""
        if pose.position[2] < MIN_HEIGHT_M or (self._began >= 0 and pose.stamp - self._last > 1e9 * LONGEST_GAP_S):
            # On the floor, and after a gap, the filter has to find itself again.
            self._began = -1
        self._filter.receive(arrival, pose)
        innovation, tilt = self._filter.innovation, self._filter.tilt_innovation
        if innovation is None:
            return None
        if self._began < 0:
            self._began = self._last = pose.stamp
            self._mean, self._learned = np.ones(6), (0, np.zeros(4))
        squares = innovation[0] ** 2 / innovation[1]
        share = 1.0 - exp(-1e-9 * max(pose.stamp - self._last, 0) / MEAN_TIME_S)
        self._last = max(pose.stamp, self._last)
        self._mean[:4] += share * (np.minimum(squares, HARDEST) - self._mean[:4])
        if tilt is not None:
            self._mean[4:] += share * (np.minimum(tilt[0] ** 2 / tilt[1], HARDEST) - self._mean[4:])
        return Watched(pose.stamp, np.concatenate([self._settled(), self._moved(pose.stamp, share)]))

    def _settled(self) -> Array:
        return self._mean.copy() if self._last - self._began > 1e9 * SETTLING_S else np.full(6, np.nan)

    def _moved(self, now: int, share: float) -> Array:
        """How far the filter's assumptions (4,) have moved from what was normal in this flight."""
        estimate = self._filter.estimate(now)
        assert estimate is not None
        trim = estimate.extra[_TRIM_X : _TRIM_X + 2]
        assumed = np.array([estimate.disturbance[2] / GRAVITY, estimate.disturbance[3], *trim])
        since = 1e-9 * (now - self._began)
        if since < SETTLING_S:
            self._assumed = assumed
            return np.full(4, np.nan)
        self._assumed = self._assumed + share * (assumed - self._assumed)
        count, mean = self._learned
        if since < SETTLING_S + LEARNING_S:
            self._learned = count + 1, mean + (assumed - mean) / (count + 1)
            return np.full(4, np.nan)
        return self._assumed - mean


LONGEST_GAP_S = 0.5
"""Between two poses."""
HARDEST = 100.0
"""Square of a normalised innovation that a single pose may count: a swapped marker is no change of the helicopter."""
