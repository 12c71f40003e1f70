"""The normal equations of one step: the first state of each window is projected out, each log has its nuisance."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from controllers.signals import Array
from heli_twin.calibration import noise
from heli_twin.calibration.problem import Problem
from heli_twin.calibration.unknowns import N_LOG, N_THETA, columns


class Normal(NamedTuple):
    """The linearised problem after the projection of the first states."""

    matrix: Array
    """(m, m) sum of J' P J, of theta and then each log's nuisance."""
    vector: Array
    """(m,) sum of J' P r."""
    scores: Array
    """(w, m) J' P r of each window."""
    to_start: Callable[[Array], Array]
    """From a step (m,) to the steps (w, .) of what belongs to a window: first state, frames in doubt."""


def normal(problem: Problem, air: noise.Windage, eta: Array, rows: Array) -> Normal:
    """Return the normal equations of one Gauss-Newton step.

    Args:
        problem: The flights.
        air: The responses to wind and torque.
        eta: (9,) logarithms of `noise.COMPONENTS`.
        rows: (w, BINS, 6, .) derivatives by theta and a log's nuisance, the residual, derivatives by a window's own.
    """
    w, n = len(problem.log_of), N_THETA + N_LOG
    white = noise.whiten(air, eta, rows)[0].reshape(w, -1, rows.shape[-1])
    gram = white.transpose(0, 2, 1) @ white
    gram[:, n + 1 :, n + 1 :] += noise.start_precision(rows.shape[-1] - n - 1)
    inverse = np.linalg.inv(gram[:, n + 1 :, n + 1 :])
    back = inverse @ gram[:, n + 1 :, : n + 1]
    local = gram[:, : n + 1, : n + 1] - gram[:, : n + 1, n + 1 :] @ back
    scores = scattered(problem, local[:, :n, n])
    places = [columns(int(log)) for log in problem.log_of]

    def to_start(step: Array) -> Array:
        return back[..., n] - np.stack(
            [of_window @ step[c] for of_window, c in zip(back[..., :n], places, strict=True)]
        )

    return Normal(information(problem, local[:, :n, :n]), scores.sum(axis=0), scores, to_start)


def information(problem: Problem, local: Array) -> Array:
    """Return the information (m, m) on theta and then each log's nuisance, from that of each window on its own."""
    m = N_THETA + len(problem.flights) * N_LOG
    out = np.zeros((m, m))
    for log in range(len(problem.flights)):
        c = columns(log)
        out[np.ix_(c, c)] += local[problem.log_of == log].sum(axis=0)
    return out


def scattered(problem: Problem, local: Array) -> Array:
    """Return vectors (w, m) over theta and then each log's nuisance, from those (w, n) of each window on its own."""
    out = np.zeros((len(local), N_THETA + len(problem.flights) * N_LOG))
    for log in range(len(problem.flights)):
        out[np.ix_(np.flatnonzero(problem.log_of == log), columns(log))] = local[problem.log_of == log]
    return out
