"""The least error of hovering: that of the best linear controller for its gusts and its delays.

The linear-quadratic-Gaussian (LQG) controller knows the linear model of each horizontal axis exactly, with the
statistics of gusts and cameras, and minimises position^2 + rho u^2. A smaller rho allows more stick: over rho, the
errors are a curve, the least error for each amount of stick.

A steady push is left out: an estimator learns it exactly in time, and a steady input cancels it.

Source: Astrom and Wittenmark, Computer-Controlled Systems, 3rd ed., ch. 11 (sampled-data LQG); Van Loan, IEEE Trans.
Automatic Control 23 (1978) 395 (sampled noise).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from controllers.condensed_qp import riccati_terminal_weight, sqrt_weight
from controllers.detailed_model import DetailedModel, exponential
from controllers.model import GRAVITY
from controllers.signals import Array
from heli_twin.lab.mocap import Vicon

POSITION, VELOCITY, TILT, JERK, SERVO, GUST, BIAS = range(7)
"""States of an axis: m, m/s, tilt acceleration m/s^2, m/s^3, stick, acceleration by the gust m/s^2, camera error m."""
N_CONTROLLED = BIAS
"""The controller's states are those before the bias, which moves nothing."""
RUN_S = 28.0
"""Length of a run: what remains of a flight of 30 s after the first 2 s."""
SETTLING_S = 3.0
"""Left out at the beginning of each run, s."""


@dataclass(frozen=True)
class Loop:
    """Times of the loop, s, and errors of the cameras."""

    period: float = 0.02
    """Control period."""
    delay: float = 0.024
    """From a control step until its command acts, within two periods."""
    frame: float = 0.01
    """Between two pictures; a whole number of them makes a period."""
    age: float = 0.015
    """Of the newest pose at a control step."""
    cameras: Vicon = field(default_factory=Vicon)


class Bound(NamedTuple):
    """The least error for an amount of stick."""

    error: float
    """m, median over the runs of the largest error of a run."""
    stick: float
    """Root mean square of the input about its mean, full stick."""


class Axis(NamedTuple):
    """The linear model of one axis between two pictures."""

    rates: Array
    """(8, 8) continuous-time, of the states and the input, which is constant."""
    F: Array
    """(7, 7) transition of the states over one frame."""
    noise: Array
    """(7, 7) covariance that the gust and the cameras' bias add in one frame."""


def lqg_bounds(
    model: DetailedModel, axis: int, rhos: Sequence[float], loop: Loop | None = None, runs: int = 300
) -> list[Bound]:
    """Return the least errors of hover on one axis: one bound for each weight, with the same gusts.

    Args:
        model: The helicopter and the gust; the bound is of a controller that knows both.
        axis: 0 is x, ahead; 1 is y, to port.
        rhos: Weights on the squared input, m^2 per square of full stick.
        loop: Delays and cameras; those of the lab if not given.
        runs: Number of Gaussian runs of `RUN_S`.
    """
    loop = loop or Loop()
    plant = axis_model(model, axis, loop)
    K = np.stack([feedback(plant, rho, loop) for rho in rhos])
    positions, inputs = _simulated(plant, K, loop, runs, round(RUN_S / loop.period))
    errors = np.median(np.abs(positions).max(axis=0), axis=-1)
    return [Bound(float(e), float(u)) for e, u in zip(errors, inputs.std(axis=(0, 2)), strict=True)]


def axis_model(model: DetailedModel, axis: int, loop: Loop) -> Axis:
    """Return the linear model of one axis in hover."""
    k, b, w = (model.k_x, model.k_y)[axis], (model.b_x, model.b_y)[axis], model.frequencies[axis]
    hub, stick = model.hub_drag * w * w, BIAS + 1
    rates = np.zeros((8, 8))
    rates[POSITION, VELOCITY] = rates[TILT, JERK] = 1.0
    rates[VELOCITY, [VELOCITY, TILT, GUST]] = k, 1.0, 1.0
    rates[JERK, [VELOCITY, TILT, JERK]] = hub * k, -w * w, -2.0 * model.attitude_damping * w
    rates[JERK, [SERVO, GUST]] = w * w * b, hub
    rates[SERVO, [SERVO, stick]] = np.array([-1.0, 1.0]) / model.servo_lag
    rates[GUST, GUST], rates[BIAS, BIAS] = -1.0 / model.gust_time, -1.0 / loop.cameras.bias_time
    intensity = np.zeros(7)
    intensity[GUST] = 2.0 * model.gust_acceleration[axis] ** 2 / model.gust_time
    intensity[BIAS] = 2.0 * loop.cameras.bias**2 / loop.cameras.bias_time
    noise = _sampled_noise(rates[:7, :7], intensity, loop.frame)
    return Axis(rates, exponential(rates * loop.frame)[:7, :7], noise)


