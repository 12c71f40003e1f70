"""Blemishes of a recording (lost frames, repeated times, half turns, ...): counted and left out."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from controllers.rotations import wrap_angle, yaw_of
from controllers.signals import Array
from heli_twin.exchange.formats import ImportRefused, Take
from heli_twin.exchange.frames import FRAMES, LENGTH_UNITS_M, to_ours

MAX_SECONDS = 36_000.0
"""The longest flight that an experiment can describe."""
SHORTEST_PERIOD_S, LONGEST_PERIOD_S = 4e-4, 0.2
"""Between two frames of cameras; anything else is a clock in another unit."""
TIME_UNITS_S = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
MAX_DISORDER = 0.1
"""Share of rows that may be late or carry no attitude; more is a file that is not what it says."""
FLIP_ANGLE_RAD, FLIP_SECONDS = np.radians(150.0), 1.0
"""A heading that turns by more from one frame to the next, and back within this time, was a mistaken marker."""
MAX_GAP_S = 60.0
"""Longest time without a row, and longest delay of a pose: after that no estimate means anything."""
GAP_PERIODS = 2.5
"""Periods without a row that count as a gap."""

Mask = NDArray[np.bool_]


class Blemish(NamedTuple):
    """Something that was wrong with some rows."""

    name: str
    """Of its event in the log."""
    rows: int
    text: str
    """For a person: of what there were so many rows, and what was done."""
    first_s: float
    """When it was first seen, from the first row on."""


class Clean(NamedTuple):
    """A recording in our axes and units, in the order of its time, without its blemishes."""

    time: Array
    """(n,) when the cameras saw each pose, s from the first row on."""
    arrival: Array
    """(n,) when it reached the ground station, s, NaN where the file does not tell."""
    position: Array
    """(n, 3) world, m."""
    quat_wxyz: Array
    """(n, 4)."""
    command_time: Array
    """(m,) s."""
    u: Array
    """(m, 4) fraction of full stick, NaN for an input that the file does not have."""
    rate: float
    """Frames a second."""
    lost: int
    """Rows without a pose."""
    blemishes: tuple[Blemish, ...]
    start: float = 0.0
    """Time of the first row on the recording's own clock, s."""


def clean(take: Take, *, frame: str = "", unit: str = "", rate: float = 0.0) -> Clean:
    """Bring a take into our axes and units, and leave out what is wrong with it.

    Args:
        take: As its file has it.
        frame: Of its axes, a key of `FRAMES`; empty for the take's own.
        unit: Of its lengths, a key of `LENGTH_UNITS_M`, whatever the file says; empty for the take's own.
        rate: Frames a second, where the time column counts frames; 0 for none.

    Raises:
        ImportRefused: The time column is in no unit, or the rows are in no order.
    """
    found: list[Blemish] = []
    time = _seconds(take, rate)
    known = np.isfinite(time)
    if not known.any():
        raise ImportRefused("no row has a time: say which column it is with --map time=COLUMN")
    start = time[known][0]
    time, arrival = time - start, _arrival(take, rate) - start
    _check_arrival(take, time, arrival)
    if unit and take.length_unit == "mapped":
        raise ImportRefused(f"--units {unit}: the map has factors of lengths already; leave one of the two out")
    position = take.position * (LENGTH_UNITS_M[unit] / LENGTH_UNITS_M[take.length_unit] if unit else 1.0)
    position, quat_wxyz = to_ours(FRAMES[frame or take.frame], position, _unit_quaternions(take))
    order = _order(time, known, found)
    time, arrival, position, quat_wxyz = time[order], arrival[order], position[order], quat_wxyz[order]
    u = None if take.u is None else take.u[order]
    _check_length(time)
    posed = np.isfinite(position).all(axis=1) & np.isfinite(quat_wxyz).all(axis=1)
    posed &= ~_marked(found, "rows_of_zeros", "rows of zeros: frames without the body", time, _zeros(take, order))
    posed &= ~_marked(found, "flips", "poses turned by half a turn: left out", time, _flips(time, quat_wxyz, posed))
    posed &= ~_marked(found, "repeated_times", "rows with the time of another: left out", time, _repeats(time, posed))
    if not posed.any():
        raise ImportRefused("there is not a single pose: are position and attitude mapped to the right columns?")
    lost = int(len(time) - posed.sum())
    moments = time[posed]
    period = float(np.median(np.diff(moments))) if len(moments) > 1 else LONGEST_PERIOD_S
    gap = np.append(np.diff(moments) > GAP_PERIODS * period, False)
    longest = float(np.diff(moments).max(initial=0.0))
    _marked(found, "gaps", f"gaps, the longest {longest:.2f} s", moments, gap)
    bunched = np.append(np.diff(arrival[posed]) == 0, False)
    _marked(found, "bunched_arrivals", "poses that arrived together with the next", moments, bunched)
    commanded = np.zeros(len(time), bool) if u is None else np.isfinite(u).any(axis=1)
    return Clean(
        moments,
        arrival[posed],
        position[posed],
        quat_wxyz[posed],
        time[commanded],
        np.empty((0, 4)) if u is None else u[commanded],
        1.0 / period,
        lost,
        tuple(found),
        float(start),
    )


def _seconds(take: Take, rate: float) -> Array:
    """The time column in seconds."""
    steps = np.diff(np.sort(take.time[np.isfinite(take.time)]))
    steps = steps[steps > 0]
    if not len(steps):
        return take.time
    step = float(np.median(steps))
    if rate:
        return take.time / rate if step == 1.0 else take.time * _factor(take, step)
    return take.time * _factor(take, step)


