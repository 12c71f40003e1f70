"""A flight that nobody flew: a circle with plausible wires, for the tests of the recorder."""

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import numpy as np
import pytest

from controllers.signals import Command, Estimate, Plan, Pose, QpReport, Reference
from heli_twin.lab.plant import Air, Truth, physical_state
from heli_twin.recording import Recorder
from heli_twin.recording.writer import Listener

MILLISECOND = 1_000_000
PERIOD = 20 * MILLISECOND
HORIZON = 30
RADIUS, RATE, CLIMB = 0.5, 2.0, 1.0
EXPERIMENT = '{"controller":{"kind":"ltv_mpc"},"duration":10.0,"seed":1}'


def circle(t: np.ndarray) -> np.ndarray:
    """Physical states (n, 8) on the circle at times t (n,), s, nose along the path."""
    angle = RATE * t
    speed = np.full_like(t, RADIUS * RATE)
    zero = np.zeros_like(t)
    x, y, z = RADIUS * np.cos(angle), RADIUS * np.sin(angle), np.full_like(t, CLIMB)
    return np.stack([x, y, z, angle + np.pi / 2, speed, zero, zero, np.full_like(t, RATE)], axis=1)


def truth_at(t: int, rng: np.random.Generator) -> Truth:
    """The helicopter near the circle, banked a little."""
    x = circle(np.array([t * 1e-9]))[0]
    yaw, roll = x[3], 0.1
    c, s, cr, sr = np.cos(yaw / 2), np.sin(yaw / 2), np.cos(roll / 2), np.sin(roll / 2)
    wobble = 0.01 * np.array([np.sin(3e-9 * t), np.cos(4e-9 * t), np.sin(1e-9 * t)])
    return Truth(
        stamp=t,
        position=x[:3] + wobble,
        quat_wxyz=np.array([c * cr, c * sr, s * sr, s * cr]),
        velocity=np.array([-RADIUS * RATE * np.sin(yaw - np.pi / 2), RADIUS * RATE * np.cos(yaw - np.pi / 2), 0.0]),
        angular_velocity=np.array([0.0, 0.0, RATE]) + 0.01 * rng.standard_normal(3),
        yaw=float(yaw),
        yaw_rate=RATE,
        actuators=np.array([0.2, 0.3, 0.55, 0.05]) + 0.02 * np.sin(2e-9 * t),
        touching=False,
    )


def step(recorder: Recorder, t: int, rng: np.random.Generator, compute_ns: int) -> None:
    """Record what crosses the wires in one control period from t (ns) on."""
    truth = truth_at(t, rng)
    recorder.truth(t, truth)
    for arrival in (t - 8 * MILLISECOND, t):
        seen = truth_at(max(arrival - 5 * MILLISECOND, 0), rng)
        noisy = seen.position + 0.001 * rng.standard_normal(3)
        recorder.pose(max(arrival, 0), Pose(seen.stamp, noisy, seen.quat_wxyz))
    x = physical_state(truth) + 0.002 * rng.standard_normal(8)
    recorder.estimate(t, Estimate(t, x, np.zeros(4), np.full((4, 3), 1e-4), t - 5 * MILLISECOND, 0))
    ahead = t * 1e-9 + 0.02 * np.arange(HORIZON + 1)
    u = np.clip(np.array([0.2, 0.3, 0.55, 0.05]) + 0.02 * rng.standard_normal((HORIZON, 4)), -1, 1)
    reference = Reference(t, circle(ahead), np.tile([0.2, 0.3, 0.545, 0.05], (HORIZON, 1)))
    recorder.reference(t, reference)
    plan = Plan(np.hstack([circle(ahead), np.zeros((HORIZON + 1, 2))]), u, np.roll(u, -1, axis=0))
    command = Command(t, u[0], plan, QpReport("solved", 7, 2, float(rng.standard_normal()), 0.0), compute_ns)
    recorder.sent(t, command)
    recorder.plan(t, plan)
    recorder.qp(t, command.qp or QpReport("safe_hover", 0, 0, 0.0, 0.0))
    if rng.random() < 0.9:
        recorder.acting(t + 15 * MILLISECOND, u[0], t)
    recorder.disturbance(t, Air(0.1 * rng.standard_normal(3), np.zeros(3), 0.98))
    recorder.timing(t, 2 * compute_ns, compute_ns)


def fly(recorder: Recorder, seconds: float = 10.0, seed: int = 1, compute_ns: int = 800_000) -> None:
    """Record a whole flight and leave the recorder open."""
    rng = np.random.default_rng(seed)
    recorder.reference_path(0, circle(np.linspace(0, 2 * np.pi / RATE, 200))[:, :3])
    recorder.event(0, "info", "take-off", "the flight starts")
    for t in range(0, round(seconds * 1e9), PERIOD):
        step(recorder, t, rng, compute_ns)
    recorder.event(round(seconds * 1e9), "info", "landed", "the flight is over")


class Record(Protocol):
    def __call__(
        self,
        path: Path | None = None,
        *,
        seconds: float = 2.0,
        seed: int = 1,
        compute_ns: int = 1,
        started: str = "now",
        listeners: Sequence[Listener] = (),
    ) -> Recorder: ...


@pytest.fixture(scope="session")
def record() -> Record:
    """A function that records a whole flight and closes the log."""

    def record(
        path: Path | None = None,
        *,
        seconds: float = 2.0,
        seed: int = 1,
        compute_ns: int = 1,
        started: str = "now",
        listeners: Sequence[Listener] = (),
    ) -> Recorder:
        recorder = Recorder(path, experiment=EXPERIMENT, metadata={"started": started}, listeners=listeners)
        fly(recorder, seconds, seed, compute_ns)
        recorder.close("completed", round(seconds * 1e9))
        return recorder

    return record
