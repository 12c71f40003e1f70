"""Faults of a recording that refuse a calibration: wrong signs, axes and units, and a flight that is given twice.

They are seen before the fit, by simple regressions on the windows: of the attitude on the sticks, of the position on
the attitude.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from controllers.model import GRAVITY
from controllers.signals import Array
from heli_twin.calibration.checks import CalibrationError
from heli_twin.calibration.data import BIN_STEPS, BINS, STEP_S, Flight
from heli_twin.calibration.drive import drives_of
from heli_twin.calibration.parameters import INDEX, values
from heli_twin.reporting.figure import Curve, Figure, Panel

BIN_S = BIN_STEPS * STEP_S
WRONG_SIGN = -0.3
"""Correlation of a stick with its answer below which its sign is wrong; right sticks have 0.5 to 1."""
LEAST_ANSWER = {"pitch": 0.01, "roll": 0.01, "yaw": 0.015, "z": 0.003}
"""Expected answer (rad, m), root mean square in a window, below which a sign cannot be seen."""
MAX_TURN_DEG = 15.0
"""Angle between positions and attitude from which on the axes are wrong."""
SCALES = (0.3, 3.0)
"""Positions by what the attitude makes of them: drag takes up to half."""
STICKS = {"pitch": "pitch (u_x)", "roll": "roll (u_y)", "z": "thrust (u_z)", "yaw": "yaw (u_yaw)"}


class _Answer(NamedTuple):
    """What a stick should do, and what the poses show, without a trend in each window."""

    channel: str
    expected: Array
    """(w, BINS)."""
    seen: Array
    """(w, BINS); NaN where there is no pose."""


def check_recording(flights: Sequence[Flight], theta: Array) -> None:
    """Refuse a recording with a wrong sign, wrong axes or wrong units.

    Args:
        flights: What would be fitted.
        theta: (n,) the believed helicopter, the fit's vector.

    Raises:
        CalibrationError: Names the log, the fault and what to change.
    """
    _check_twice(flights)
    for flight in flights:
        for answer in _answers(flight, theta):
            _check_sign(flight, answer)
        _check_axes(flight)


def _check_twice(flights: Sequence[Flight]) -> None:
    for i, flight in enumerate(flights):
        for other in flights[:i]:
            if flight.windows.y.shape == other.windows.y.shape and np.array_equal(flight.windows.y, other.windows.y):
                raise CalibrationError(
                    f"{other.name} and {flight.name} hold the same poses: a flight that is given twice would"
                    f" count twice;"
                    " leave one out"
                )


def _answers(flight: Flight, theta: Array) -> Iterator[_Answer]:
    """The answers of the believed helicopter to each stick, alone and in still air."""
    p = {name: float(v) for name, v in zip(INDEX, values(theta), strict=True)}
    drive = drives_of(flight, [theta], [None])[0]
    w2, damp = p["attitude_frequency"] ** 2, 2.0 * p["attitude_damping"] * p["attitude_frequency"]
    attitude = [w2 * STEP_S**2], [1.0, damp * STEP_S - 2.0, 1.0 - damp * STEP_S + w2 * STEP_S**2]
    expected = {
        "pitch": lfilter(*attitude, p["pitch_gain"] * drive.pitch),
        "roll": lfilter(*attitude, -p["roll_gain"] * drive.roll),
        "z": np.cumsum(np.cumsum(drive.thrust - GRAVITY)) * STEP_S**2,
        "yaw": np.cumsum(
            lfilter([p["yaw_gain_per_izz"] * STEP_S], [1.0, p["yaw_damping_per_izz"] * STEP_S - 1.0], drive.yaw)
        )
        * STEP_S,
    }
    steps = flight.windows.first[:, None] + BIN_STEPS * np.arange(BINS) + BIN_STEPS // 2
    present = flight.windows.frames > 0
    for i, (channel, degree) in {2: ("z", 2), 3: ("yaw", 1), 4: ("pitch", 0), 5: ("roll", 0)}.items():
        seen = flight.windows.y[..., i]
        yield _Answer(
            channel,
            _detrended(np.asarray(expected[channel])[steps], present, degree),
            _detrended(seen, present, degree),
        )


def _detrended(rows: Array, present: NDArray[np.bool_], degree: int) -> Array:
    """Rows (w, BINS) without a polynomial in time; NaN where there is no pose."""
    t = np.linspace(-1.0, 1.0, BINS)
    out = np.full(rows.shape, np.nan)
    for row, seen, result in zip(rows, present, out, strict=True):
        fit = np.polynomial.polynomial.polyfit(t[seen], row[seen], degree)
        result[seen] = row[seen] - np.polynomial.polynomial.polyval(t[seen], fit)
    return out


def _check_sign(flight: Flight, answer: _Answer) -> None:
    seen = np.isfinite(answer.seen)
    expected, found = answer.expected[seen], answer.seen[seen]
    size = float(expected.std())
    if size < LEAST_ANSWER[answer.channel]:
        return
    correlation = float(np.mean((expected - expected.mean()) * (found - found.mean())) / (size * found.std() + 1e-12))
    if correlation < WRONG_SIGN:
        raise CalibrationError(
            f"{flight.name}: the {STICKS[answer.channel]} stick has the wrong sign: what it should do and what"
            f" the poses"
            f" show have a correlation of {correlation:.2f}; turn its sign in the recording of the commands",
            _figure("sign", f"{STICKS[answer.channel]} against its answer", answer),
        )


def _check_axes(flight: Flight) -> None:
    """Refuse positions that are turned, mirrored or scaled against the attitude."""
    y, present = flight.windows.y, flight.windows.frames > 0
    yaw, pitch, roll = np.moveaxis(y[..., 3:], -1, 0)
    north = np.cos(yaw) * np.sin(pitch) * np.cos(roll) + np.sin(yaw) * np.sin(roll)
    west = np.sin(yaw) * np.sin(pitch) * np.cos(roll) - np.cos(yaw) * np.sin(roll)
    expected = [
        _detrended(GRAVITY * BIN_S**2 * np.cumsum(np.cumsum(np.where(present, a, 0.0), axis=1), axis=1), present, 2)
        for a in (north, west)
    ]
    found = [_detrended(y[..., i], present, 2) for i in (0, 1)]
    e, f = (np.nan_to_num(a[0]) + 1j * np.nan_to_num(a[1]) for a in (expected, found))
    power = float(np.sum(np.abs(e) ** 2))
    # A centimetre of motion, root mean square, is ten times the noise.
    if power / e.size < 1e-4:
        return
    direct, mirrored = np.sum(np.conj(e) * f) / power, np.sum(e * f) / power
    turn, scale = float(np.degrees(np.angle(direct))), float(np.abs(direct))
    figure = _figure("axes", "position against what the attitude makes of it", _Answer("x", expected[0], found[0]))
    if np.abs(mirrored) > np.abs(direct):
        raise CalibrationError(
            f"{flight.name}: positions are mirrored against the attitude: two axes are swapped, or one has the"
            f" wrong sign;"
            " import the recording with the right --frame",
            figure,
        )
    if abs(turn) > MAX_TURN_DEG:
        raise CalibrationError(
            f"{flight.name}: positions are turned by {turn:.0f} deg against the attitude, about the vertical:"
            f" import the"
            " recording with the right --frame, or align the marker body with the nose",
            figure,
        )
    if not SCALES[0] < scale < SCALES[1]:
        raise CalibrationError(
            f"{flight.name}: positions are {scale:.3g} times what the attitude makes of them: the unit of"
            f" length is wrong;"
            " import the recording with the right --units",
            figure,
        )


def _figure(name: str, title: str, answer: _Answer) -> Figure:
    """Expected and seen, in the window in which most happens."""
    i = int(np.argmax(np.nansum(answer.expected**2, axis=1)))
    t: Array = BIN_S * np.arange(BINS, dtype=np.float64)
    seen = np.isfinite(answer.seen[i])
    unit = "m" if answer.channel in "xyz" else "rad"
    return Figure(
        name,
        title,
        "The window in which most should happen.",
        [
            Panel(
                title,
                "time (s)",
                unit,
                [
                    Curve("expected", t[seen], answer.expected[i][seen], style="steps", color=0),
                    Curve("seen", t[seen], answer.seen[i][seen], style="steps", color=1),
                ],
            )
        ],
    )
