"""From sent commands to what servos, rotors and yaw drive do: filters of known inputs, without a nuisance.

The lag of MuJoCo's `filterexact` is exact for an input that is held over a step, and the force of a step sees the lag's
newest value, so that a linear filter is the whole of it. The battery's voltage follows from the thrust alone.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from controllers.model import GRAVITY
from controllers.signals import Array
from heli_twin.calibration.data import STEP_S, Doubt, Flight, Held
from heli_twin.calibration.parameters import BATTERY_VOLTAGE_V, INDEX, values
from heli_twin.lab.plant.effects import PERIOD_NS
from heli_twin.lab.plant.effects.battery import CHARGES, OPEN_VOLTAGES_V, BatterySpec

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


class Frames(NamedTuple):
    """The frames of a radio."""

    phase: float | None
    """When the input of one of them acts, s; None if it is unknown."""
    doubt: Doubt | None
    """Those that carry more of another command."""


def drives_of(
    flight: Flight,
    variants: Sequence[Array],
    phases: Sequence[float | None],
    servo: Sequence[float] | None = None,
    doubts: Sequence[Doubt | None] | None = None,
) -> list[Drive]:
    """Return what a flight's commands make the actuators do.

    Args:
        flight: With its commands.
        variants: Some vectors (n,) of the fit.
        phases: Of the radio's frames in each; None if they are unknown.
        servo: When a period of the servos begins in each, after `phases` (or, if unknown, after the delay), s.
        doubts: Frames that carry more of another command in each.
    """
    each, begins = [values(theta) for theta in variants], servo or [0.0] * len(variants)
    frames = [Frames(*which) for which in zip(phases, doubts or [None] * len(variants), strict=True)]
    inputs: dict[tuple[float, Frames], Array] = {}
    t: Array = flight.origin + STEP_S * np.arange(flight.steps, dtype=np.float64)
    for p, which in zip(each, frames, strict=True):
        way = float(p[INDEX["delay"]]) + GRID_S, which
        if way not in inputs:
            inputs[way] = flight.sent.acting(way[0], t, *which)
    cyclic = _Servos(flight) if max(map(sum, map(_play_of, each))) > 0.0 else None
    return [
        _drive(
            inputs[float(p[INDEX["delay"]]) + GRID_S, which], p, cyclic.swashplate(p, which, begin) if cyclic else None
        )
        for p, which, begin in zip(each, frames, begins, strict=True)
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

    Servo and linkage move as the plant effect `servo` has them: by a limited way in each period, at its beginning and
    at a new command. Where the radio's frames are unknown, commands are taken without their wait, and the path is
    smoothed over it.
    """

    def __init__(self, flight: Flight) -> None:
        self._sent = flight.sent
        self._edges: Array = flight.origin + STEP_S * np.arange(flight.steps + 1, dtype=np.float64)
        self._events: dict[object, tuple[float, _Events]] = {}
        self._paths: dict[object, Held] = {}

    def swashplate(self, p: Array, frames: Frames, begin: float) -> Array:
        """Return its mean path (steps, 2) before the lag."""
        wait, play = self._sent.frame, _play_of(p)
        least = float(p[INDEX["delay"]]) + GRID_S - 0.5 * wait
        # Frames that carry the same commands move the swashplate alike, sooner or later.
        key = begin, None if frames.phase is None else round(frames.phase - least, 9), frames.doubt
        if key not in self._events:
            self._events[key] = least, self._events_of(least, frames, begin)
        began, events = self._events[key]
        if (key, play) not in self._paths:
            self._paths[key, play] = Held(events.times, _swashplate(events.u, events.is_period, *play))
        path, edges = self._paths[key, play], self._edges - (least - began)
        if frames.phase is not None or not wait:
            return np.diff(path.integral(edges), axis=0) / STEP_S
        twice = path.double_integral(edges) - path.double_integral(edges - wait)
        return np.diff(twice, axis=0) / (STEP_S * wait)

    def _events_of(self, least: float, frames: Frames, begin: float) -> "_Events":
        """Return the new commands and the begins of the servos' periods, in the order of time."""
        if frames.phase is None:
            t, u, anchor = self._sent.t + least, self._sent.u, least
        else:
            held = self._sent.frames(least, self._edges, frames.phase, frames.doubt)
            t, u, anchor = held.t[:-1], held.u, frames.phase
        first, last = (np.ceil((edge - begin - anchor) / SERVO_PERIOD_S) for edge in (t[0], t[-1]))
        periods = anchor + begin + SERVO_PERIOD_S * np.arange(first, last)
        times = np.concatenate([t, periods])
        # A command that comes with the period's end still uses what is left of its travel.
        is_period = np.arange(len(times)) >= len(t)
        order = np.lexsort((is_period, np.round(times, 6)))
        times, is_period = times[order], is_period[order]
        return _Events(times, u[np.cumsum(~is_period) - 1, :2], is_period)


