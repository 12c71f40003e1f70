"""Rules of trajectories: true derivatives, a start at rest, a path that can be flown."""

from collections.abc import Callable
from typing import Any

import numpy as np

from controllers.flatness import feed_forward
from controllers.model import Model
from controllers.reference import check_feasible
from controllers.signals import Array
from controllers.trajectories import SmoothTrajectory, fitted
from heli_twin.conformance.rules import close, require

MODEL = Model()
_STEP_S = 1e-4
_TIMES_S = np.arange(_STEP_S, 40.0, 0.0137)


def _slope(values: Callable[[Array], Array]) -> Array:
    """Central difference of a function of time."""
    return (values(_TIMES_S + _STEP_S) - values(_TIMES_S - _STEP_S)) / (2.0 * _STEP_S)


def has_true_derivatives(trajectory: Any) -> None:
    """The derivatives of its flat outputs are those of its path."""
    flat = fitted(trajectory, MODEL).flat
    # Half the step squared times the third derivative (below 50 in a room) is 3e-7; where that one jumps, at the end
    # of a ramp, the step times the jump: 1e-3 at most.
    close(_slope(lambda t: flat(t).z), flat(_TIMES_S).dz, 1e-6, "dz is not the derivative of z")
    close(_slope(lambda t: flat(t).dz), flat(_TIMES_S).ddz, 1e-3, "ddz is not the derivative of dz")


def can_be_flown_in_the_room(trajectory: Any) -> None:
    """The believed helicopter can fly it for a minute."""
    check_feasible(trajectory, MODEL, 60.0, 0.02)


def starts_at_rest(trajectory: Any) -> None:
    """It starts at rest, so that nothing jumps at the first command."""
    flat = fitted(trajectory, MODEL).flat(np.zeros(1))
    close(flat.dz, np.zeros((1, 4)), 0.0, "it moves at time 0")
    close(feed_forward(MODEL, flat)[0], np.array(MODEL.u_hover), 1e-12, "its first input is no hover")


def is_finite_and_above_the_floor(trajectory: Any) -> None:
    """At every time from 0 to 10 hours it has a finite point above the floor."""
    t = np.concatenate([[0.0], np.geomspace(1e-9, 36_000.0, 2000)])
    flat = fitted(trajectory, MODEL).flat(t)
    for name, values in zip(("z", "dz", "ddz"), flat, strict=False):
        require(values.shape == (len(t), 4), f"{name} has shape {values.shape}, not ({len(t)}, 4)")
        require(np.isfinite(values).all(), f"{name} is not finite at some time")
    require((flat.z[:, 2] > 0.0).all(), f"it goes down to {flat.z[:, 2].min():.3g} m")


def is_a_function_of_time(trajectory: Any) -> None:
    """A point does not depend on which others are asked for."""
    flat, t = fitted(trajectory, MODEL).flat, np.linspace(0.0, 40.0, 101)
    together = flat(t)
    for i in (0, 37, 100):
        # Vectorised sines may differ in their last digit.
        close(flat(t[i : i + 1]).z[0], together.z[i], 1e-12, "z depends on the other times")
        close(flat(t[i : i + 1]).ddz[0], together.ddz[i], 1e-9, "ddz depends on the other times")


_HIGHEST = 6
"""Highest derivative that is checked."""


def has_true_higher_derivatives(trajectory: Any) -> None:
    """If it gives higher derivatives, they belong to its path, and those it calls continuous do not jump."""
    trajectory = fitted(trajectory, MODEL)
    if not isinstance(trajectory, SmoothTrajectory):
        return
    of = trajectory.derivatives
    found = of(_TIMES_S, _HIGHEST)
    require(found.shape == (_HIGHEST + 1, len(_TIMES_S), 4), f"derivatives(t, {_HIGHEST}) has shape {found.shape}")
    close(found[:3], np.stack(trajectory.flat(_TIMES_S)), 1e-9, "derivatives are not those of flat()")
    largest = np.abs(found).max(axis=(1, 2))
    for k in range(2, _HIGHEST):
        slope = _slope(lambda t, k=k: of(t, k)[k])
        off = np.abs(slope - found[k + 1]).max(axis=1) > 1e-3 * max(largest[k + 1], largest[k], 1e-9)
        # Within 0.1 ms of a jump the central difference means nothing: allowed at 2 % of the times.
        require(off.mean() <= 0.02, f"derivative {k + 1} is not the slope of derivative {k}")
    for k in range(min(trajectory.smoothness, _HIGHEST - 1) + 1):
        step = float(np.abs(np.diff(found[k], axis=0)).max())
        most = 1.01 * largest[k + 1] * float(_TIMES_S[1] - _TIMES_S[0]) + 1e-9
        require(step <= most, f"derivative {k} jumps by {step:.3g}, and smoothness is {trajectory.smoothness}")
