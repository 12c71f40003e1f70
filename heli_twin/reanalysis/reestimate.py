"""The estimator run again on the poses and commands of a log: how far from the truth, and does it know?

A consistent filter's squared errors, over the covariance it claims, follow chi-squared: of position and velocity
(NEES, needs the truth) and of what each pose brought that was not predicted (NIS, needs the poses only). The samples
of one flight hang together in time, so that shares inside the 95 % bounds scatter more than independent ones would.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from controllers.estimators import Estimator
from controllers.signals import Array, Estimate, Pose, nanoseconds
from heli_twin.errors import HeliTwinError
from heli_twin.experiment import Experiment
from heli_twin.experiment.text import changed
from heli_twin.logbook import flown_experiment
from heli_twin.recording import Log
from heli_twin.recording.log import Estimates, Times, Truths

CHI2_95 = {1: (9.821e-4, 5.0239), 2: (0.050636, 7.3778), 4: (0.48442, 11.1433), 8: (2.17973, 17.5345)}
"""By degrees of freedom: the 2.5 % and 97.5 % quantiles of chi-squared."""
TOLERANCE = 1e-9
"""SI: what an estimate may differ by on another host or build, where sums are rounded in another order."""
MAX_STEPS = 4_000_000
"""Control steps on a log that says neither when it estimated nor when it sent."""


@runtime_checkable
class Accountable(Protocol):
    """An estimator that says how sure it is."""

    innovation: tuple[Array, Array] | None
    """Of the last pose: measured minus predicted x y z yaw (4,), and its variance (4,)."""

    def covariance(self, until: int) -> Array:
        """Covariances (4, 3, 3) of position, velocity and disturbance of each axis at `until` (ns)."""
        ...


class Consistency(NamedTuple):
    """Squared errors over the variance claimed for them."""

    freedom: int
    """Degrees of freedom: the mean that a consistent filter has."""
    values: Array
    """(n,)."""

    @property
    def inside(self) -> float:
        """Share inside the 95 % bounds; 0.95 for a consistent filter."""
        low, high = CHI2_95[self.freedom]
        return float(((self.values >= low) & (self.values <= high)).mean())


@dataclass(frozen=True)
class Reestimation:
    """An estimator's second run."""

    experiment: Experiment
    estimates: Estimates
    covariance: Array
    """(n, 4, 3, 3) of position, velocity and disturbance, axes x y z yaw; NaN from an estimator that has none."""
    innovation: Array
    """(m, 4) measured minus predicted x y z (m) and yaw (rad), refused poses included."""
    innovation_variance: Array
    """(m, 4)."""

    @np.errstate(all="ignore")
    def nis(self) -> Consistency:
        """Normalised innovation squared of every pose, four degrees of freedom."""
        return Consistency(4, (self.innovation**2 / self.innovation_variance).sum(axis=1))

    @np.errstate(all="ignore")
    def nees(self, truth: Truths) -> Consistency:
        """Normalised estimation error squared of position and velocity on four axes, eight degrees of freedom."""
        inside, errors = error(self.estimates, truth)
        P = self.covariance[inside, :, :2, :2]
        if not np.isfinite(P).all():
            return Consistency(8, np.empty(0))
        solved = np.linalg.solve(P, errors[..., None])[..., 0]
        return Consistency(8, (errors * solved).sum(axis=(1, 2)))


def reestimate(log: Log, overrides: Sequence[str] = ()) -> Reestimation:
    """Run the estimator of a log again.

    Args:
        log: Any log with poses.
        overrides: Changes, `estimator.path=value` or, for what it believes, `controller.model.path=value`.

    Raises:
        HeliTwinError: The log has no poses, or an override changes something else.
    """
    for text in overrides:
        path = text.partition("=")[0].strip()
        if path.split(".")[0] != "estimator" and not path.startswith("controller.model."):
            raise HeliTwinError(f"{path} is no matter of the estimator: change estimator.* or controller.model.*")
    experiment = changed(flown_experiment(log), overrides)
    if not len(log.pose.time):
        raise HeliTwinError("the log has no poses: there is nothing to estimate from")
    estimator = experiment.estimator.start(experiment.controller.model)
    run = _Run(estimator)
    try:
        with threadpool_limits(limits=1), np.errstate(all="ignore"):
            for t, asked, sent in _steps(log, nanoseconds(experiment.controller.period)):
                run.step(t, log, asked, sent)
    except (ArithmeticError, ValueError) as error:
        raise HeliTwinError(f"the estimator cannot run on the poses and commands of this log: {error}") from error
    return Reestimation(experiment, *run.columns())


def _steps(log: Log, period: int) -> Iterator[tuple[int, bool, int]]:
    """Time, whether an estimate is asked for, and the index of the command sent then, or -1."""
    asked = log.estimate.time if len(log.estimate.time) else log.sent.time
    if not len(asked):
        end = int(log.pose.time.max())
        if end // period > MAX_STEPS:
            raise HeliTwinError(f"the poses of this log span {1e-9 * end:.0f} s: too long for one flight")
        asked = np.arange(0, end + period, period)
    sent = {int(t): i for i, t in enumerate(log.sent.time)}
    asked_set = set(asked.tolist())
    for t in sorted(asked_set | sent.keys()):
        yield t, t in asked_set, sent.get(t, -1)