class _Events(NamedTuple):
    """New commands, and begins of the servos' periods."""

    times: Array
    """(n,) s."""
    u: Array
    """(n, 2) command from each on."""
    is_period: NDArray[np.bool_]
    """(n,) whether a period begins."""


def _swashplate(u: Array, is_period: NDArray[np.bool_], backlash: float, slowness: float) -> Array:
    """Return the path (n, 2) of both servos and their linkages at events."""
    periods = is_period.tolist()
    return np.array([_path(axis, periods, backlash, slowness) for axis in u.T.tolist()]).T


def _path(commands: list[float], is_period: list[bool], backlash: float, slowness: float) -> list[float]:
    """One servo and its linkage; a loop over numbers, which are faster than small arrays."""
    half, travel = 0.5 * backlash, SERVO_PERIOD_S / max(slowness, 1e-9)
    servo = plate = commands[0]
    low, high = servo - travel, servo + travel
    path: list[float] = []
    for now, begins in zip(commands, is_period, strict=True):
        if begins:
            low, high = servo - travel, servo + travel
        servo = low if now < low else high if now > high else now
        if plate < servo - half:
            plate = servo - half
        elif plate > servo + half:
            plate = servo + half
        path.append(plate)
    return path


SERVO_PERIOD_S = 1e-9 * PERIOD_NS


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
    # The voltage of the full cell in hover, which its resistance lessens.
    hover = OPEN_VOLTAGES_V[-1] - BATTERY_VOLTAGE_V * droop / (1.0 - IDLE_SHARE)
    droop *= BATTERY_VOLTAGE_V / hover
    factor = np.ones(count)
    # The current depends on the thrust, which depends on the last voltage: a contraction by 0.14.
    for _ in range(5):
        power = np.maximum(at * np.concatenate([factor[:1], factor[:-1]]), 0.0) ** CURRENT_EXPONENT
        taken = IDLE_SHARE + (1.0 - IDLE_SHARE) * power
        used = drain * BATTERY_STEPS * STEP_S * (np.cumsum(taken) - taken)
        lost = OPEN_VOLTAGES_V[-1] - np.interp(1.0 - used, CHARGES, OPEN_VOLTAGES_V)
        # Linear beyond a full cell: a drain may come out negative.
        lost += np.minimum(used, 0.0) * _SLOPE_V
        factor = np.maximum(1.0 - lost / hover - droop * (power - 1.0), 0.1) ** THRUST_EXPONENT
    return np.repeat(factor, BATTERY_STEPS)[: len(load)]


IDLE_SHARE = BatterySpec().idle_current / (BatterySpec().idle_current + BatterySpec().hover_current)
"""Of electronics and servos in the current of hovering."""
BATTERY_STEPS = round(1e-9 * PERIOD_NS / STEP_S)
_SLOPE_V = (OPEN_VOLTAGES_V[-1] - OPEN_VOLTAGES_V[-2]) / (CHARGES[-1] - CHARGES[-2])
