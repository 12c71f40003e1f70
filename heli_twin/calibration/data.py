"""Flights as windows of poses and commands: what the fit compares with the twin.

A window is two seconds of poses, averaged over bins of 20 ms. Each starts from a state of its own, which the fit finds:
gusts of before a window do not matter in it.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from controllers.signals import Array
from heli_twin.calibration.parameters import Lab
from heli_twin.identification.data import MIN_HEIGHT_M, WARM_UP_S, angles_of, clean_poses
from heli_twin.recording import Log

STEP_S = 1e-3
"""Step of the twin's equations."""
WINDOW_STEPS, BIN_STEPS = 2000, 20
BINS = WINDOW_STEPS // BIN_STEPS
CHANNELS = ("x", "y", "z", "yaw", "pitch", "roll")
LEAST_DOUBT = 0.03
"""Least variance p (1 - p) of which command a frame carries that counts as a doubt: p between 3 and 97 %."""
LEAST_SHARE = 0.6
"""Share of the bins of a window that hold a pose; with fewer it is left out."""


class Cut(NamedTuple):
    """Length and spacing of the windows of a flight."""

    steps: int = WINDOW_STEPS
    """Length of a window, a whole number of bins."""
    every: int = WINDOW_STEPS
    """Steps from the begin of one window to that of the next; fewer than its length, and windows overlap."""


FITTED = Cut()
"""Windows of 2 s, one after the other."""


class Windows(NamedTuple):
    """The windows of one flight, all on the grid of its commands."""

    first: NDArray[np.int64]
    """(w,) first step of each, on the grid of the flight."""
    y: Array
    """(w, bins, 6) mean pose of each bin: x y z yaw pitch roll; 0 where there is none."""
    frames: Array
    """(w, bins) number of poses in each bin."""
    weights: Array
    """(w, steps + 1) share of each step in the mean of its bin."""
    early: Array
    """(w, bins) share of the first step after each bin in that bin's mean."""
    start: Array
    """(w, 12) guess of the first state: position, velocity, yaw pitch roll, and their rates."""


class Flight(NamedTuple):
    """One log, ready for the fit."""

    name: str
    seed: int | None
    """Of its experiment if it is a flight of the twin: its gusts depend on it."""
    origin: float
    """Time of step 0, s since the start of the log."""
    steps: int
    sent: "Sent"
    windows: Windows

    @property
    def seconds(self) -> float:
        """Length of all windows together."""
        return self.windows.weights[:, :-1].size * STEP_S


class Doubt(NamedTuple):
    """Some of the frames of which the jitter of the compute time leaves open which command they carry."""

    number: int
    """Of the first one."""
    every: int
    """From one to the next, counted in such frames."""


class Held:
    """Inputs that are each held until the next, and their integrals."""

    def __init__(self, t: Array, u: Array) -> None:
        # A second of the first command before, a minute of the last one behind.
        self.t, self.u = np.concatenate([[t[0] - 1.0], t[1:], [t[-1] + 60.0]]), u
        held = np.diff(self.t)[:, None]
        self.once = np.vstack([np.zeros(u.shape[1]), np.cumsum(u * held, axis=0)])
        self.twice = np.vstack([np.zeros(u.shape[1]), np.cumsum(self.once[:-1] * held + 0.5 * u * held**2, axis=0)])

    def at(self, t: Array) -> Array:
        """Return the inputs (..., m) at times (...), s."""
        return self.u[self._place(t)]

    def integral(self, t: Array) -> Array:
        """Return the integral (n, m) up to ascending times (n,)."""
        return np.stack([np.interp(t, self.t, column) for column in self.once.T], axis=-1)

    def double_integral(self, t: Array) -> Array:
        """Return the integral (n, m) of the integral."""
        i = self._place(t)
        since = (t - self.t[i])[:, None]
        return self.twice[i] + self.once[i] * since + 0.5 * self.u[i] * since**2

    def _place(self, t: Array) -> NDArray[np.int64]:
        return np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.u) - 1)


