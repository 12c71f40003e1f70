"""The windows of all flights stacked: what a state of the fit predicts, and its derivatives."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from controllers.signals import Array
from heli_twin.calibration import noise
from heli_twin.calibration.data import STEP_S, Doubt, Flight
from heli_twin.calibration.drive import GRID_S, drives_of
from heli_twin.calibration.markers import by_lever, by_tilt, lever_turned
from heli_twin.calibration.motion import STRIDE, Lanes, simulate, transitions
from heli_twin.calibration.parameters import INDEX, NAMES, SPREAD, Lab
from heli_twin.calibration.unknowns import (
    BEGIN,
    FIXED,
    LATE,
    LEVER,
    N_LOG,
    N_START,
    N_THETA,
    PHASE,
    PUSH,
    TILT,
    Later,
    State,
)

STEPS = {
    "delay": 2e-5,
    "hub_drag_per_iyy": 0.1,
    "thrust_yaw_coupling_per_izz": 1e-2,
    "drag_z_per_mass": 1e-3,
    "battery_drain": 1e-5,
    "battery_droop": 1e-3,
    "servo_backlash": 2e-3,
    "servo_slowness": 0.02,
    "ground_effect": 0.05,
}
"""Steps of the differences; 1e-4 for the others."""
START_STEP = np.array([0, 0, 0, 1e-4, 1e-4, 1e-4, 1e-4, 1e-4, 1e-4, 1e-3, 1e-3, 1e-3])
PUSH_STEP = 1e-3
DRIVEN = (
    "delay",
    "servo_lag",
    "thrust_lag",
    "yaw_lag",
    "thrust_per_mass",
    "battery_drain",
    "battery_droop",
    "servo_backlash",
    "servo_slowness",
)
"""Parameters that change what the actuators do."""
FIRST = {"servo_backlash": 0.02, "servo_slowness": 0.3}
"""Where the fit of these begins: at zero they have no slope."""
LEAST = np.array([0.0 if name in (*FIRST, "drag_z_per_mass") else -np.inf for name in NAMES])
"""Least values. With a drag below zero, which pushes, the height of a window grows out of all bounds."""
BLIND = 30.0
"""Standard deviations of the noise by the prior's ones in a first fit, whose residuals are errors of the parameters."""
SOON = Later(frames=2e-5), Later(servo=1e-4)
"""Steps of the differences for `frame_phase` and `servo_phase`."""
MOST_DOUBTS = 40
"""Frames of a window that are unknowns, at most. With a jitter of several milliseconds most are in doubt, as noise."""
LASTING_S = 0.06
"""Time for which a command before a window still matters in it, the lag of the thrust: of the window's first state, the
actuators are no part."""


