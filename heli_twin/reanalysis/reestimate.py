"""Run the estimator again on the poses and commands of a log: its error and its consistency.

The errors of a consistent filter, squared and normalised by its covariance, follow a chi-squared distribution: the
errors of position and velocity (NEES, needs the truth) and the innovations (NIS, needs the poses only). Samples of one
flight are correlated in time, so that shares inside the 95 % bounds scatter more than those of independent samples.

Source: Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, section 5.4.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from controllers.estimators import Estimator
from controllers.rotations import rotate_to_world, wrap_angle
from controllers.signals import Array, Estimate, Pose, nanoseconds
from heli_twin.errors import HeliTwinError
from heli_twin.experiment import Experiment
from heli_twin.experiment.text import assignment, changed
from heli_twin.logbook import flown_experiment
from heli_twin.recording import Log
from heli_twin.recording.log import Estimates, Times, Truths

CHI2_95 = {1: (9.821e-4, 5.0239), 2: (0.050636, 7.3778), 4: (0.48442, 11.1433), 8: (2.17973, 17.5345)}
"""The 2.5 % and 97.5 % quantiles of chi-squared, by degrees of freedom."""
ESTIMATE_TOLERANCE = 1e-9
"""Allowed difference of an estimate on another host or build, where sums are rounded in another order, SI."""
MAX_STEPS = 4_000_000
"""Limit of control steps on a log that has neither estimates nor commands, whose times would say how many there are."""


@runtime_checkable
class HasCovariance(Protocol):
    """An estimator that states its covariance."""

    innovation: tuple[Array, Array] | None
    """Measured minus predicted x y z (m) and yaw (rad) (4,) of the last pose, and the variance (4,) of that."""

    def covariance(self, until: int) -> Array:
        """Covariances (4, 3, 3) of position, velocity and disturbance of each axis at `until` (ns)."""
        ...


class Consistency(NamedTuple):
    """Squared errors, normalised by the covariance that the estimator states."""

    freedom: int
    """Degrees of freedom, which is also the mean of a consistent filter."""
    values: Array
    """(n,)."""

    @property
    def inside(self) -> float:
        """Share of the values inside the 95 % bounds; 0.95 for a consistent filter."""
        low, high = CHI2_95[self.freedom]
        return float(((self.values >= low) & (self.values <= high)).mean())


@dataclass(frozen=True)
class Reestimation:
    """The estimates of a log's estimator, run again."""

    experiment: Experiment
    estimates: Estimates
    covariance: Array
    """(n, 4, 3, 3) of position, velocity and disturbance, axes x y z yaw; NaN if the estimator states none."""
    innovation: Array
    """(m, 4) measured minus predicted x y z (m) and yaw (rad), rejected poses included."""
    innovation_variance: Array
    """(m, 4) m^2 and rad^2."""

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
        overrides: Changes, `estimator.path=value` or, of the model it predicts with, `controller.model.path=value`.

    Raises:
        HeliTwinError: The log has no poses, or an override belongs to another part.
    """
    for text in overrides:
        path, _ = assignment(text, "path=value, such as estimator.gate=20")
        if path.split(".")[0] != "estimator" and not path.startswith("controller.model."):
            raise HeliTwinError(f"{path} does not belong to the estimator: change estimator.* or controller.model.*")
    experiment = changed(flown_experiment(log), overrides)
    if not len(log.pose.time):
        raise HeliTwinError("the log has no poses: there is nothing to estimate from")
    estimator = experiment.estimator.start(experiment.controller.model)
    run = _EstimatorRun(estimator)
    try:
        with threadpool_limits(limits=1), np.errstate(all="ignore"):
            for t, asked, sent in _steps(log, nanoseconds(experiment.controller.period)):
                run.step(t, log, asked, sent)
    except (ArithmeticError, ValueError) as error:
        raise HeliTwinError(f"the estimator cannot run on the poses and commands of this log: {error}") from error
    return Reestimation(experiment, *run.columns())


def _steps(log: Log, period: int) -> Iterator[tuple[int, bool, int]]:
    """Time, ns, whether an estimate is due, and the index of the command that was sent then, or -1."""
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


class _EstimatorRun:
    """An estimator that is running, and its estimates so far."""

    def __init__(self, estimator: Estimator) -> None:
        self._estimator = estimator
        self._next_pose = 0
        self._times: list[int] = []
        self._estimates: list[Estimate] = []
        self._covariances: list[Array] = []
        self._innovations: list[tuple[Array, Array]] = []

    def step(self, t: int, log: Log, asked: bool, sent: int) -> None:
        """Repeat the ground station's step at time t (ns): receive the poses that have arrived, estimate, send."""
        pose, estimator = log.pose, self._estimator
        while self._next_pose < len(pose.time) and pose.time[self._next_pose] <= t:
            i = self._next_pose
            self._next_pose += 1
            seen = Pose(int(pose.stamp[i]), pose.position[i], pose.quat_wxyz[i])
            estimator.receive(int(pose.time[i]), seen)
            if isinstance(estimator, HasCovariance) and estimator.innovation is not None:
                self._innovations.append(estimator.innovation)
        estimate = estimator.estimate(t) if asked else None
        if estimate is not None:
            self._times.append(t)
            self._estimates.append(estimate)
            known = isinstance(estimator, HasCovariance)
            self._covariances.append(estimator.covariance(estimate.stamp) if known else np.full((4, 3, 3), np.nan))
        if sent >= 0:
            estimator.command_sent(t, log.sent.u[sent])

    def columns(self) -> tuple[Estimates, Array, Array, Array]:
        """Estimates, covariances, innovations and their variances."""
        # Without further states, which have no truth to compare with.
        rows = list(zip(*(estimate[:6] for estimate in self._estimates), strict=True)) or [()] * 6
        shapes = ((-1,), (-1, 8), (-1, 4), (-1, 4, 3), (-1,), (-1,))
        types = (np.int64, float, float, float, np.int64, np.int32)
        columns = [np.array(row, kind).reshape(shape) for row, kind, shape in zip(rows, types, shapes, strict=True)]
        estimates = Estimates(np.array(self._times, np.int64), *columns)
        innovations = np.array(self._innovations).reshape(-1, 2, 4)
        return estimates, np.array(self._covariances).reshape(-1, 4, 3, 3), innovations[:, 0], innovations[:, 1]


