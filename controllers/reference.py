"""Check a planned flight against the limits, and sample it ahead of the flight for the controller."""

from collections.abc import Callable

import numpy as np

from controllers.errors import InfeasibleTrajectory
from controllers.flatness import feed_forward, state
from controllers.model import GRAVITY, Model
from controllers.rotations import rotate_to_world
from controllers.signals import Array, Reference
from controllers.trajectories import Trajectory, derivatives, fitted

BLOCK_SAMPLES = 512
"""Samples evaluated in one call: memory does not grow with the flight, and NumPy is called rarely."""
_FARTHEST = 1e6
"""Limit of positions (m) and yaw (rad): beyond it, rounding errors become visible in a flight."""


class ReferencePreview:
    """Samples of reference states and inputs from any control time on.

    Samples lie on the grid `origin + k period`. Before time 0 the reference is that of time 0.

    Args:
        trajectory: The planned flight.
        model: The believed helicopter, for the feed-forward.
        period: Control period, ns.
        origin: One point of the grid, ns.
        highest: Highest time derivative of the flat outputs that the samples hold; 0 for states and inputs alone.
        prepare: What a law makes of flat outputs (n + 1, k, 4), one row for each of k samples.
        samples: How many are made at once, beyond those of a call.
    """

    def __init__(
        self,
        trajectory: Trajectory,
        model: Model,
        period: int,
        origin: int,
        highest: int = 0,
        prepare: Callable[[Array], Array] | None = None,
        samples: int = BLOCK_SAMPLES,
    ) -> None:
        self._trajectory, self._model = fitted(trajectory, model), model
        self._prepare, self._prepared = prepare, np.empty(0)
        self._period, self._origin = period, origin
        self._first, self._x, self._u = 0, np.empty((0, 8)), np.empty((0, 4))
        self._samples = samples
        self._highest, self._flat = highest, np.empty(0)

    def __call__(self, stamp: int, steps: int) -> Reference:
        """Return `steps` inputs and `steps + 1` states, the first at `stamp` (ns, on the grid)."""
        k, off_grid = divmod(stamp - self._origin, self._period)
        if off_grid:
            raise ValueError(f"stamp {stamp} ns is not on the grid {self._origin} + k {self._period} ns")
        i = k - self._first
        if i < 0 or i + steps + 1 > len(self._x):
            self._fill(k, self._samples + steps + 1)
            i = 0
        rows = slice(i, i + steps + 1)
        flat = self._flat[:, rows] if self._highest else None
        prepared = self._prepared[rows] if self._prepare else None
        return Reference(stamp, self._x[rows], self._u[i : i + steps], flat, prepared)

    def _fill(self, first: int, count: int) -> None:
        t = 1e-9 * np.maximum(self._origin + self._period * (first + np.arange(count)), 0)
        flat = self._trajectory.flat(t)
        self._first, self._x, self._u = first, state(flat), feed_forward(self._model, flat)
        if self._highest:
            self._flat = derivatives(self._trajectory, t, self._highest)
            if self._prepare:
                self._prepared = self._prepare(self._flat)


def with_flat(reference: Reference, model: Model, highest: int) -> Reference:
    """Return a reference with the flat outputs of its states and inputs, which one made by a supervisor lacks.

    Args:
        reference: The planned flight; one with flat outputs is returned as it is.
        model: The believed helicopter.
        highest: Highest time derivative, 0 for no flat outputs; the 3rd and all higher ones are 0, for inputs are held.
    """
    if not highest or reference.flat is not None:
        return reference
    x, u, yaw = reference.x, np.concatenate([reference.u, reference.u[-1:]]), reference.x[:, 3]
    flat = np.zeros((max(highest, 2) + 1, len(x), 4))
    flat[0], flat[1] = x[:, :4], x[:, 4:]
    flat[1, :, :2] = rotate_to_world(x[:, 4:6], yaw)
    push = u * np.array([model.b_x, model.b_y, model.b_z, model.b_yaw])
    push += x[:, 4:] * np.array([model.k_x, model.k_y, 0.0, model.k_yaw])
    flat[2] = push
    flat[2, :, :2] = rotate_to_world(push[:, :2], yaw)
    flat[2, :, 2] -= GRAVITY
    return reference._replace(flat=flat[: highest + 1])


@np.errstate(all="ignore")
def check_feasible(trajectory: Trajectory, model: Model, duration: float, period: float) -> None:
    """Refuse a trajectory whose feed-forward leaves the believed input or velocity limits, (28) and (29).

    Args:
        trajectory: The planned flight.
        model: The believed helicopter.
        duration: Length of the flight, s.
        period: Sampling of the check, s.

    Raises:
        InfeasibleTrajectory: Names the first time, the quantity, its value and the limit.
    """
    trajectory = fitted(trajectory, model)
    far = _FARTHEST
    low = np.array([*model.u_min, *(-v for v in model.v_max), -far, -far, 0.0, -far])
    high = np.array([*model.u_max, *model.v_max, far, far, far, far])
    for start in np.arange(0.0, duration + period, BLOCK_SAMPLES * period):
        t = start + period * np.arange(BLOCK_SAMPLES)
        t = t[t <= duration]
        if not t.size:
            return
        flat = trajectory.flat(t)
        needed = np.concatenate([feed_forward(model, flat), state(flat)[:, 4:], flat.z], axis=1)
        _refuse(t, needed, low, high)


_NAMES = (
    ("pitch input u_x", ""),
    ("roll input u_y", ""),
    ("thrust input u_z", ""),
    ("yaw input u_yaw", ""),
    ("forward speed vx", "m/s"),
    ("sideward speed vy", "m/s"),
    ("vertical speed vz", "m/s"),
    ("yaw rate", "rad/s"),
    ("position x", "m"),
    ("position y", "m"),
    ("height above the floor", "m"),
    ("yaw", "rad"),
)


def _refuse(t: Array, values: Array, low: Array, high: Array) -> None:
    # Not `values > high`: NaN must be refused too. The margin of 1e-9 is for rounding.
    allowed = (values >= low - 1e-9) & (values <= high + 1e-9)
    if allowed.all():
        return
    i, j = (int(index) for index in np.argwhere(~allowed)[0])
    name, unit = _NAMES[j]
    value, limit = values[i, j], low[j] if values[i, j] < low[j] else high[j]
    # As many digits as tell the two apart.
    digits = next((n for n in range(3, 17) if f"{value:.{n}g}" != f"{limit:.{n}g}"), 17)
    raise InfeasibleTrajectory(
        f"the trajectory cannot be flown: at t = {t[i]:.2f} s it needs {name} = {value:.{digits}g} {unit}".rstrip()
        + f", the limit is {limit:.{digits}g} {unit}".rstrip()
        + "; make it slower, smaller or smoother"
    )
