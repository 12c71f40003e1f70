"""The signals of a flight that requirements speak of, on one grid of times.

The grid is that of the truth, one sample a control period; an imported log has none, and its cameras take its place.
Everything else holds its last value. Velocities of imported logs are differences of positions.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from controllers.rotations import wrap_angle
from controllers.signals import Array
from controllers.supervisors import PHASES
from heli_twin.errors import HeliTwinError
from heli_twin.recording import Log
from heli_twin.recording.log import Times
from heli_twin.recording.records import OUTCOMES
from heli_twin.requirements.formula import Trace

OTHERS = "others"
"""What a log has that is of one of several helicopters."""
POSES_LOST_S = 0.1
"""Without a new pose for so long, the poses are lost."""
FULL = 1.0 - 1e-6
"""From this fraction of full stick on, an input is at its end."""


class Motion(NamedTuple):
    """Times and motion of a flight on its grid."""

    log: Log
    time: Times
    """(n,) ns."""
    period: float
    """s."""
    position: Array
    """(n, 3) m."""
    quat_wxyz: Array
    """(n, 4)."""
    velocity: Array
    """(n, 3) m/s."""
    yaw_rate: Array
    """(n,) rad/s."""

    def held(self, time: Times, values: NDArray[Any], before: float = 0.0) -> Array:
        """Return values (n, ...) on the grid, each held until the next one; `before` the first."""
        if not len(time):
            return np.full((len(self.time), *values.shape[1:]), before)
        last = np.searchsorted(time, self.time, side="right") - 1
        held = np.asarray(values, np.float64)[np.maximum(last, 0)]
        held[last < 0] = before
        return held


@dataclass(frozen=True, slots=True)
class Signal:
    """A signal by its name."""

    unit: str | None
    """None for one that is true or false."""
    text: str
    of: Callable[[Motion], NDArray[Any]]
    """Computes its (n,) values."""
    topic: str = ""
    """Column of the log that has to have messages."""


def _error(motion: Motion) -> Array:
    """(n, 4) truth minus reference: x y z (m), yaw (rad)."""
    planned = motion.held(motion.log.reference.time, motion.log.reference.x[:, :4], np.nan)
    error = np.column_stack([motion.position, _yaw(motion.quat_wxyz)]) - planned
    error[:, 3] = wrap_angle(error[:, 3])
    return error


def _yaw(q: Array) -> Array:
    w, x, y, z = q.T
    return np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def _tilt(motion: Motion) -> Array:
    q = motion.quat_wxyz
    return 2.0 * np.arcsin(np.sqrt(np.clip(q[:, 1] ** 2 + q[:, 2] ** 2, 0.0, 1.0)))


def _distance(motion: Motion, axes: int = 3) -> Array:
    """(n,) of the nearest other helicopter; one whose flight is over stays where it was."""
    apart = [
        motion.held(other.truth.time, other.truth.position, np.nan) - motion.position
        for other in motion.log.others.values()
    ]
    return np.min([np.linalg.norm(each[:, :axes], axis=1) for each in apart], axis=0)


def _poses_lost(motion: Motion) -> NDArray[np.bool_]:
    arrived = motion.held(motion.log.pose.time, motion.log.pose.time, 0.0)
    return 1e-9 * (motion.time - arrived) > POSES_LOST_S


def _saturated(motion: Motion) -> NDArray[np.bool_]:
    largest = np.abs(motion.held(motion.log.sent.time, motion.log.sent.u)).max(axis=1)
    return np.asarray(largest >= FULL)


def _phase(name: str) -> Signal:
    def of(motion: Motion) -> NDArray[np.bool_]:
        changes = [event for event in motion.log.events if event.name in PHASES]
        times = np.array([event.time for event in changes], np.int64)
        return motion.held(times, np.array([event.name == name for event in changes])) > 0.5

    return Signal(None, f"the supervisor's phase is `{name}`", of)


def _outcome(name: str) -> Signal:
    def of(motion: Motion) -> NDArray[np.bool_]:
        reached = np.zeros(len(motion.time), np.bool_)
        reached[-1] = motion.log.outcome == name
        return reached

    return Signal(None, f"the flight has ended as `{name}`: true at its last sample alone", of)


def _input(column: int, text: str) -> Signal:
    return Signal("", text, lambda m: m.held(m.log.sent.time, m.log.sent.u[:, column]), "sent")


_MEASURED: dict[str, Signal] = {
    "error.position": Signal(
        "m", "distance from the reference", lambda m: np.linalg.norm(_error(m)[:, :3], axis=1), "reference"
    ),
    "error.horizontal": Signal(
        "m", "horizontal distance from it", lambda m: np.hypot(*_error(m)[:, :2].T), "reference"
    ),
    "error.x": Signal("m", "error in x", lambda m: _error(m)[:, 0], "reference"),
    "error.y": Signal("m", "error in y", lambda m: _error(m)[:, 1], "reference"),
    "error.z": Signal("m", "error in height", lambda m: _error(m)[:, 2], "reference"),
    "error.yaw": Signal("rad", "error of the heading, -180 to 180 deg", lambda m: _error(m)[:, 3], "reference"),
    "distance": Signal("m", "from the nearest other helicopter in the room, between the centres", _distance, OTHERS),
    "distance.horizontal": Signal("m", "the same in the plane", lambda m: _distance(m, axes=2), OTHERS),
    "x": Signal("m", "position in the world", lambda m: m.position[:, 0]),
    "y": Signal("m", "position in the world", lambda m: m.position[:, 1]),
    "height": Signal("m", "above the floor", lambda m: m.position[:, 2]),
    "speed": Signal("m/s", "size of the velocity", lambda m: np.linalg.norm(m.velocity, axis=1)),
    "speed.horizontal": Signal("m/s", "size of the horizontal velocity", lambda m: np.hypot(*m.velocity[:, :2].T)),
    "speed.vertical": Signal("m/s", "velocity upwards", lambda m: m.velocity[:, 2]),
    "tilt": Signal("rad", "angle between mast and vertical", _tilt),
    "yaw": Signal("rad", "heading, -180 to 180 deg", lambda m: _yaw(m.quat_wxyz)),
    "yaw_rate": Signal("rad/s", "rate of the heading", lambda m: m.yaw_rate),
    "stick.pitch": _input(0, "sent pitch input, of full stick"),
    "stick.roll": _input(1, "sent roll input, of full stick"),
    "stick.thrust": _input(2, "sent thrust input, of full stick"),
    "stick.yaw": _input(3, "sent yaw input, of full stick"),
    "saturated": Signal(
        None,
        "a sent input is at full stick",
        _saturated,
        "sent",
    ),
    "solve_ms": Signal(
        "ms",
        "measured time of the QP solve",
        lambda m: m.held(m.log.timing.time, 1e-6 * m.log.timing.solve_ns),
        "timing",
    ),
    "step_ms": Signal(
        "ms",
        "measured time of the whole control step",
        lambda m: m.held(m.log.timing.time, 1e-6 * m.log.timing.control_step_ns),
        "timing",
    ),
    "battery.voltage": Signal(
        "V", "at its terminals", lambda m: m.held(m.log.battery.time, m.log.battery.voltage), "battery"
    ),
    "poses_lost": Signal(None, f"no pose has come for {POSES_LOST_S:g} s", _poses_lost),
    "touching": Signal(
        None, "a part touches the floor", lambda m: m.held(m.log.truth.time, m.log.truth.touching) > 0.5, "truth"
    ),
}
_PHASES = {name: _phase(name) for name in PHASES if name not in OUTCOMES}
SIGNALS: dict[str, Signal] = _MEASURED | _PHASES | {name: _outcome(name) for name in OUTCOMES}
"""By name as formulas have it. Signed ones are read with `abs(...)` where their size matters."""
UNITS_OF: dict[str, str | None] = {name: signal.unit for name, signal in SIGNALS.items()}


def trace_of(log: Log, names: set[str]) -> Trace:
    """Return the named signals of a log.

    Raises:
        HeliTwinError: The log has no poses, or not the topic that a signal comes from.
    """
    motion = _motion(log)
    for name in sorted(names):
        topic = SIGNALS[name].topic
        if topic == OTHERS and not log.others:
            raise HeliTwinError(f"the log does not say '{name}': the helicopter flew without `{OTHERS}` in the room")
        if topic and topic != OTHERS and not len(getattr(log, topic).time):
            raise HeliTwinError(f"the log does not say '{name}': it has no `{topic}`")
    return Trace(
        motion.period, len(motion.time), {name: np.asarray(SIGNALS[name].of(motion), np.float64) for name in names}
    )


def _motion(log: Log) -> Motion:
    truth = log.truth
    if len(truth.time):
        period = _period(truth.time)
        return Motion(log, truth.time, period, truth.position, truth.quat_wxyz, truth.velocity, truth.yaw_rate)
    if len(log.pose.time) < 2:
        raise HeliTwinError("the log has neither truth nor two poses: there is nothing to judge")
    order = np.argsort(log.pose.stamp, kind="stable")
    stamp, position, q = log.pose.stamp[order], log.pose.position[order], log.pose.quat_wxyz[order]
    period = _period(stamp)
    grid = np.arange(stamp[0], stamp[-1] + 1, round(1e9 * period), dtype=np.int64)
    last = np.searchsorted(stamp, grid, side="right") - 1
    position, q = position[last], q[last]
    velocity = np.gradient(position, period, axis=0) if len(grid) > 1 else np.zeros_like(position)
    rate = np.gradient(np.unwrap(_yaw(q)), period) if len(grid) > 1 else np.zeros(len(grid))
    return Motion(log, grid, period, position, q, velocity, np.asarray(rate, np.float64))


def _period(time: Times) -> float:
    """Usual time between two samples, s."""
    return 1e-9 * float(np.median(np.diff(time))) if len(time) > 1 else 0.02
