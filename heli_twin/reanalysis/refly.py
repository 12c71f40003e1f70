"""Fly a log's experiment again, and find the first difference between the two flights.

Two flights of one experiment are equal in every message but the measured times, on the same host and build. Other
processors and libraries round differently: there the paths have to agree within `POSITION_TOLERANCE_M` and
`YAW_TOLERANCE_RAD`.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from google.protobuf.message import DecodeError, Message

from controllers.rotations import wrap_angle
from heli_twin.errors import HeliTwinError
from heli_twin.experiment.several_text import changed_several
from heli_twin.experiment.text import changed
from heli_twin.flight import INVALID
from heli_twin.logbook import PHYSICS, flown_experiment, physics_notice
from heli_twin.mission import Result, fly
from heli_twin.recording import Log, flight_pb2, ships_pb2
from heli_twin.recording.foxglove import LogMessage
from heli_twin.recording.log import SHIP_KEY
from heli_twin.recording.reader import within_ship
from heli_twin.recording.records import Messages
from heli_twin.recording.schema import LATER_WIRES, MEASURED, SHIP_WIRES, WIRES, topics_of
from heli_twin.several.fly import SeveralResult, flown_several, fly_several
from heli_twin.terminal_text import clean

POSITION_TOLERANCE_M = 0.002
"""Between two machines. One thrust count that rounds the other way (2/682 of full stick for a radio frame of 22 ms)
changes the speed by 1.2 mm/s and the position by about a millimetre; rounding alone changes it by less than 1e-9 m."""
YAW_TOLERANCE_RAD = np.radians(0.5)
"""Between two machines; a yaw count that rounds the other way changes the yaw by 0.1 deg."""
_NOT_PLATFORM = ("started", "processes", PHYSICS)
"""Metadata of a log that do not belong to host and build; the number of cores changes no result."""

Verdict = Literal["identical", "within tolerance", "different"]
"""`within tolerance` is possible only on another host, build or physics version."""


class FirstDifference(NamedTuple):
    """The first field in which two flights differ."""

    topic: str
    time: int
    """Simulated, ns."""
    field: str
    """Name of the field, with an index if it is an array; in parentheses what differs if it is no field."""
    logged: Any
    reflown: Any


@dataclass(frozen=True)
class Refly:
    """A logged flight, and the flight of its experiment again."""

    logged: Log
    result: Result | SeveralResult
    overrides: tuple[str, ...]
    difference: FirstDifference | None
    """None if all messages but the measured times are equal."""
    platforms: Mapping[str, tuple[str, str]]
    """Facts on host and build that are not the same: as logged, and now."""
    position_deviation: float
    """Largest distance between the two helicopters at one time, m; infinite if their times have nothing in common."""
    yaw_deviation: float
    """Largest difference of their yaw at one time, rad."""

    @property
    def verdict(self) -> Verdict:
        """Agreement of the two flights."""
        if self.difference is None:
            return "identical"
        near = self.position_deviation <= POSITION_TOLERANCE_M and self.yaw_deviation <= YAW_TOLERANCE_RAD
        same_end = self.logged.outcome == self.result.log.outcome or is_beginning(self.logged)
        elsewhere = self.platforms or physics_notice(self.logged)
        return "within tolerance" if elsewhere and near and same_end else "different"


def refly(
    log: Log,
    overrides: Sequence[str] = (),
    *,
    log_dir: Path | str | None = None,
    progress: Callable[[float], None] = lambda t: None,
) -> Refly:
    """Fly a log's experiment again.

    Args:
        log: A flight of the twin. A recovered log is compared as far as it goes.
        overrides: Changes, each `path.to.field=value`; the seed stays unless it is changed too.
        log_dir: Folder for the new log; None keeps it in memory.
        progress: Called with the simulated time, s, at every control step.

    Raises:
        HeliTwinError: The log holds no flight that can be flown, or an override is wrong.
    """
    if log.origin == "import":
        raise HeliTwinError("the log was imported from a recording: there is no simulated flight to fly again")
    if log.origin == "resolve":
        raise HeliTwinError("the log holds counterfactual inputs: fly the log again that it was resolved from")
    if ship := log.metadata.get(SHIP_KEY):
        raise HeliTwinError(f"{clean(ship, 60)} flew with others in one room: fly the log of all again, without #")
    result = _flown_again(log, overrides, log_dir, progress)
    position_m, yaw_rad = _deviation(log, result.log)
    return Refly(
        log,
        result,
        tuple(overrides),
        first_difference(log, result.log),
        _platforms(log.metadata, result.log.metadata),
        position_m,
        yaw_rad,
    )


def _flown_again(
    log: Log, overrides: Sequence[str], log_dir: Path | str | None, progress: Callable[[float], None]
) -> Result | SeveralResult:
    if log.ships:
        return fly_several(changed_several(flown_several(log), overrides), log_dir=log_dir, progress=progress)
    return fly(changed(flown_experiment(log), overrides), log_dir=log_dir, progress=progress)


def first_difference(logged: Log, reflown: Log) -> FirstDifference | None:
    """The earliest message that differs, measured times apart; at one time, of the first topic of the log."""
    differences: list[FirstDifference] = []
    ships = tuple(dict.fromkeys([*logged.ships, *reflown.ships]))
    for topic in (topic.name for topic in topics_of(ships) if not topic.name.endswith(MEASURED)):
        ours = logged.messages.get(topic, Messages((), ()))
        theirs = reflown.messages.get(topic, Messages((), ()))
        difference = _first_on(topic, ours, theirs, prefix=is_beginning(logged))
        if difference is not None:
            differences.append(difference)
    return min(differences, key=lambda difference: difference.time, default=None)


def is_beginning(log: Log) -> bool:
    """Return whether a log is only the beginning of the flight that its experiment says."""
    return log.ending.recovered or log.outcome == INVALID


def _first_on(topic: str, logged: Messages, reflown: Messages, prefix: bool) -> FirstDifference | None:
    """The first difference on one topic; with `prefix`, the logged messages may end before the others."""
    for (t, data), (t_again, again) in zip(
        zip(logged.times, logged.data, strict=True), zip(reflown.times, reflown.data, strict=True), strict=False
    ):
        if t != t_again:
            return FirstDifference(topic, min(t, t_again), "(time of the message, ns)", t, t_again)
        if data != again:
            return _field(topic, t, bytes(data), bytes(again))
    n, m = len(logged.times), len(reflown.times)
    if n < m and not prefix:
        return FirstDifference(topic, reflown.times[n], "(a message)", "missing", "there")
    return FirstDifference(topic, logged.times[m], "(a message)", "there", "missing") if m < n else None


_TYPES: Mapping[str, type[Message]] = {"/events": LogMessage} | {
    topic.name: getattr(ships_pb2 if topic in SHIP_WIRES else flight_pb2, topic.schema_name.rpartition(".")[2])
    for topic in WIRES + LATER_WIRES + SHIP_WIRES
    if topic.schema_name.startswith("heli_twin.")
}


def _field(topic: str, t: int, logged: bytes, reflown: bytes) -> FirstDifference:
    """The first field in which two messages differ."""
    unknown = FirstDifference(topic, t, "(the message)", f"{len(logged)} bytes", f"{len(reflown)} bytes")
    kind = _TYPES.get(topic) or _TYPES.get(within_ship(topic))
    if kind is None:
        return unknown
    try:
        ours, theirs = (kind.FromString(data) for data in (logged, reflown))
    except DecodeError:
        return unknown
    for field in ours.DESCRIPTOR.fields:
        a, b = getattr(ours, field.name), getattr(theirs, field.name)
        if not field.is_repeated:
            if repr(a) != repr(b):
                return FirstDifference(topic, t, field.name, a, b)
            continue
        if len(a) != len(b):
            return FirstDifference(topic, t, f"(length of {field.name})", len(a), len(b))
        unequal = (i for i, pair in enumerate(zip(a, b, strict=True)) if repr(pair[0]) != repr(pair[1]))
        i = next(unequal, None)
        if i is not None:
            return FirstDifference(topic, t, f"{field.name}[{i}]", a[i], b[i])
    return unknown


def _platforms(logged: Mapping[str, str], now: Mapping[str, str]) -> dict[str, tuple[str, str]]:
    keys = sorted((logged.keys() | now.keys()) - set(_NOT_PLATFORM))
    pairs = {key: (logged.get(key, "unknown"), now.get(key, "unknown")) for key in keys}
    return {key: pair for key, pair in pairs.items() if pair[0] != pair[1]}


@np.errstate(all="ignore")
def _deviation(logged: Log, reflown: Log) -> tuple[float, float]:
    """Largest distance, m, and yaw difference, rad, between the two helicopters at the times that both logs have."""
    if logged.ships:
        if [*logged.ships] != [*reflown.ships]:
            return np.inf, np.inf
        each = [_deviation(logged.ship(name), reflown.ship(name)) for name in logged.ships]
        return max(distance for distance, _ in each), max(yaw for _, yaw in each)
    _, ours, theirs = np.intersect1d(logged.truth.time, reflown.truth.time, return_indices=True)
    if not len(ours):
        return np.inf, np.inf
    distance = np.linalg.norm(logged.truth.position[ours] - reflown.truth.position[theirs], axis=1)
    yaw_difference = wrap_angle(logged.truth.yaw[ours] - reflown.truth.yaw[theirs])
    return float(distance.max()), float(np.abs(yaw_difference).max())
