"""Poses and commands as lines of decimal numbers, as a control law in another process writes them.

The first line is `heli_twin 1`. Then, in the order of their arrival, numbers separated by blanks:

| numbers | what |
|---|---|
| 5 | a command, as an external law answers it: time ns, pitch, roll, thrust, yaw, fractions of full stick |
| 8 | a pose: capture time ns, x y z (m, north west up), attitude w x y z |
| 9 | a pose, and the time at which it arrived, ns |
"""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from controllers.laws.external import WIRE_VERSION
from controllers.signals import Array, Pose
from heli_twin.errors import HeliTwinError
from heli_twin.terminal_text import clean

HELLO = f"heli_twin {WIRE_VERSION}"
LONGEST_LINE = 1000
LATEST_NS = 2**63 - 1


class Sent(NamedTuple):
    """A command (4,) that was sent at a time, ns."""

    time: int
    u: Array


class Seen(NamedTuple):
    """A pose that arrived at a time, ns."""

    arrival: int
    pose: Pose


def from_lines(lines: Iterable[str]) -> Iterator[Seen | Sent]:
    """Yield what lines say.

    Raises:
        HeliTwinError: A line is none of these; the message says its number and what is right.
    """
    rows = ((number, line.strip()) for number, line in enumerate(lines, 1))
    number, hello = next(((n, text) for n, text in rows if text), (1, ""))
    if hello.split() != HELLO.split():
        raise HeliTwinError(f"line {number} is {_quoted(hello)}: the first line has to be '{HELLO}'")
    for number, text in rows:
        if text:
            yield _message(text, number)


def _message(text: str, number: int) -> Seen | Sent:
    words = text[: LONGEST_LINE + 1].split()
    if len(words) not in (5, 8, 9) or len(text) > LONGEST_LINE:
        raise HeliTwinError(
            f"line {number} is {_quoted(text)}, which has {len(words)} numbers: write 5 for a command (time ns, pitch,"
            " roll, thrust, yaw) or 8 for a pose (capture time ns, x y z, attitude w x y z)"
        )
    try:
        # Python alone reads 1_000.
        times = [_time(words[0])] + ([_time(words[8])] if len(words) == 9 else [])
        values = np.array([float(word.replace("_", "?")) for word in words[1:8]])
    except ValueError:
        raise HeliTwinError(f"line {number} is {_quoted(text)}, which is no row of numbers with times in ns") from None
    if len(words) == 5:
        if not (np.abs(values) <= 1.0).all():
            raise HeliTwinError(f"line {number} is {_quoted(text)}: inputs are fractions of full stick, -1 to 1")
        return Sent(times[0], values)
    return Seen(times[-1], Pose(times[0], values[:3], values[3:]))


def _time(word: str) -> int:
    time = int(word) if word.lstrip("-").isdecimal() and word.isascii() else int(float(word.replace("_", "?")))
    if not 0 <= time <= LATEST_NS:
        raise ValueError
    return time


def _quoted(text: str) -> str:
    return f"'{clean(text, 60)}'"


def to_lines(messages: Iterable[Seen | Sent]) -> Iterator[str]:
    """Yield the lines of some messages."""
    yield HELLO
    for message in messages:
        if isinstance(message, Sent):
            yield " ".join(map(repr, (message.time, *message.u.tolist())))
        else:
            pose = message.pose
            numbers = (*pose.position.tolist(), *pose.quat_wxyz.tolist())
            yield " ".join(map(repr, (pose.stamp, *numbers, message.arrival)))
