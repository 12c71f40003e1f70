"""From sent commands to what servos, rotors and yaw drive do: filters of known inputs, without a nuisance.

The lag of MuJoCo's `filterexact` is exact for an input that is held over a step, and the force of a step sees the lag's
newest value, so that a linear filter is the whole of it. The battery's voltage follows from the thrust alone.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from controllers.model import GRAVITY
from controllers.signals import Array
from heli_twin.calibration.data import STEP_S, Flight
from heli_twin.calibration.parameters import BATTERY_VOLTAGE_V, INDEX, values
from heli_twin.lab.plant.effects import PERIOD_NS
from heli_twin.lab.plant.effects.battery import CHARGES, OPEN_VOLTAGES_V

THRUST_EXPONENT, CURRENT_EXPONENT = 1.6, 1.5
"""Of the voltage in the thrust, and of the thrust in the current: see the plant effect `battery`."""


class Drive(NamedTuple):
    """Forces and moments of the actuators at every step of a flight, for one vector of parameters."""

    pitch: Array
    """(steps,) swashplate, full stick."""
    roll: Array
    thrust: Array
    """(steps,) thrust per mass, m/s^2, far from the floor."""
    yaw: Array


def drives_of(flight: Flight, variants: Sequence[Array], phases: Sequence[float | None]) -> list[Drive]:
    """Return what a flight's commands make the actuators do.

    Args:
        flight: With its commands.
        variants: Some vectors (n,) of the fit.
        phases: Of the radio's frames in each; None if they are unknown.
    """
    each = [values(theta) for theta in variants]
    inputs: dict[tuple[float, float | None], Array] = {}
    t: Array = flight.origin + STEP_S * np.arange(flight.steps, dtype=np.float64)
    for p, phase in zip(each, phases, strict=True):
        way = float(p[INDEX["delay"]]) + GRID_S, phase
        if way not in inputs:
            inputs[way] = flight.sent.acting(way[0], t, phase)
    cyclic = _Servos(flight, each, phases) if max(map(sum, map(_play_of, each))) > 0.0 else None
    return [
        _drive(inputs[float(p[INDEX["delay"]]) + GRID_S, phase], p, cyclic.swashplate(p, phase) if cyclic else None)
        for p, phase in zip(each, phases, strict=True)
    ]


GRID_S = 0.5 * STEP_S
"""The twin takes an input over at the next physics step: half a step later on the average, with any radio."""


def _play_of(p: Array) -> tuple[float, float]:
    """Backlash and slowness."""
    return max(float(p[INDEX["servo_backlash"]]), 0.0), max(float(p[INDEX["servo_slowness"]]), 0.0)


def _drive(u: Array, p: Array, swashplate: Array | None) -> Drive:
    cyclic = u[:, :2] if swashplate is None else swashplate
    servo, rotor, yaw = (float(p[INDEX[name]]) for name in ("servo_lag", "thrust_lag", "yaw_lag"))
    throttle = _lagged(u[:, 2], rotor)
    gain = float(p[INDEX["thrust_per_mass"]])
    drain, droop = float(p[INDEX["battery_drain"]]), float(p[INDEX["battery_droop"]])
    thrust = gain * throttle * _battery(gain * throttle / GRAVITY, drain, droop)
    return Drive(_lagged(cyclic[:, 0], servo), _lagged(cyclic[:, 1], servo), thrust, _lagged(u[:, 3], yaw))


class _Servos:
    """The swashplate of one flight.

    A servo that moves at limited speed, and a linkage with play, do not follow the average of their inputs: where the
    phase of the radio's frames is unknown, their path is found for some, and then averaged.
    """

    def __init__(self, flight: Flight, variants: Sequence[Array], phases: Sequence[float | None]) -> None:
        self._delay, self._phase = float(variants[0][INDEX["delay"]]), phases[0]
        self._t = flight.origin + STEP_S * (np.arange(flight.steps) + 0.5)
        sent, least = flight.sent, self._delay + GRID_S - 0.5 * flight.sent.frame
        # The inputs in the middle of each step stand for it: those at its beginning would be half a step late.
        times = flight.origin + SERVO_STEP_S * (np.arange(flight.steps * STEP_S // SERVO_STEP_S + 2) + 0.5)
        if not sent.frame:
            u = sent.held.at(times[:, None] - least)
        elif self._phase is not None:
            u = sent.frames(least, times, self._phase).at(times[:, None])
        else:
            wait = np.mod(times[:, None] - sent.frame * (np.arange(PHASES) + 0.5) / PHASES, sent.frame)
            u = sent.held.at(times[:, None] - least - wait)
        self._plays = list(dict.fromkeys(map(_play_of, variants)))
        self._paths = _swashplates(u[..., :2], np.array(self._plays))
        self._times = times

    def swashplate(self, p: Array, phase: float | None) -> Array:
        """Return its mean path (steps, 2) before the lag; a later frame, or a longer delay, moves the whole path."""
        path = self._paths[:, self._plays.index(_play_of(p))]
        later = float(p[INDEX["delay"]]) - self._delay
        if self._phase is not None and phase is not None:
            later = phase - self._phase
        return np.column_stack([np.interp(self._t - later, self._times, axis) for axis in path.T])


def _swashplates(u: Array, plays: Array) -> Array:
    """Servo and linkage as the plant effect `servo` has them: it moves once a period, and at a new command.

    Args:
        u: (n, phases, 2) commands that act, every `SERVO_STEP_S`.
        plays: (v, 2) backlash and slowness.

    Returns:
        (n, v, 2) path, the mean over the phases.
    """
    half = 0.5 * plays[:, 0, None, None]
    travel = SERVO_PERIOD_S / np.maximum(plays[:, 1, None, None], 1e-9)
    out = np.empty((len(u), len(plays), 2))
    servo = plate = np.broadcast_to(u[0], (len(plays), *u[0].shape))
    low = high = servo
    for k, now in enumerate(u):
        if k % SERVO_PERIOD_STEPS == 0:
            # A command that comes with the period's end still uses what is left of its travel.
            servo = np.minimum(np.maximum(now, low), high)
            low, high = servo - travel, servo + travel
        servo = np.minimum(np.maximum(now, low), high)
        plate = np.minimum(np.maximum(plate, servo - half), servo + half)
        out[k] = plate.sum(axis=1)
    return out / u.shape[1]


SERVO_STEP_S, SERVO_PERIOD_S = 0.002, 1e-9 * PERIOD_NS
SERVO_PERIOD_STEPS = round(SERVO_PERIOD_S / SERVO_STEP_S)
PHASES = 11
"""Phases of the radio's frames over which the swashplate is averaged."""


