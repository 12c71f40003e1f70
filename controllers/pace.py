"""Time scaling of a planned flight: clocks that start and stop smoothly, and curves flown at their pace."""

import numpy as np

from controllers.flatness import FlatOutput
from controllers.jets import Jet
from controllers.signals import Array

Pace = tuple[Array, Array, Array]
"""Reading of a clock (s), its first (1) and second (1/s) time derivatives, each (n,)."""
Coordinates = tuple[Array | float, Array | float, Array | float, Array | float]
"""x y z (m) and yaw (rad), or their derivatives with respect to a clock's reading."""


def smooth_start(t: Array, ramp: float) -> Pace:
    """Return a clock that starts at rest and runs at full speed after `ramp` seconds.

    Its speed is the smoothstep 3 q^2 - 2 q^3 of q = t / ramp: position, velocity and acceleration of a curve flown at
    its pace are continuous.

    Args:
        t: (n,) time, s.
        ramp: Duration of the start, s; 0 for none.

    Returns:
        Its reading (s), speed (1) and acceleration (1/s), each (n,).
    """
    if ramp <= 0.0:
        return t, np.ones_like(t), np.zeros_like(t)
    q = np.clip(t, 0.0, ramp) / ramp
    return (
        ramp * (q**3 - 0.5 * q**4) + np.maximum(t - ramp, 0.0),
        q * q * (3.0 - 2.0 * q),
        6.0 * q * (1.0 - q) / ramp,
    )


def start_clock(t: Jet, ramp: float) -> Jet:
    """Return the clock of `smooth_start` with its higher derivatives.

    Args:
        t: (n,) time, s.
        ramp: Duration of the start, s; 0 for none.
    """
    if ramp <= 0.0:
        return t
    q = t * (1.0 / ramp)
    square, now = q * q, t.coefficients[0]
    starting = ramp * (square * q - 0.5 * (square * square))
    return starting.where(now < ramp, t - 0.5 * ramp).where(now >= 0.0, 0.0 * t)


def ride_clock(t: Array, length: float, ramp: float, order: int) -> Jet:
    """Return the clock of `smooth_ride` with its derivatives up to `order`, at the times t (n,), s."""
    ramp = min(ramp, length)
    end = ride_duration(length, ramp)
    starting = start_clock(Jet.variable(t, 1.0, order), ramp)
    stopping = length - start_clock(Jet.variable(end - t, -1.0, order), ramp)
    rest = Jet.variable(np.where(t > 0.5 * end, length, 0.0), 0.0, order)
    return stopping.where(t > 0.5 * end, starting).where((t >= 0.0) & (t <= end), rest)


def smooth_ride(t: Array, length: float, ramp: float) -> Pace:
    """Return a clock that runs from 0 to `length`, starts and stops as `smooth_start` does, and then stays there.

    Args:
        t: (n,) time, s; before 0 the reading is 0.
        length: Last reading, s.
        ramp: Duration of the start and of the stop, s; at most `length`.

    Returns:
        Its reading (s), speed (1) and acceleration (1/s), each (n,). It stops at t = `ride_duration(length, ramp)`.
    """
    ramp = min(ramp, length)
    end = ride_duration(length, ramp)
    reading, speed, acceleration = smooth_start(np.minimum(t, end - t), ramp)
    stopping, under_way = t > 0.5 * end, (t >= 0.0) & (t <= end)
    reading = np.where(under_way, reading, 0.0)
    return (
        np.where(stopping, length - reading, reading),
        np.where(under_way, speed, 0.0),
        np.where(under_way, np.where(stopping, -acceleration, acceleration), 0.0),
    )


def ride_duration(length: float, ramp: float) -> float:
    """Return the duration of `smooth_ride`, s: in a ramp the clock advances by half the ramp's duration."""
    return length + min(ramp, length)


def along(pace: Pace, point: Coordinates, slope: Coordinates, bend: Coordinates) -> FlatOutput:
    """Return the flat outputs (n, 4) of a curve flown at the pace of a clock.

    Args:
        pace: The clock.
        point: The curve at the clock's readings.
        slope: Its first derivative with respect to the reading.
        bend: Its second derivative.
    """
    columns = np.broadcast_arrays(pace[0], *point, *slope, *bend)[1:]
    return paced(FlatOutput(*(np.stack(columns[i : i + 4], axis=-1) for i in (0, 4, 8))), pace)


def paced(flat: FlatOutput, pace: Pace) -> FlatOutput:
    """Return flat outputs, given by the reading of a clock, with derivatives by time (chain rule)."""
    _, speed, acceleration = (part[:, None] for part in pace)
    return FlatOutput(flat.z, flat.dz * speed, flat.ddz * speed**2 + flat.dz * acceleration)
