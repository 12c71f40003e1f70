"""Rules of estimators: they follow the poses, survive nonsense, and say the same again."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from controllers.laws import extra_states
from controllers.model import Model
from controllers.signals import Estimate, Pose
from heli_twin.conformance.rules import close, require, same

MODEL = Model()


def _poses(count: int, period: int = 5_000_000) -> Iterator[tuple[int, Pose]]:
    for k in range(count):
        t = k * period
        position = np.array([0.1 * np.sin(1e-9 * t), 0.1 - 0.1 * np.cos(1e-9 * t), 1.0])
        yield t + 10_000_000, Pose(t, position, np.array([1.0, 0.0, 0.0, 0.0]))


def _estimates(spec: Any, poses: Sequence[tuple[int, Pose]]) -> list[Estimate | None]:
    estimator, estimates = spec.start(MODEL), []
    for k, (at, pose) in enumerate(poses):
        estimator.receive(at, pose)
        if k % 4 == 3:
            estimates.append(estimator.estimate(at))
            estimator.command_sent(at, np.array(MODEL.u_hover))
    return estimates


def knows_nothing_before_the_first_pose(spec: Any) -> None:
    """Before the first pose its estimate is None."""
    require(spec.start(MODEL).estimate(0) is None, "it has an estimate without a pose")


def follows_the_poses(spec: Any) -> None:
    """Without noise it follows a slow circle within 5 cm and 10 cm/s, with finite numbers."""
    poses = list(_poses(800))
    last = _estimates(spec, poses)[-1]
    require(last is not None, "it has no estimate after 4 s of poses")
    assert last is not None
    t = 1e-9 * last.stamp
    wanted = np.array([0.1 * np.sin(t), 0.1 - 0.1 * np.cos(t), 1.0, 0.0, 0.1 * np.cos(t), 0.1 * np.sin(t), 0.0, 0.0])
    require(last.x.shape == (8,) and np.isfinite(last.x).all(), f"its state is {last.x.tolist()}")
    close(last.x[:4], wanted[:4], 0.05, "position and yaw")
    close(last.x[4:], wanted[4:], 0.1, "velocity")


def survives_nonsense(spec: Any) -> None:
    """Poses that are not finite, late or twice change nothing into NaN."""
    poses = list(_poses(400))
    bad = [
        (at, Pose(p.stamp, np.full(3, np.nan), np.full(4, np.nan))) if i % 7 == 3 else (at, p)
        for i, (at, p) in enumerate(poses)
    ]
    bad[100:100] = [bad[50], bad[99]]
    bad.sort(key=lambda row: row[0])
    last = _estimates(spec, bad)[-1]
    require(last is not None and np.isfinite(last.x).all(), "its estimate is not finite any more")


def estimates_its_further_states(spec: Any) -> None:
    """Every estimate has as many further states as it names, finite, and a variance of each or none."""
    count = len(extra_states(spec))
    for estimate in _estimates(spec, list(_poses(200))):
        if estimate is not None:
            extra, variance = estimate.extra, estimate.extra_variance
            right = extra.shape == (count,) and variance.shape in ((count,), (0,))
            require(right, f"it has {extra.shape} further states and {variance.shape} variances, and names {count}")
            require(np.isfinite(extra).all(), f"its further states are {extra.tolist()}")


def estimates_are_repeatable(spec: Any) -> None:
    """Two flights of one value are equal."""
    poses = list(_poses(200))
    first, second = _estimates(spec, poses), _estimates(spec, poses)
    require(same([e.x for e in first if e], [e.x for e in second if e]), "the same poses gave another estimate")