def _lagged(u: Array, lag: float) -> Array:
    """A first-order lag (s) of an input (n,) that is held over each step, at the end of the step."""
    keep = np.exp(-STEP_S / lag)
    return np.asarray(lfilter([1.0 - keep], [1.0, -keep], u, zi=[keep * u[0]])[0])


def _battery(load: Array, drain: float, droop: float) -> Array:
    """Thrust (n,) as a share of that of a full battery in hover, if the thrust were `load` (n,) times the weight.

    As in the plant effect, the voltage of a period of `PERIOD_NS` follows from the thrust at its beginning.
    """
    if drain == 0.0 and droop == 0.0:
        return np.ones_like(load)
    count = -(-len(load) // BATTERY_STEPS)
    at = load[np.maximum(BATTERY_STEPS * np.arange(count) - 1, 0)]
    factor = np.ones(count)
    # The current depends on the thrust, which depends on the last voltage: a contraction by 0.14.
    for _ in range(5):
        power = np.maximum(at * np.concatenate([factor[:1], factor[:-1]]), 0.0) ** CURRENT_EXPONENT
        used = drain * BATTERY_STEPS * STEP_S * (np.cumsum(power) - power)
        lost = OPEN_VOLTAGES_V[-1] - np.interp(1.0 - used, CHARGES, OPEN_VOLTAGES_V)
        # Linear beyond a full cell: a drain may come out negative.
        lost += np.minimum(used, 0.0) * _SLOPE_V
        factor = np.maximum(1.0 - lost / BATTERY_VOLTAGE_V - droop * (power - 1.0), 0.1) ** THRUST_EXPONENT
    return np.repeat(factor, BATTERY_STEPS)[: len(load)]


BATTERY_STEPS = round(1e-9 * PERIOD_NS / STEP_S)
_SLOPE_V = (OPEN_VOLTAGES_V[-1] - OPEN_VOLTAGES_V[-2]) / (CHARGES[-1] - CHARGES[-2])
