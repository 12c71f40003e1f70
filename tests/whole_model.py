"""The linear model of all states, put together from its parts."""

import numpy as np

from controllers.ltv import SUBSYSTEMS, Ltv, Subsystem


def whole(ltv: Ltv, parts: tuple[Subsystem, ...] = SUBSYSTEMS["full"]) -> tuple[np.ndarray, np.ndarray]:
    """A (N, n, n) and B (N, n, 4)."""
    steps, n = len(ltv.u_nominal), ltv.x_nominal.shape[1]
    A, B = np.zeros((steps, n, n)), np.zeros((steps, n, 4))
    for part, AB in zip(parts, ltv.parts, strict=True):
        assert AB is not None
        A[:, part.states[:, None], part.states] = AB[:, :, : len(part.states)]
        B[:, part.states[:, None], part.inputs] = AB[:, :, len(part.states) :]
    return A, B
