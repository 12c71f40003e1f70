"""The detailed model along the last plan: the nominal trajectory, its linear model and its reference.

The linear model leaves out the same coupling as the paper's: horizontal motion turns along with the nominal heading,
but does not depend on changes of it. Along a given heading it is linear, so that its matrices are exact.
"""

from typing import NamedTuple

import numpy as np

from controllers.detailed_model import GUST, N_DETAILED, PUSH, TRIM, DetailedModel, U, step
from controllers.ltv import N_INPUTS, Ltv, Subsystem
from controllers.model import GRAVITY
from controllers.signals import Array

PLANE = Subsystem((0, 1, 4, 5, *range(8, 14)), (0, 1), of=N_DETAILED)
"""The horizontal motion: x y (world), vx vy (body), then tilt, jerk and servo of x and of y."""
HEIGHT_AND_YAW = Subsystem((2, 3, 6, 7, 14, 15), (2, 3), constant=True, of=N_DETAILED)
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


class DetailedLinearisation:
    """The nominal trajectory of the detailed model and its linear model along it, over one horizon.

    Args:
        model: Believed parameters.
        period: Control period, s.
        steps: N, the number of periods.
    """

    def __init__(self, model: DetailedModel, period: float, steps: int) -> None:
        solution = step(model, period)
        self._n = steps
        self._plane, self._plane_input = np.zeros((10, 10)), np.zeros((10, 2))
        self._disturbed = np.zeros((10, 6))
        for axis, (own, rows) in enumerate(zip(_OF_AXIS, solution.plane, strict=True)):
            self._plane[np.ix_(own, own)] = rows[:5, :5]
            self._plane_input[own, axis] = rows[:5, U]
            self._disturbed[np.ix_(own, [axis, 2 + axis, 4 + axis])] = rows[:5, [GUST, TRIM, PUSH]]
        self.gust_response = self._disturbed[:, :2]
        """(10, 2) change of the plane's states in one step by the gust at its start."""
        self.gust_decay = float(solution.plane[0, GUST, GUST])
        self._decay = self.gust_decay ** np.arange(steps)[:, None]
        self._A, self._B = np.zeros((steps, N_DETAILED, N_DETAILED)), np.zeros((steps, N_DETAILED, N_INPUTS))
        self._z, self._yaw = (self._chain(rows, k) for rows, k in ((solution.z, 2), (solution.yaw, 3)))

    def _chain(self, rows: Array, k: int) -> Array:
        """Enter height (k = 2) or yaw (k = 3) into the linear model.

        Returns:
            (3 N, 4 + N) states after each step, from the first state, the push and the inputs.
        """
        own = np.array([k, k + 4, k + 12])
        self._A[:, own[:, None], own] = rows[:, :3]
        self._B[:, own, k] = rows[:, 4]
        after = np.zeros((3, 4 + self._n))
        after[:, :3] = np.eye(3)
        chain: list[Array] = []
        for i in range(self._n):
            after = rows[:, :3] @ after
            after[:, 3] += rows[:, 3]
            after[:, 4 + i] += rows[:, 4]
            chain.append(after)
        return np.concatenate(chain)

    def __call__(self, x0: Array, u: Array, acting: Disturbances) -> Ltv:
        """Simulate the nominal inputs and linearise along the result.

        Args:
            x0: (16,) newest state.
            u: (N, 4) nominal inputs.
            acting: Disturbances, of which the gust fades over the horizon.
        """
        n, x = self._n, np.empty((self._n + 1, N_DETAILED))
        x[0] = x0
        for chain, k, push in ((self._z, 2, acting.push[2] - GRAVITY), (self._yaw, 3, acting.push[3])):
            own = [k, k + 4, k + 12]
            x[1:, own] = (chain @ np.concatenate([x0[own], [push], u[:, k]])).reshape(n, 3)
        yaw = x[:, 3]
        middle, half = _turns(0.5 * (yaw[1:] + yaw[:-1])), _turns(0.5 * (yaw[1:] - yaw[:-1]))
        A, B, f = self._plane_steps(middle, half, u, acting)
        x_plane = x0.take(PLANE.states)
        rows = np.empty((n, 10))
        for A_k, f_k, row in zip(A, f, rows, strict=True):
            np.dot(A_k, x_plane, out=row)
            row += f_k
            x_plane = row
        x[1:, PLANE.states] = rows
        whole_A, whole_B = self._A.copy(), self._B.copy()
        whole_A[:, PLANE.states[:, None], PLANE.states] = A
        whole_B[:, PLANE.states[:, None], PLANE.inputs] = B
        return Ltv(whole_A, whole_B, x, u)

    def _plane_steps(self, middle: Array, half: Array, u: Array, acting: Disturbances) -> tuple[Array, Array, Array]:
        """Matrices A (N, 10, 10), B (N, 10, 2) and offsets (N, 10) of the horizontal motion along the headings.

        Each step is taken in the frame at its middle heading: velocities are turned into it, and afterwards out of it.
        """
        n = self._n
        AB = np.empty((n, 10, 13))
        AB[..., :10], AB[..., 10:12] = self._plane, self._plane_input
        in_frame = np.empty((n, 6))
        in_frame[:, :2] = (middle @ acting.gust) * self._decay
        in_frame[:, 2:4] = acting.trim
        in_frame[:, 4:] = middle @ acting.push[:2]
        AB[..., 12] = in_frame @ self._disturbed.T
        AB[..., 2:4] = AB[..., 2:4] @ half
        AB[:, 0:2, 2:] = middle.transpose(0, 2, 1) @ AB[:, 0:2, 2:]
        AB[:, 2:4, 2:] = half @ AB[:, 2:4, 2:]
        A, B = AB[..., :10], AB[..., 10:12]
        offsets = AB[..., 12] + np.matmul(B, u[:, :2, None])[..., 0]
        return A, B, offsets


def _turns(angle: Array) -> Array:
    """Rotations (n, 2, 2) of vectors into a frame that is turned by the angles (n,)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c, s, -s, c], axis=-1).reshape(-1, 2, 2)
