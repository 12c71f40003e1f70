"""Smooth curves through given points: polynomials of degree five, joined with continuous acceleration.

Source: van Nieuwstadt and Murray, "Real-time trajectory generation for differentially flat systems", 1998: with flat
outputs, every sufficiently smooth curve from point to point can be flown, so polynomials suffice.
"""

import numpy as np

from controllers.flatness import FlatOutput
from controllers.jets import Jet
from controllers.signals import Array


def knot_motion(times: Array, points: Array, *, rest: bool) -> tuple[Array, Array]:
    """Return the velocity and acceleration at each point of the parabola through it and its two neighbours.

    Args:
        times: (n,) times of the points, s, increasing.
        points: (n, 4) x y z (m) and yaw (rad).
        rest: True if the first and last points are at rest; otherwise their neighbours' parabolas extend to them.

    Returns:
        Velocities and accelerations, each (n, 4).
    """
    step = np.diff(times)[:, None]
    slope = np.diff(points, axis=0) / step
    before, after = step[:-1], step[1:]
    velocity, acceleration = np.zeros_like(points), np.zeros_like(points)
    velocity[1:-1] = (after * slope[:-1] + before * slope[1:]) / (before + after)
    acceleration[1:-1] = 2.0 * (slope[1:] - slope[:-1]) / (before + after)
    if not rest:
        # With two points only, both accelerations are zero: a straight line.
        acceleration[0], acceleration[-1] = acceleration[1], acceleration[-2]
        velocity[0] = slope[0] - 0.5 * step[0] * acceleration[0]
        velocity[-1] = slope[-1] + 0.5 * step[-1] * acceleration[-1]
    return velocity, acceleration


def quintic(t: Array, times: Array, points: Array, velocity: Array, acceleration: Array) -> FlatOutput:
    """Evaluate polynomials of degree five between knots; the curve is at rest before the first and after the last.

    Args:
        t: (n,) times, s.
        times: (m,) times of the knots, s, increasing.
        points: (m, 4) x y z (m) and yaw (rad) at the knots.
        velocity: (m, 4) first time derivative at the knots.
        acceleration: (m, 4) second time derivative at the knots.

    Returns:
        The flat outputs at t, each (n, 4).
    """
    q, length, (p0, v0, a0, c3, c4, c5) = _pieces(t, times, points, velocity, acceleration)
    moving = ((t >= times[0]) & (t <= times[-1]))[:, None]
    return FlatOutput(
        p0 + q * (v0 + q * (0.5 * a0 + q * (c3 + q * (c4 + q * c5)))),
        np.where(moving, v0 + q * (a0 + q * (3.0 * c3 + q * (4.0 * c4 + q * 5.0 * c5))), 0.0) / length,
        np.where(moving, a0 + q * (6.0 * c3 + q * (12.0 * c4 + q * 20.0 * c5)), 0.0) / length**2,
    )


def quintic_derivatives(t: Array, highest: int, times: Array, points: Array, motion: tuple[Array, Array]) -> Array:
    """Return the curve of `quintic` and its time derivatives at t (n,), s: (highest + 1, n, 4).

    Args:
        t: (n,) times, s.
        highest: Highest derivative.
        times: (m,) times of the knots, s, increasing.
        points: (m, 4) x y z (m) and yaw (rad) at the knots.
        motion: Velocity and acceleration at the knots, each (m, 4).
    """
    share, length, (p0, v0, a0, c3, c4, c5) = _pieces(t, times, points, *motion)
    q = Jet.variable(share, 1.0 / length, highest)
    curve = (p0 + q * (v0 + q * (0.5 * a0 + q * (c3 + q * (c4 + q * c5))))).derivatives()
    curve[1:, (t < times[0]) | (t >= times[-1])] = 0.0
    return curve


def _pieces(
    t: Array, times: Array, points: Array, velocity: Array, acceleration: Array
) -> tuple[Array, Array, tuple[Array, ...]]:
    """Share (n, 1) of each piece that has passed, its duration (n, 1), and the numbers (n, 4) of its polynomial."""
    i = np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(times) - 2)
    length = (times[i + 1] - times[i])[:, None]
    q = np.clip((t - times[i])[:, None] / length, 0.0, 1.0)
    v0, v1 = velocity[i] * length, velocity[i + 1] * length
    a0, a1 = acceleration[i] * length**2, acceleration[i + 1] * length**2
    way = points[i + 1] - points[i]
    c3 = 10.0 * way - 6.0 * v0 - 4.0 * v1 - 1.5 * a0 + 0.5 * a1
    c4 = -15.0 * way + 8.0 * v0 + 7.0 * v1 + 1.5 * a0 - a1
    c5 = 6.0 * way - 3.0 * (v0 + v1) + 0.5 * (a1 - a0)
    return q, length, (points[i], v0, a0, c3, c4, c5)
