"""The least half-widths of 95 % intervals that two minutes of flight could leave, whatever the flights were.

`python tests/widths.py lab [SEED]` gives the bound of Cramer and Rao for a hidden twin whose pitch and roll sticks are
at one end or the other all the time, at many rhythms, while thrust and yaw are swung about hover. No room is asked for,
and no law: each window of two seconds begins at rest. Flights in a room, which have to come back, tell less.
"""

import sys
from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
from hidden_twins import hidden
from threadpoolctl import threadpool_limits

from controllers.signals import Array
from heli_twin.calibration import noise
from heli_twin.calibration.calibrate import Z_95, flights_of
from heli_twin.calibration.equations import normal
from heli_twin.calibration.expected import expected_noise
from heli_twin.calibration.parameters import INDEX, NAMES, lab_of, of_experiment, vector
from heli_twin.calibration.planning import _spread
from heli_twin.calibration.problem import Problem
from heli_twin.calibration.unknowns import LOG_SPREAD, N_THETA
from heli_twin.experiment import Experiment
from heli_twin.experiment.text import changed
from heli_twin.mission import fly
from heli_twin.recording import Log

SHOWN = ("thrust_per_mass", "pitch_gain", "roll_gain", "yaw_gain_per_izz", "pitch_trim", "roll_trim")
SWING = (1.0, 1.0, 0.12, 0.3)
"""Of each stick about hover."""
PHASES_S = (0.004, 0.019)
"""Of the radio's frames in the two flights."""


def square(hz: float) -> Callable[[Array, int], Array]:
    """To and fro; each input at a rhythm of its own."""
    return lambda t, i: np.sign(np.sin(2.0 * np.pi * (hz * (1.0 + 0.13 * i) * t + 0.21 * i)))


def drawn(seconds: float) -> Callable[[Array, int], Array]:
    """To one end or the other at random."""

    def sticks(t: Array, i: int) -> Array:
        length = seconds * (1.0 + 0.1 * i)
        return np.random.default_rng(i).choice([-1.0, 1.0], int(t[-1] / length) + 1)[(t / length).astype(int)]

    return sticks


RHYTHMS = {f"square, {hz:g} Hz": square(hz) for hz in (0.25, 0.35, 0.5, 0.7, 1.0, 1.7, 3.0)}
RHYTHMS |= {f"random, {s:g} s": drawn(s) for s in (0.1, 0.2, 0.3, 0.4, 0.6, 0.8, 1.2)}


def half_widths(experiment: Experiment, logs: list[Log], sticks: Callable[[Array, int], Array]) -> Array:
    """Return the bound (n,) for the helicopter of an experiment, relative for positive parameters."""
    moved: list[tuple[str, Log, int | None]] = []
    for number, log in enumerate(logs):
        t = 1e-9 * (log.sent.time - log.sent.time[0])
        swung = [swing * sticks(t, i + 4 * number) for i, swing in enumerate(SWING)]
        u = np.median(log.sent.u, axis=0) * np.array([0.0, 0.0, 1.0, 1.0]) + np.stack(swung, axis=-1)
        moved.append((f"flight {number}", SimpleNamespace(pose=log.pose, sent=log.sent._replace(u=u)), number))
    true, expected = of_experiment(experiment), expected_noise(experiment)
    theta, eta = vector(np.array([true[name] for name in NAMES])), np.log([expected[c] for c in noise.COMPONENTS])
    problem = Problem(flights_of(moved, experiment), lab_of(experiment), theta, _spread(experiment))
    state = problem.initial()._replace(theta=theta, eta=eta, framed=PHASES_S, servo=PHASES_S)
    predicted, jacobian, first = problem.linearise(state)
    rows = np.concatenate([jacobian, problem.residual(predicted)[..., None], first], axis=-1)
    spread = np.concatenate([problem.spread, np.tile(LOG_SPREAD, len(logs))])
    known = normal(problem, problem.windage(state), eta, rows).matrix + np.diag(spread**-2.0)
    return Z_95 * np.sqrt(np.diag(np.linalg.inv(known)))[:N_THETA]


def main(lab: str, seed: int) -> None:
    """Print the bounds of all rhythms, and the least of each parameter."""
    experiment = hidden(lab, seed)
    hover = (changed(experiment, ["trajectory=hover", "duration=60", f"seed={10 * seed + i}"]) for i in (1, 2))
    logs, places, best = [fly(e, log_dir=None).log for e in hover], [INDEX[name] for name in SHOWN], []
    print(f"{lab} {seed}: half-widths of 95 % intervals in %, of trims in hundredths of full stick")
    print(" " * 16, *(f"{name:>16}" for name in SHOWN))
    for name, sticks in RHYTHMS.items():
        with threadpool_limits(limits=1):
            found = 100.0 * half_widths(experiment, logs, sticks)[places]
        best.append(found)
        print(f"{name:16}", *(f"{value:16.3f}" for value in found), flush=True)
    print(f"{'least':16}", *(f"{value:16.3f}" for value in np.min(best, axis=0)))


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 3100)
