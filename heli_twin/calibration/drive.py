"""From sent commands to what servos, rotors and yaw drive do: filters of known inputs, without a nuisance.

The lag of MuJoCo's `filterexact` is exact for an input that is held over a step, and the force of a step sees the lag's
newest value, so that a linear filter is the whole of it. The battery's voltage follows from the thrust alone.
"""

from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from controllers.model import GRAVITY
from controllers.signals import Array
from heli_twin.calibration.data import STEP_S, Flight
from heli_twin.calibration.parameters import BATTERY_VOLTAGE_V, INDEX, values
from heli_twin.lab.plant.effects.battery import CHARGES, OPEN_VOLTAGES_V

THRUST_EXPONENT, CURRENT_EXPONENT = 1.6, 1.5
"""Of the voltage in the thrust, and of the thrust in the current: see the plant effect `battery`."""


class Drive(NamedTuple):
    """What moves the helicopter at every step of a flight, for one vector of parameters."""

    pitch: Array
    """(steps,) swashplate, full stick."""
    roll: Array
    thrust: Array
    """(steps,) thrust per mass, m/s^2, far from the floor."""
    yaw: Array


def drive_of(flight: Flight, theta: Array) -> Drive:
    """Return what a flight's commands make the actuators do.

    Args:
        flight: With its commands.
        theta: (n,) the fit's vector.
    """
    p = values(theta)
    t = flight.origin + STEP_S * np.arange(flight.steps)
    u = flight.sent.acting(float(p[INDEX["delay"]]), t)
    servo, rotor, yaw = (float(p[INDEX[name]]) for name in ("servo_lag", "thrust_lag", "yaw_lag"))
    throttle = _lagged(u[:, 2], rotor)
    gain = float(p[INDEX["thrust_per_mass"]])
    drain, droop = float(p[INDEX["battery_drain"]]), float(p[INDEX["battery_droop"]])
    thrust = gain * throttle * _battery(gain * throttle / GRAVITY, drain, droop)
    return Drive(_lagged(u[:, 0], servo), _lagged(u[:, 1], servo), thrust, _lagged(u[:, 3], yaw))


def _lagged(u: Array, lag: float) -> Array:
    """A first-order lag (s) of an input (n,) that is held over each step, at the end of the step."""
    keep = np.exp(-STEP_S / lag)
    return np.asarray(lfilter([1.0 - keep], [1.0, -keep], u, zi=[keep * u[0]])[0])


def _battery(load: Array, drain: float, droop: float) -> Array:
    """Thrust (n,) as a share of that of a full battery in hover, if the thrust were `load` (n,) times the weight."""
    factor = np.ones_like(load)
    if drain == 0.0 and droop == 0.0:
        return factor
    # The current depends on the thrust, which depends on the voltage: a contraction by 0.14.
    for _ in range(4):
        power = np.maximum(load * factor, 0.0) ** CURRENT_EXPONENT
        # Linear beyond a full cell: a drain may come out negative.
        used = drain * STEP_S * np.cumsum(power)
        lost = OPEN_VOLTAGES_V[-1] - np.interp(1.0 - used, CHARGES, OPEN_VOLTAGES_V)
        lost += np.minimum(used, 0.0) * _SLOPE_V
        factor = np.maximum(1.0 - lost / BATTERY_VOLTAGE_V - droop * (power - 1.0), 0.1) ** THRUST_EXPONENT
    return factor


_SLOPE_V = (OPEN_VOLTAGES_V[-1] - OPEN_VOLTAGES_V[-2]) / (CHARGES[-1] - CHARGES[-2])