def _factor(take: Take, step: float) -> float:
    if take.time_unit == "s":
        units = {"s": 1.0}
    elif step == 1.0:
        raise ImportRefused("the time column counts frames: say their rate in Hz with --rate")
    else:
        units = TIME_UNITS_S
    factor = next((f for f in units.values() if SHORTEST_PERIOD_S <= f * step <= LONGEST_PERIOD_S), None)
    if factor is None:
        raise ImportRefused(
            f"rows are {step:g} apart in the time column, which is no period of cameras in {', '.join(units)}"
            f" ({SHORTEST_PERIOD_S:g} to {LONGEST_PERIOD_S:g} s): map it with its factor, --map time=COLUMN*FACTOR"
        )
    return factor


def _arrival(take: Take, rate: float) -> Array:
    if take.arrival is None:
        return np.full(len(take.time), np.nan)
    steps = np.diff(np.sort(take.time[np.isfinite(take.time)]))
    steps = steps[steps > 0]
    return take.arrival * (_factor(take, float(np.median(steps))) if len(steps) and not rate else 1.0)


def _check_arrival(take: Take, time: Array, arrival: Array) -> None:
    with np.errstate(invalid="ignore"):
        late = np.flatnonzero(arrival - time > MAX_GAP_S)
        wrong = np.flatnonzero(arrival < time)
    if len(late):
        row = late[0]
        raise ImportRefused(
            f"{_line(take, row)}arrival {arrival[row] - time[row]:.9g} s after the frame, {MAX_GAP_S:g} s at most"
        )
    if len(wrong) > MAX_DISORDER * np.isfinite(arrival).sum():
        row = wrong[0]
        when = f"arrival {arrival[row]:.9g} s does not follow the picture, {time[row]:.9g} s"
        raise ImportRefused(_line(take, row) + when)


def _line(take: Take, row: int) -> str:
    return "" if take.lines is None else f"line {take.lines[row]}: "


def _unit_quaternions(take: Take) -> Array:
    """Attitudes of length 1; NaN where there is none."""
    quat_wxyz = take.quat_wxyz
    norm = np.linalg.norm(quat_wxyz, axis=1, keepdims=True)
    wrong = ~((norm > 0.9) & (norm < 1.1))
    odd = np.flatnonzero(np.isfinite(norm) & (norm > 0.0) & wrong)
    if len(odd) > MAX_DISORDER * len(norm):
        length = float(norm[odd[0], 0])
        raise ImportRefused(
            f"{_line(take, odd[0])}the quaternion has length {length:.3g}, not 1: are the right columns mapped?"
        )
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(wrong, np.nan, quat_wxyz / norm)


def _order(time: Array, known: Mask, found: list[Blemish]) -> NDArray[np.int64]:
    """Indices of the rows with a time, in the order of their time."""
    rows = np.flatnonzero(known)
    moments = time[rows]
    late = moments < np.maximum.accumulate(moments)
    if late.sum() > MAX_DISORDER * len(rows):
        raise ImportRefused(f"{late.sum()} of {len(rows)} rows come before the row above them: sort the rows by time")
    _marked(found, "rows_without_a_time", "rows without a time: left out", np.zeros(len(time)), ~known)
    _marked(found, "late_rows", "rows that stand too late in the file: put in their place", moments, late)
    return rows[np.argsort(moments, kind="stable")]


def _marked(found: list[Blemish], name: str, text: str, time: Array, rows: Mask) -> Mask:
    """Note a blemish of some rows, if there are any."""
    if rows.any():
        found.append(Blemish(name, int(rows.sum()), text, float(time[int(np.argmax(rows))])))
    return rows


def _check_length(time: Array) -> None:
    if time[-1] > MAX_SECONDS:
        raise ImportRefused(
            f"the last row is {time[-1]:.9g} s after the first, {MAX_SECONDS:g} s at most: cut the recording, or"
            " map the time with its factor, --map time=COLUMN*FACTOR"
        )
    gaps = np.diff(time)
    if gaps.max(initial=0.0) > MAX_GAP_S:
        raise ImportRefused(
            f"there is no row for {gaps.max():.9g} s after {time[gaps.argmax()]:.9g} s, {MAX_GAP_S:g} s at most:"
            " split the recording there"
        )


def _zeros(take: Take, order: NDArray[np.int64]) -> Mask:
    """Rows of a lost body as some software writes it: at the origin, with no attitude or none that differs."""
    zero = (take.position[order] == 0).all(axis=1)
    return zero if not zero.all() else np.zeros(len(order), bool)


def _flips(time: Array, quat_wxyz: Array, posed: Mask) -> Mask:
    """Rows between two turns by about half a turn, each from one frame to the next."""
    flipped = np.zeros(len(time), bool)
    rows = np.flatnonzero(posed)
    if len(rows) < 3:
        return flipped
    yaw = yaw_of(quat_wxyz[rows])
    turns = np.flatnonzero(np.abs(wrap_angle(np.diff(yaw))) > FLIP_ANGLE_RAD) + 1
    i = 0
    while i + 1 < len(turns):
        start, end = turns[i], turns[i + 1]
        if time[rows[end]] - time[rows[start]] <= FLIP_SECONDS:
            flipped[rows[start:end]] = True
            i += 2
        else:
            i += 1
    return flipped


def _repeats(time: Array, posed: Mask) -> Mask:
    """Rows with a pose and the time of an earlier row with a pose."""
    repeated = np.zeros(len(time), bool)
    rows = np.flatnonzero(posed)
    repeated[rows[1:]] = np.diff(time[rows]) == 0
    return repeated