class Sent:
    """The sent commands as the radio rounds them, and the inputs that they become at the helicopter."""

    def __init__(self, log: Log, lab: Lab) -> None:
        u = np.clip(log.sent.u, (-1.0, -1.0, 0.0, -1.0), 1.0)
        if lab.levels:
            u = np.round(u * (0.5 * lab.levels)) / (0.5 * lab.levels)
        self.t, self.u = 1e-9 * log.sent.time.astype(np.float64), u
        self.frame, self._jitter = lab.frame_period, lab.jitter
        self.held = Held(self.t, u)

    def acting(self, delay: float, t: Array, phase: float | None = None, doubt: Doubt | None = None) -> Array:
        """Return the mean input (n, 4) over each step that begins at one of `t` (n,), s, on a grid of `STEP_S`.

        A command waits for the next frame of the radio. Where the frames are unknown, it is moved by half the time
        between two, and smoothed over it.

        Args:
            delay: Of the whole way, with the mean wait, s.
            t: Ascending, `STEP_S` apart.
            phase: When the input of one of the frames acts, s; None if it is unknown.
            doubt: Frames that carry more of the other command, as in `frames`.
        """
        edges = np.append(t, t[-1] + STEP_S)
        least = delay - 0.5 * self.frame
        if not self.frame:
            return np.diff(self.held.integral(edges - least), axis=0) / STEP_S
        if phase is not None:
            return np.diff(self.frames(least, edges, phase, doubt).integral(edges), axis=0) / STEP_S
        late = self.held.double_integral(edges - least - self.frame)
        return np.diff(self.held.double_integral(edges - least) - late, axis=0) / (STEP_S * self.frame)

    def frames(self, least: float, t: Array, phase: float, doubt: Doubt | None = None) -> Held:
        """Return the inputs that the frames bring; a command within the jitter of a frame counts by its probability.

        Args:
            least: Delay of a command that does not wait, s.
            t: (n,) times between which they are wanted, s.
            phase: When the input of one of the frames acts, s.
            doubt: Frames in doubt whose probability is moved by one standard deviation of what they carry.
        """
        acts, share, newest = self._shares(least, t, phase)
        if doubt:
            some = _in_doubt(share)[doubt.number :: doubt.every]
            share[some] += np.where(share[some] < 0.5, 1.0, -1.0) * np.sqrt(share[some] * (1.0 - share[some]))
        before = np.maximum(newest - 1, 0)
        return Held(acts, share[:, None] * self.u[newest] + (1.0 - share[:, None]) * self.u[before])

    def doubtful(self, least: float, t: Array, phase: float) -> Array:
        """Return when the frames act of which the command is in doubt, s; arguments as in `frames`."""
        acts, share, _ = self._shares(least, t, phase)
        return acts[_in_doubt(share)]

    def _shares(self, least: float, t: Array, phase: float) -> tuple[Array, Array, NDArray[np.int64]]:
        """When frames act, the probability that each carries its newest command, and the number of that."""
        first, last = (np.floor((edge - phase) / self.frame) for edge in (t[0] - 1.0, t[-1]))
        acts = phase + self.frame * np.arange(first, last + 2)
        # The deviation of a uniform jitter, as a normal one: the fit needs a slope without corners.
        deviation = max(self._jitter / np.sqrt(3.0), 1e-6)
        reach = acts - least + 3.0 * deviation
        newest = np.clip(np.searchsorted(self.t, reach, side="right") - 1, 0, len(self.u) - 1)
        return acts, np.asarray(ndtr((acts - least - self.t[newest]) / deviation)), newest


def _in_doubt(share: Array) -> NDArray[np.int64]:
    """Places of the frames whose probability of one command is neither 0 nor 1."""
    return np.flatnonzero(share * (1.0 - share) > LEAST_DOUBT)


def flight_of(log: Log, name: str, lab: Lab, seed: int | None, cut: Cut = FITTED) -> Flight | None:
    """Return a log as windows; None if it has not a single one.

    Args:
        log: Only `/mocap/pose` and `/command/sent` are read.
        name: Of the log, in messages.
        lab: What is known of the radio.
        seed: Of the flight, if it is one of the twin.
        cut: Length and spacing of the windows.
    """
    t, position, quat = clean_poses(log)
    if len(log.sent.time) < 2 or len(t) < 2:
        return None
    pose = np.column_stack([position, angles_of(quat)])
    origin = 1e-9 * float(log.sent.time[0])
    end = min(1e-9 * float(log.sent.time[-1]), float(t[-1]))
    inside = (t >= origin + WARM_UP_S) & (t <= end) & (pose[:, 2] > MIN_HEIGHT_M)
    pieces = list(_windows((t[inside] - origin) / STEP_S, pose[inside], cut))
    if not pieces:
        return None
    windows = Windows(*(np.stack(column) for column in zip(*pieces, strict=True)))
    return Flight(name, seed, origin, int(windows.first[-1]) + cut.steps + 1, Sent(log, lab), windows)


def _windows(s: Array, pose: Array, cut: Cut) -> Iterator[tuple[int, Array, Array, Array, Array, Array]]:
    """Cut poses at times s (n,), in steps, into windows; each begins with a pose."""
    i = 0
    while i < len(s):
        # A step that a pose was taken at, up to rounding, so that bins hold the same number of poses.
        first = int(np.floor(s[i] + 1e-6))
        j = int(np.searchsorted(s, first + cut.steps - 1e-6))
        window = _window(s[i:j] - first, pose[i:j], cut.steps)
        if window is not None:
            yield first, *window
        i = max(int(np.searchsorted(s, first + cut.every - 1e-6)), i + 1)


def _window(s: Array, pose: Array, steps: int) -> tuple[Array, Array, Array, Array, Array] | None:
    step = np.floor(s + 1e-6).astype(np.int64)
    share = np.clip(s - step, 0.0, 1.0)
    bins, count = step // BIN_STEPS, steps // BIN_STEPS
    frames = np.bincount(bins, minlength=count).astype(np.float64)
    if np.count_nonzero(frames) < LEAST_SHARE * count or frames[0] == 0:
        return None
    many = np.maximum(frames, 1.0)
    y = np.stack([np.bincount(bins, column, count) for column in pose.T], axis=-1) / many[:, None]
    weights, early = np.zeros(steps + 1), np.zeros(count)
    np.add.at(weights, step, (1.0 - share) / many[bins])
    crosses = (step + 1) % BIN_STEPS == 0
    np.add.at(weights, step[~crosses] + 1, (share / many[bins])[~crosses])
    np.add.at(early, bins[crosses], (share / many[bins])[crosses])
    return y, frames, weights, early, _start(s * STEP_S, pose)


def _start(t: Array, pose: Array) -> Array:
    """The state at t = 0 from a parabola through the first 0.2 s of poses."""
    near = t <= 0.2
    degree = min(2, int(near.sum()) - 1)
    fit: Array = np.polynomial.polynomial.polyfit(t[near], pose[near], degree).astype(np.float64)
    rates = fit[1] if len(fit) > 1 else np.zeros(6)
    return np.concatenate([fit[0, :3], rates[:3], fit[0, 3:], rates[3:]])
