"""The detailed model along the last plan: the nominal trajectory, its linear model and its reference.

The linear model leaves out the same coupling as the paper's: horizontal motion turns along with the nominal heading,
but does not depend on changes of it. Along a given heading it is linear, so that its matrices are exact.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from controllers.detailed_model import GUST, N_DETAILED, PUSH, TRIM, DetailedModel, Step, U, step
from controllers.ltv import Ltv, Subsystem
from controllers.model import GRAVITY
from controllers.signals import Array

PLANE = Subsystem((0, 1, 4, 5, *range(8, 14)), (0, 1))
"""The horizontal motion: x y (world), vx vy (body), then tilt, jerk and servo of x and of y."""
HEIGHT_AND_YAW = Subsystem((2, 3, 6, 7, 14, 15), (2, 3), constant=True)
"""Height and yaw, with thrust and torque."""
_OF_AXIS = np.array([[0, 2, 4, 5, 6], [1, 3, 7, 8, 9]])
"""Position, velocity, tilt, jerk, servo of x and of y among the states of `PLANE`."""


class Disturbances(NamedTuple):
    """Estimated disturbances: gust, trim and push."""

    gust: Array
    """(2,) acceleration by gusts, world, m/s^2; it fades."""
    trim: Array
    """(2,) pitch and roll stick that the helicopter adds of its own, full stick."""
    push: Array
    """(4,) constant acceleration x y z (world, m/s^2) and yaw (rad/s^2)."""


Fly = Callable[[Array, Array, Array], Array]
"""Flies a linear model: gives states (N + 1, n) for [A B f] (N, n, n + m + 1), the first state and inputs (N, m)."""


class DetailedLinearisation:
    """The nominal trajectory of the detailed model and its linear model along it, over one horizon.

    Each step of the plane is taken in the frame at its middle heading: velocities are turned into it by half of the
    step's turn, and afterwards out of it by the other half. The matrices are therefore sums of constant ones, each
    times the product of two of these: 1, cos and sin of half the turn, cos and sin of the middle heading.

    Args:
        model: Believed parameters.
        period: Control period, s.
        steps: N, the number of periods.
    """

    def __init__(self, model: DetailedModel, period: float, steps: int) -> None:
        solution = step(model, period)
        self._n = steps
        in_frame, disturbed = np.zeros((10, 12)), np.zeros((10, 6))
        for axis, (own, rows) in enumerate(zip(_OF_AXIS, solution.plane, strict=True)):
            in_frame[np.ix_(own, own)] = rows[:5, :5]
            in_frame[own, 10 + axis] = rows[:5, U]
            disturbed[np.ix_(own, [axis, 2 + axis, 4 + axis])] = rows[:5, [GUST, TRIM, PUSH]]
        self.gust_response = disturbed[:, :2]
        """(10, 2) change of the plane's states in one step by the gust at its start."""
        self.gust_decay = float(solution.plane[0, GUST, GUST])
        self._decay = self.gust_decay ** np.arange(steps)[:, None]
        self._turned = _turned(in_frame, False).reshape(_N_TURNS**2, -1)
        of_gust, of_trim, of_push = (
            _turned(disturbed[:, i : i + 2], by) for i, by in ((0, True), (2, False), (4, True))
        )
        self._fading = of_gust.reshape(-1, 2)
        self._lasting = np.concatenate([of_trim, of_push], axis=-1).reshape(-1, 4)
        self._turns = np.ones((steps, _N_TURNS))
        self._height_and_yaw = np.zeros((steps, 6, 8))
        self._chains = self._chained(solution)

    def _chained(self, solution: Step) -> Array:
        """Enter height and yaw into the linear model.

        Returns:
            (6 N, 8 + 2 N) states of `HEIGHT_AND_YAW` after each step, from the first ones, the pushes and the inputs.
        """
        n, whole = self._n, np.zeros((6, 10))
        for axis, rows in enumerate((solution.z, solution.yaw)):
            own = np.array([axis, axis + 2, axis + 4])
            whole[own[:, None], [*own, axis + 6, axis + 8]] = rows
        self._height_and_yaw[...] = whole[:, [*range(6), 8, 9]]
        after, chain = np.eye(6, 8 + 2 * n), np.empty((n, 6, 8 + 2 * n))
        for i in range(n):
            after = whole[:, :6] @ after
            after[:, 6:8] += whole[:, 6:8]
            after[:, 8 + 2 * i : 10 + 2 * i] += whole[:, 8:]
            chain[i] = after
        return chain.reshape(6 * n, -1)

    def __call__(self, x0: Array, u: Array, acting: Disturbances, fly: Fly | None = None) -> Ltv:
        """Simulate the nominal inputs and linearise along the result.

        Args:
            x0: (16,) newest state.
            u: (N, 4) nominal inputs.
            acting: Disturbances, of which the gust fades over the horizon.
            fly: What flies the plane, as `StepByStep.fly`, which computes its response to the inputs on the way.
        """
        n, x = self._n, np.empty((self._n + 1, N_DETAILED))
        x[0] = x0
        pushes = (acting.push[2] - GRAVITY, acting.push[3])
        forced = self._chains @ np.concatenate([x0[HEIGHT_AND_YAW.states], pushes, u[:, 2:].ravel()])
        x[1:, HEIGHT_AND_YAW.states] = forced.reshape(n, 6)
        ABf = self._plane(x[:, 3], acting)
        x[:, PLANE.states] = (fly or _flown)(ABf, x0[PLANE.states], u[:, :2])
        return Ltv((None if fly else ABf[..., :-1], self._height_and_yaw), x, u)

    def _plane(self, yaw: Array, acting: Disturbances) -> Array:
        """Matrices [A B f] (N, 10, 13) of the horizontal motion along the headings (N + 1,)."""
        turns = self._turns
        half, middle = 0.5 * (yaw[1:] - yaw[:-1]), 0.5 * (yaw[1:] + yaw[:-1])
        np.cos(half, out=turns[:, 1])
        np.sin(half, out=turns[:, 2])
        np.cos(middle, out=turns[:, 3])
        np.sin(middle, out=turns[:, 4])
        products = (turns[:, :, None] * turns[:, None, :]).reshape(len(turns), -1)
        ABf = np.empty((len(turns), 10, 13))
        ABf[..., :-1] = (products @ self._turned).reshape(-1, 10, 12)
        lasting = (self._lasting @ np.concatenate([acting.trim, acting.push[:2]])).reshape(-1, 10)
        fading = (self._fading @ acting.gust).reshape(-1, 10)
        np.add(products @ lasting, (self._decay * products) @ fading, out=ABf[..., -1])
        return ABf


