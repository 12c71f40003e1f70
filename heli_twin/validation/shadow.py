"""Shadow mode: a log or a pipe is watched, and events say when the helicopter is not the calibrated one any more."""

from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np

from controllers.signals import Array, Pose
from heli_twin.experiment import Experiment
from heli_twin.recording import Log
from heli_twin.validation.band import Band
from heli_twin.validation.watch import STATISTICS, Watch, Watched
from heli_twin.validation.wire import Seen, Sent

BACK, BACK_S = 0.8, 3.0
"""A statistic is back in its band when it has been below this share of its limit for so long, s."""
MEANS = {
    "x": "gusts, the drag along the nose, or the cameras",
    "y": "gusts, the drag to port, or the cameras",
    "z": "the thrust changes fast: a rotor, the battery, or the cameras",
    "yaw": "the yaw: a rotor, the gyro, or the markers",
    "pitch": "pitch does not answer as calibrated: a servo, its linkage, or the stabiliser",
    "roll": "roll does not answer as calibrated: a servo, its linkage, or the stabiliser",
    "thrust": "the battery, a rotor, or a load",
    "torque": "a rotor, or the gyro",
    "pitch_trim": "a servo, its linkage, or the centre of gravity",
    "roll_trim": "a servo, its linkage, or the centre of gravity",
}
"""What may be behind each statistic."""


class ShadowEvent(NamedTuple):
    """A statistic has left its band, or is back."""

    time: float
    """s since the first pose or command."""
    event: str
    """`left` or `back`."""
    statistic: str
    value: float
    limit: float
    text: str

    def plain(self) -> dict[str, Any]:
        """The same for JSON."""
        return self._asdict()


def from_log(log: Log) -> Iterator[Seen | Sent]:
    """Yield poses and commands of a log in the order of their arrival; a command before a pose of the same time."""
    pose, sent, i = log.pose, log.sent, 0
    for k in range(len(pose.time)):
        while i < len(sent.time) and sent.time[i] <= pose.time[k]:
            yield Sent(int(sent.time[i]), sent.u[i].copy())
            i += 1
        yield Seen(int(pose.time[k]), Pose(int(pose.stamp[k]), pose.position[k], pose.quat_wxyz[k]))


def watched(experiment: Experiment, messages: Iterable[Seen | Sent]) -> Iterator[Watched]:
    """Yield the statistics of a flight, pose by pose.

    Args:
        experiment: What a calibration says of the helicopter.
        messages: In the order of their arrival.
    """
    watch = Watch(experiment)
    for message in messages:
        if isinstance(message, Sent):
            if np.isfinite(message.u).all():
                watch.command(message.time, message.u)
            continue
        values = watch.pose(message.arrival, message.pose)
        if values is not None:
            yield values


class Alarm:
    """Turns statistics into events.

    Args:
        band: Of a sound helicopter.
        rate: False alarms an hour.
    """

    def __init__(self, band: Band, rate: float) -> None:
        self.limits: Array = band.limits(rate)
        self._is_out = np.zeros(len(STATISTICS), np.bool_)
        self._outside = np.zeros(len(STATISTICS))
        """When each was last beyond its limit, or near it, s."""
        self._first = -1
        self.seconds = 0.0
        """Watched so far, settling included."""

    def events(self, seen: Watched) -> Iterator[ShadowEvent]:
        """Yield what a pose changes."""
        if self._first < 0:
            self._first = seen.time
        self.seconds = 1e-9 * (seen.time - self._first)
        for i, name in enumerate(STATISTICS):
            value, limit = float(seen.values[i]), float(self.limits[i])
            size = abs(value)
            # What is not known leaves everything as it is.
            if not size < BACK * limit:
                self._outside[i] = self.seconds
            if not self._is_out[i] and size > limit:
                self._is_out[i] = True
                yield ShadowEvent(self.seconds, "left", name, value, limit, f"{_shown(name, value)}: {MEANS[name]}")
            elif self._is_out[i] and self.seconds - self._outside[i] > BACK_S:
                self._is_out[i] = False
                yield ShadowEvent(self.seconds, "back", name, value, limit, f"{_shown(name, value)}: as calibrated")


def _shown(name: str, value: float) -> str:
    """A statistic in words."""
    match name:
        case "thrust":
            return f"thrust {100 * abs(value):.1f} % {'higher' if value > 0 else 'lower'} than expected"
        case "torque":
            return f"yaw acceleration of {value:+.1f} rad/s^2 that nobody commanded"
        case "pitch_trim" | "roll_trim":
            return f"{name.removesuffix('_trim')} trim moved by {value:+.3f} of full stick"
        case _:
            return f"{name}: errors of the prediction {np.sqrt(value):.1f} times as large as expected"
