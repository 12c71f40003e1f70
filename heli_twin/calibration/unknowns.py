"""The unknowns of a fit: the parameters, what belongs to each log, each window's first state and frames in doubt."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from controllers.signals import Array
from heli_twin.calibration.data import Doubt
from heli_twin.calibration.parameters import NAMES

OF_A_LOG = (
    "push_x",
    "push_y",
    "push_z",
    "marker_roll",
    "marker_pitch",
    "marker_yaw",
    "marker_x",
    "marker_y",
    "marker_z",
    "delay_error",
    "frame_phase",
    "servo_phase",
)
"""Nuisance of each log: m/s^2 in the world; tilt of the marker body, rad; its place in the body, m; s."""
LOG_SPREAD = np.array([0.3, 0.3, 0.1] + [0.02] * 3 + [0.01] * 3 + [0.0003, 0.006, 0.0006])
"""Standard deviations of their priors. A flight begins anywhere between two steps of radio and physics; servos begin
their periods anywhere between two times that are tried."""
PUSH, TILT, LEVER, LATE, PHASE, BEGIN = slice(0, 3), slice(3, 6), slice(6, 9), 9, 10, 11
BEGIN_SHARE_S = 0.002
"""Between two times at which servos are tried to begin their periods. With frames of 22 ms, a command comes to the end
of a period every 2 ms: between, the poses change in proportion."""
N_THETA, N_LOG, N_START = len(NAMES), len(OF_A_LOG), 12
FIXED = 1e-5
"""Spread of a prior below which a parameter is held."""


class State(NamedTuple):
    """The unknowns of a fit."""

    theta: Array
    """(n,) parameters; logarithms of positive ones."""
    nuisance: Array
    """(logs, N_LOG)."""
    start: Array
    """(w, 12)."""
    eta: Array
    """(9,) logarithms of `noise.COMPONENTS`."""
    framed: tuple[float | None, ...]
    """For each log when one of the radio's frames is sent, to which `frame_phase` is added: its input acts `delay`
    later, the mean wait for a frame included. None if the wait for a frame is taken as its mean."""
    servo: tuple[float, ...]
    """For each log when a period of the servos begins after such an input, s, to which `servo_phase` is added."""


class Later(NamedTuple):
    """Delay, s, of an event at the helicopter against the state that shows it."""

    frames: float = 0.0
    """Of the radio, which then carry other commands; the servos with them."""
    servo: float = 0.0
    """Periods of the servos."""
    doubt: Doubt | None = None
    """Frames that carry more of another command."""


def columns(log: int) -> NDArray[np.int64]:
    """The places of theta and of a log's nuisance in the vector of all unknowns."""
    return np.concatenate([np.arange(N_THETA), N_THETA + log * N_LOG + np.arange(N_LOG)])