def _flown(ABf: Array, x0: Array, u: Array) -> Array:
    """States (N + 1, n) of x_{k+1} = A_k x_k + B_k u_k + f_k."""
    x = [x0]
    for M, u_k in zip(ABf, u, strict=True):
        x.append(M @ np.concatenate([x[-1], u_k, [1.0]]))
    return np.stack(x)


_N_TURNS = 5
"""Number of factors that depend on the heading: 1, cos and sin of half the step's turn, and of the middle heading."""


def _turned(in_frame: Array, world: bool) -> Array:
    """Matrices that sum up to that of a step along a turning heading.

    Args:
        in_frame: (10, k) effect on the plane's states in the frame at the middle heading. If k = 12, of the states and
            inputs; else of a vector in the plane,
        world: which is given in the world frame.

    Returns:
        (5, 5, 10, k), each to be multiplied by the product of two factors; see `_N_TURNS`.
    """
    turn, k = np.array([[0.0, 1.0], [-1.0, 0.0]]), in_frame.shape[1]
    out_of, into = np.zeros((_N_TURNS, 10, 10)), np.zeros((_N_TURNS, k, k))
    out_of[0, range(4, 10), range(4, 10)] = 1.0
    out_of[1, 2:4, 2:4], out_of[2, 2:4, 2:4] = np.eye(2), turn
    out_of[3, 0:2, 0:2], out_of[4, 0:2, 0:2] = np.eye(2), turn.T
    if k == 12:
        into[0, range(4, 12), range(4, 12)] = 1.0
        into[1, 2:4, 2:4], into[2, 2:4, 2:4] = np.eye(2), turn
    elif world:
        into[3], into[4] = np.eye(2), turn
    else:
        into[0] = np.eye(2)
    sums = out_of[:, None] @ in_frame @ into
    if k == 12:
        sums[0, 0, 0:2, 0:2] = np.eye(2)
    return sums