def feedback(plant: Axis, rho: float, loop: Loop) -> Array:
    """Return the optimal gain (6,) on the states when the command acts: u = -K x."""
    whole = exponential(plant.rates * loop.period)
    A, B = whole[:N_CONTROLLED, :N_CONTROLLED], whole[:N_CONTROLLED, -1:]
    P = riccati_terminal_weight(A, B, np.diag([1.0, *np.zeros(N_CONTROLLED - 1)]), np.array([[rho]]))
    return np.linalg.solve(rho + B.T @ P @ B, B.T @ P @ A)[0]


def measurement(loop: Loop) -> tuple[Array, Array]:
    """Return the pose of one axis as H (2, 7), position and tilt, and the covariance (2, 2) of its noise."""
    H = np.zeros((2, 7))
    H[0, [POSITION, BIAS]] = H[1, TILT] = 1.0
    return H, np.diag([loop.cameras.position_noise**2, (GRAVITY * loop.cameras.orientation_noise) ** 2])


def estimation(plant: Axis, loop: Loop) -> tuple[Array, Array]:
    """Return the stationary Kalman gain (7, 2) and the covariance (7, 7) of the error after a pose."""
    H, R = measurement(loop)
    before = riccati_terminal_weight(plant.F.T, H.T, plant.noise, R)
    L = np.asarray(np.linalg.solve(H @ before @ H.T + R, H @ before).T, np.float64)
    after = before - L @ H @ before
    return L, 0.5 * (after + after.T)


def _simulated(plant: Axis, K: Array, loop: Loop, runs: int, steps: int) -> tuple[Array, Array]:
    """Positions at the newest pose of each control step, and inputs: (steps, gains, runs) each.

    The states are those at the newest pose; `past` are the latest commands, the last one first. The estimator's error
    has its own dynamics, which no input changes, so that all gains share it.
    """
    L, covariance = estimation(plant, loop)
    H, R = measurement(loop)
    ahead, by_past = (
        exponential(plant.rates * (loop.age + loop.delay))[:7, :7],
        _moved(plant, loop, -loop.age, loop.delay),
    )
    first = -loop.period - loop.age
    frames = [first + i * loop.frame for i in range(round(loop.period / loop.frame))]
    by_frame = [_moved(plant, loop, start, start + loop.frame) for start in frames]
    root, blur, corrected = sqrt_weight(plant.noise), np.sqrt(np.diag(R)), np.eye(7) - L @ H
    rng = np.random.default_rng(0)
    error = rng.standard_normal((runs, 7)) @ sqrt_weight(covariance)
    x, past = np.tile(error, (len(K), 1, 1)), np.zeros((len(K), runs, by_past.shape[1]))
    positions, inputs = np.empty((2, steps, len(K), runs))
    settling = round(SETTLING_S / loop.period)
    for k in range(-settling, steps):
        at_action = (x - error) @ ahead.T + past @ by_past.T
        u = -np.einsum("grs,gs->gr", at_action[..., :N_CONTROLLED], K)
        if k >= 0:
            positions[k], inputs[k] = x[..., POSITION], u
        past = np.concatenate([u[..., None], past[..., :-1]], axis=-1)
        for moved in by_frame:
            gust = rng.standard_normal((runs, 7)) @ root
            x = x @ plant.F.T + past @ moved.T + gust
            error = (error @ plant.F.T + gust) @ corrected.T - (blur * rng.standard_normal((runs, 2))) @ L.T
    return positions, inputs


def _moved(plant: Axis, loop: Loop, start: float, end: float) -> Array:
    """Effect of each of the latest commands on the states between two times, s after a control step: (7, commands).

    The j-th latest command, counted from 0, acts from `delay - (j + 1) period` until `delay - j period`.
    """
    count = int(np.ceil((loop.period + loop.age + loop.delay) / loop.period - 1e-9))
    moved = np.zeros((7, count))
    for j in range(count):
        begins, ends = max(start, loop.delay - (j + 1) * loop.period), min(end, loop.delay - j * loop.period)
        if ends > begins:
            acted = exponential(plant.rates * (ends - begins))[:7, 7]
            moved[:, j] = exponential(plant.rates * (end - ends))[:7, :7] @ acted
    return moved


def _sampled_noise(rates: Array, intensity: Array, dt: float) -> Array:
    """Covariance of what white noise of some intensities adds to the states in a step."""
    n = len(rates)
    both = np.block([[-rates, np.diag(intensity)], [np.zeros((n, n)), rates.T]])
    E = exponential(both * dt)
    return E[n:, n:].T @ E[:n, n:]