class _Run:
    """An estimator under way, and what it said."""

    def __init__(self, estimator: Estimator) -> None:
        self._estimator = estimator
        self._next_pose = 0
        self._times: list[int] = []
        self._estimates: list[Estimate] = []
        self._covariances: list[Array] = []
        self._innovations: list[tuple[Array, Array]] = []

    def step(self, t: int, log: Log, asked: bool, sent: int) -> None:
        """What the ground station did at time t (ns): take in what has arrived, estimate, send."""
        pose, estimator = log.pose, self._estimator
        while self._next_pose < len(pose.time) and pose.time[self._next_pose] <= t:
            i = self._next_pose
            self._next_pose += 1
            seen = Pose(int(pose.stamp[i]), pose.position[i], pose.quat_wxyz[i])
            estimator.receive(int(pose.time[i]), seen)
            if isinstance(estimator, Accountable) and estimator.innovation is not None:
                self._innovations.append(estimator.innovation)
        estimate = estimator.estimate(t) if asked else None
        if estimate is not None:
            self._times.append(t)
            self._estimates.append(estimate)
            accountable = isinstance(estimator, Accountable)
            self._covariances.append(
                estimator.covariance(estimate.stamp) if accountable else np.full((4, 3, 3), np.nan)
            )
        if sent >= 0:
            estimator.command_sent(t, log.sent.u[sent])

    def columns(self) -> tuple[Estimates, Array, Array, Array]:
        """Estimates, covariances, innovations and their variances."""
        rows = list(zip(*self._estimates, strict=True)) or [()] * 6
        shapes = ((-1,), (-1, 8), (-1, 4), (-1, 4, 3), (-1,), (-1,))
        types = (np.int64, float, float, float, np.int64, np.int32)
        columns = [np.array(row, kind).reshape(shape) for row, kind, shape in zip(rows, types, shapes, strict=True)]
        estimates = Estimates(np.array(self._times, np.int64), *columns)
        innovations = np.array(self._innovations).reshape(-1, 2, 4)
        return estimates, np.array(self._covariances).reshape(-1, 4, 3, 3), innovations[:, 0], innovations[:, 1]


@np.errstate(all="ignore")
def error(estimates: Estimates, truth: Truths) -> tuple[NDArray[np.intp], Array]:
    """Estimates minus truth at the moments the estimates hold for, within the time that the truth is known.

    Returns:
        Which estimates (n,), and (n, 4, 2) errors in position and velocity, x y z (world, m, m/s) and yaw (rad, rad/s).
    """
    if len(truth.time) < 2:
        return np.empty(0, np.intp), np.empty((0, 4, 2))
    inside = np.flatnonzero((estimates.stamp >= truth.stamp[0]) & (estimates.stamp <= truth.stamp[-1]))
    position = np.column_stack([truth.position, truth.yaw])
    velocity = np.column_stack([truth.velocity, truth.yaw_rate])
    true_position, true_velocity = _between(truth.stamp, position, velocity, estimates.stamp[inside])
    x = estimates.x[inside]
    c, s = np.cos(x[:, 3]), np.sin(x[:, 3])
    vx, vy = c * x[:, 4] - s * x[:, 5], s * x[:, 4] + c * x[:, 5]
    off = x[:, :4] - true_position
    off[:, 3] = (off[:, 3] + np.pi) % (2 * np.pi) - np.pi
    return inside, np.stack([off, np.column_stack([vx, vy, x[:, 6], x[:, 7]]) - true_velocity], axis=2)


def _between(knots: Times, p: Array, v: Array, t: Times) -> tuple[Array, Array]:
    """Position and velocity (n, k) at times t (n,), ns, along cubics with the positions and velocities at the knots."""
    i = np.clip(np.searchsorted(knots, t, side="right") - 1, 0, len(knots) - 2)
    h = (1e-9 * np.maximum(knots[i + 1] - knots[i], 1))[:, None]
    q = 1e-9 * (t - knots[i])[:, None] / h
    slope = (p[i + 1] - p[i]) / h
    bend, twist = 3 * slope - 2 * v[i] - v[i + 1], v[i] + v[i + 1] - 2 * slope
    return p[i] + h * q * (v[i] + q * (bend + q * twist)), v[i] + q * (2 * bend + 3 * q * twist)


def largest_difference(ours: Estimates, theirs: Estimates) -> float:
    """Largest difference of two runs in any number, SI; infinite where their times or counts are not the same."""
    exact = ("time", "stamp", "pose_stamp", "rejected")
    if any(getattr(ours, name).tolist() != getattr(theirs, name).tolist() for name in exact):
        return np.inf
    pairs = ((ours.x, theirs.x), (ours.disturbance, theirs.disturbance), (ours.variance, theirs.variance))
    return max((float(np.nan_to_num(np.abs(a - b)).max()) for a, b in pairs if a.size), default=0.0)


def same_bits(ours: Estimates, theirs: Estimates) -> bool:
    """Whether two runs are equal to the last bit."""
    return all(a.tobytes() == b.tobytes() for a, b in zip(ours, theirs, strict=True))