@np.errstate(all="ignore")
def error(estimates: Estimates, truth: Truths) -> tuple[NDArray[np.intp], Array]:
    """Estimates minus truth at the times for which the estimates hold, as far as the truth is known there.

    Returns:
        Indices (n,) of these estimates, and (n, 4, 2) errors in position and velocity: x y z (world, m and m/s) and yaw
        (rad and rad/s).
    """
    if len(truth.time) < 2:
        return np.empty(0, np.intp), np.empty((0, 4, 2))
    inside = np.flatnonzero((estimates.stamp >= truth.stamp[0]) & (estimates.stamp <= truth.stamp[-1]))
    position = np.column_stack([truth.position, truth.yaw])
    velocity = np.column_stack([truth.velocity, truth.yaw_rate])
    true_position, true_velocity = _between(truth.stamp, position, velocity, estimates.stamp[inside])
    x = estimates.x[inside]
    position_error = x[:, :4] - true_position
    position_error[:, 3] = wrap_angle(position_error[:, 3])
    velocity_world = np.column_stack([rotate_to_world(x[:, 4:6], x[:, 3]), x[:, 6:8]])
    return inside, np.stack([position_error, velocity_world - true_velocity], axis=2)


def _between(knots: Times, p: Array, v: Array, t: Times) -> tuple[Array, Array]:
    """Position and velocity (n, k) at times t (n,), ns, by cubic Hermite interpolation between the knots."""
    i = np.clip(np.searchsorted(knots, t, side="right") - 1, 0, len(knots) - 2)
    h = (1e-9 * np.maximum(knots[i + 1] - knots[i], 1))[:, None]
    q = 1e-9 * (t - knots[i])[:, None] / h
    slope = (p[i + 1] - p[i]) / h
    bend, twist = 3 * slope - 2 * v[i] - v[i + 1], v[i] + v[i + 1] - 2 * slope
    return p[i] + h * q * (v[i] + q * (bend + q * twist)), v[i] + q * (2 * bend + 3 * q * twist)


def largest_difference(ours: Estimates, theirs: Estimates) -> float:
    """Largest difference of two runs in any number, SI; infinite if their times or counts are not the same."""
    exact = ("time", "stamp", "pose_stamp", "rejected")
    if any(getattr(ours, name).tolist() != getattr(theirs, name).tolist() for name in exact):
        return np.inf
    pairs = ((ours.x, theirs.x), (ours.disturbance, theirs.disturbance), (ours.variance, theirs.variance))
    return max((float(np.nan_to_num(np.abs(a - b)).max()) for a, b in pairs if a.size), default=0.0)


def same_bits(ours: Estimates, theirs: Estimates) -> bool:
    """Return whether two runs are equal to the last bit."""
    return all(a.tobytes() == b.tobytes() for a, b in zip(ours, theirs, strict=True))