class Problem:
    """The windows of all flights, stacked."""

    def __init__(self, flights: Sequence[Flight], lab: Lab, prior: Array, spread: Array = SPREAD) -> None:
        self.flights, self.lab, self.prior, self.spread = tuple(flights), lab, prior, spread
        windows = [flight.windows for flight in flights]
        self.y = np.concatenate([w.y for w in windows])
        self.frames = np.concatenate([w.frames for w in windows])
        self.weights = np.concatenate([w.weights for w in windows])
        self.early = np.concatenate([w.early for w in windows])
        self.start = np.concatenate([w.start for w in windows])
        self.log_of: NDArray[np.int64] = np.repeat(np.arange(len(flights)), [len(w.first) for w in windows])
        self.present = self.frames > 0

    def initial(self) -> State:
        """The prior's helicopter, with the first states that the poses suggest, and large noise."""
        theta = self.started(self.prior, self.spread)
        eta = np.log(noise.PRIOR) + np.log(BLIND) * np.array([name != "gust_time" for name in noise.COMPONENTS])
        return State(
            theta,
            np.zeros((len(self.flights), N_LOG)),
            self.start.copy(),
            eta,
            (None,) * len(self.flights),
            (0.0,) * len(self.flights),
        )

    @staticmethod
    def started(theta: Array, spread: Array) -> Array:
        """Return a vector in which the free parameters without a slope at zero have left it."""
        out = theta.copy()
        for name, value in FIRST.items():
            out[INDEX[name]] = value if spread[INDEX[name]] > FIXED else 0.0
        return out

    def predict(self, state: State) -> Array:
        """Poses (w, bins, 6) that a state predicts."""
        return self.measured(self.simulated(state, state.theta[None], [Later()])[0], state)

    def linearise(self, state: State) -> tuple[Array, Array, Array]:
        """Predicted poses (w, bins, 6), and their derivatives by theta and a log's nuisance, and by a window's own.

        A window's own are its first state (12) and, in standard deviations, what its frames in doubt carry.
        """
        doubts = self.doubts(state)
        steps = np.array([STEPS.get(name, 1e-4) for name in NAMES])
        free = np.flatnonzero(self.spread > FIXED)
        n, m = 1 + len(free), 1 + len(free) + N_START - 3
        later = [*SOON, *doubts]
        variants = state.theta + np.vstack([np.zeros(N_THETA), np.diag(steps)[free], np.zeros((len(later), N_THETA))])
        out = self.simulated(state, variants, [Later()] * n + later, START_STEP)
        by_timing = np.stack([(out[n + i] - out[0]) / max(soon.frames, soon.servo) for i, soon in enumerate(SOON)])
        by_doubt = out[n + len(SOON) : n + len(later)] - out[0]
        out = np.delete(out, range(n, n + len(later)), axis=0)
        by_theta = np.zeros((N_THETA, *out.shape[1:]))
        by_theta[free] = (out[1:n] - out[0]) / steps[free, None, None, None]
        by_start = (out[n:m] - out[0]) / START_STEP[3:, None, None, None]
        by_push = (out[m:] - out[0]) / PUSH_STEP
        by_place = np.zeros((3, *out.shape[1:]))
        by_place[range(3), :, :, range(3)] = 1.0
        jacobian = np.moveaxis(np.concatenate([by_theta, by_push, by_timing]), 0, -1)
        first = np.moveaxis(np.concatenate([by_place, by_start, by_doubt]), 0, -1)
        h, lever = out[0], state.nuisance[self.log_of][:, LEVER]
        turned = lever_turned(h, lever)
        for columns in (jacobian, first):
            columns[..., :3, :] += np.einsum("wbij,wbjc->wbic", turned, columns[..., 3:, :])
        of_log = np.concatenate(
            [
                jacobian[..., N_THETA : -len(SOON)],
                by_tilt(h),
                by_lever(h),
                jacobian[..., [INDEX["delay"]]],
                jacobian[..., -len(SOON) :],
            ],
            axis=-1,
        )
        seen = self.present[:, :, None, None]
        jacobian = np.concatenate([jacobian[..., :N_THETA], of_log], axis=-1) * seen
        return self.measured(h, state), jacobian, first * seen

    def doubts(self, state: State) -> list[Later]:
        """Return the frames in doubt, so divided that no window has two of a part; none if they are too many."""
        most = 0
        for i, flight in enumerate(self.flights):
            framed = state.framed[i]
            if framed is not None:
                delay = float(state.theta[INDEX["delay"]] + state.nuisance[i, LATE])
                edges = flight.origin + STEP_S * np.arange(flight.steps + 1, dtype=np.float64)
                phase = framed + state.nuisance[i, PHASE] + delay
                acts = flight.sent.doubtful(delay + GRID_S - 0.5 * self.lab.frame_period, edges, phase)
                begin = flight.origin + STEP_S * flight.windows.first
                ends = begin - LASTING_S, begin + STEP_S * (self.weights.shape[1] - 1)
                first, last = (np.searchsorted(acts, end) for end in ends)
                most = max(most, int((last - first).max()))
        return [Later(doubt=Doubt(number, most)) for number in range(most if most <= MOST_DOUBTS else 0)]

    def windage(self, state: State) -> noise.Windage:
        """Return what chance does along the windows of a state."""
        drive = self._drives(state, [state.theta], [Later()])
        push = state.nuisance[self.log_of][None, :, PUSH]
        lanes = Lanes(state.theta[None], state.start[None], push, drive, np.zeros(1, np.int64))
        return noise.Windage(transitions(lanes, self.weights, self.early, self.lab), self.frames)

    def residual(self, predicted: Array) -> Array:
        """Poses minus prediction; 0 where there is no pose."""
        return (self.y - predicted) * self.present[..., None]

    def measured(self, h: Array, state: State) -> Array:
        """Return the poses of the markers (w, bins, 6) from those of the centre of gravity."""
        nuisance = state.nuisance[self.log_of]
        out = h + np.einsum("wbic,wc->wbi", by_tilt(h), nuisance[:, TILT])
        out[..., :3] += np.einsum("wbic,wc->wbi", by_lever(h)[..., :3, :], nuisance[:, LEVER])
        return out

    def simulated(
        self, state: State, variants: Array, later: Sequence[Later], start_steps: Array | None = None
    ) -> Array:
        """Return simulated poses (p, w, bins, 6) of variants (p, n) with frames and servos `later` (p,).

        Variants after the first are taken from a simulation with longer steps, as differences from the first in it.
        With `start_steps` (12,) the first state is varied too, and after it the push; the variants are then the nominal
        vector, one for each free parameter, and those with later frames and servos.
        """
        p, w = len(variants), len(self.log_of)
        which = np.arange(p, dtype=np.int64)
        if start_steps is not None:
            # Most parameters move the helicopter under the same drive.
            free = np.flatnonzero(self.spread > FIXED).tolist()
            driven = [0, *(1 + free.index(INDEX[name]) for name in DRIVEN if INDEX[name] in free)]
            driven += [i for i, more in enumerate(later) if more != Later()]
            which = np.zeros(p, np.int64)
            which[driven] = np.arange(len(driven))
        drive = self._drives(state, *zip(*[(variants[i], later[i]) for i in _firsts(which)], strict=True))
        push = np.broadcast_to(state.nuisance[self.log_of][:, PUSH], (p, w, 3))
        start = np.broadcast_to(state.start, (p, w, N_START))
        if start_steps is not None:
            extra = N_START - 3 + 3
            variants = np.vstack([variants, np.broadcast_to(state.theta, (extra, N_THETA))])
            which = np.concatenate([which, np.zeros(extra, np.int64)])
            start, push = (np.concatenate([a, np.broadcast_to(a[0], (extra, *a.shape[1:]))]) for a in (start, push))
            for i in range(3, N_START):
                start[p + i - 3, :, i] += start_steps[i]
            for i in range(3):
                push[p + N_START - 3 + i, :, i] += PUSH_STEP
        out = simulate(Lanes(variants, start, push, drive, which), self.weights, self.early, self.lab, STRIDE)
        # The error grows in proportion to the step: from four steps and two at once to single ones.
        nominal = Lanes(variants[:1], start[:1], push[:1], drive[:, :1], which[:1])
        return out + 1.5 * (simulate(nominal, self.weights, self.early, self.lab, 2) - out[:1])

    def _drives(self, state: State, variants: Sequence[Array], later: Sequence[Later]) -> Array:
        steps = self.weights.shape[1] - 1
        out = np.empty((steps, len(variants), 4, len(self.log_of)))
        at = 0
        for i, flight in enumerate(self.flights):
            rows = flight.windows.first[None, :] + np.arange(steps)[:, None]
            count = rows.shape[1]
            late = [theta + state.nuisance[i, LATE] * (np.arange(N_THETA) == INDEX["delay"]) for theta in variants]
            framed = state.framed[i]
            # A longer delay moves what acts as a whole; a later frame may carry another command, too.
            sent = [None if framed is None else framed + state.nuisance[i, PHASE] + more.frames for more in later]
            phases = [
                None if at is None else at + float(theta[INDEX["delay"]]) for at, theta in zip(sent, late, strict=True)
            ]
            servo = [state.servo[i] + state.nuisance[i, BEGIN] + more.servo for more in later]
            doubts = [more.doubt for more in later]
            for j, drive in enumerate(drives_of(flight, late, phases, servo, doubts)):
                for k, channel in enumerate(drive):
                    out[:, j, k, at : at + count] = channel[rows]
            at += count
        return out


def _firsts(which: NDArray[np.int64]) -> list[int]:
    """The first variant that uses each drive."""
    return [int(np.argmax(which == drive)) for drive in range(int(which.max()) + 1)]
