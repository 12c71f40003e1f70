"""Tuning on the twin: a bounded search that asks every axis at once, and a cost that both controllers share.

The yardstick is the MPC's own cost (26) with the paper's weights (30), without its integral states: the PID is tuned
to be as good at the MPC's game as it can. It is a sum over the axes, so that one flight judges a change on each.

The search is what a careful person does by hand. In a round, every gain of an axis is tried larger and smaller by the
same factor, all axes in the same flights; an axis takes the change that lowers its share of the cost most, or halves
its step where none does. The same flights with the same gusts judge every trial, so that differences are the gains'.

A PID shall keep a gain margin of two: its cost is that of its gains, or half of what all of them doubled cost, if that
is more. An MPC has no such knob, and its plan knows the delays.

The flight is a series of quick moves along each axis, under gusts, of the helicopter that the experiment says (the
nominal one, unless overridden): neither the trajectories nor the seeds that results are reported on.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import exp, log
from typing import Any, NamedTuple

import numpy as np

from controllers.laws.ltv_mpc import LtvMpc
from controllers.laws.pid import Pid
from controllers.trajectories.waypoints import Point, Waypoints
from heli_twin.errors import HeliTwinError
from heli_twin.experiment import Experiment
from heli_twin.experiment.tree import table_of
from heli_twin.metrics.tracking import AXES
from heli_twin.recording import Log
from heli_twin.tuning.ultimate_gain import Ultimate
from heli_twin.workers.fleet import Run

SEEDS = (9001, 9002)
"""Added to the experiment's own: gusts that no result is reported on."""
BUDGET = 37
"""Trials, each one flight a seed, and for a PID one with doubled gains."""
STEP = log(1.6)
"""First change of a gain, as a logarithm; the last is a sixteenth of it at the least."""
REACH = log(8.0)
"""A gain stays within this factor of where it started."""
INTEGRAL_CUT = 3.0
"""Ziegler and Nichols' integral gain over what the search starts from: theirs answers loads, and overshoots."""
LOST = 1e6
"""Cost of a trial whose flight ended early."""
CRITERION = "the MPC's cost (26) with the paper's weights, on quick moves under gusts"

_MOVES: tuple[Point, ...] = (
    (0.0, 0.0, 1.0, 0.0),
    (0.3, 0.0, 1.0, 0.0),
    (0.3, 0.3, 1.0, 0.0),
    (0.3, 0.3, 1.2, 0.0),
    (0.3, 0.3, 1.2, 0.5),
    (0.0, 0.0, 1.0, 0.0),
)
MOVE, REST = 1.2, 2.8
"""How long a move takes, and how long the helicopter stands before the next, s."""

Law = Pid | LtvMpc
Gains = dict[str, dict[str, float]]
"""By axis, then by name."""


def moves() -> Waypoints:
    """A third of a metre ahead, to port and up, half a radian round, and all the way back."""
    points, times = [_MOVES[0]], [0.0]
    for there in _MOVES[1:]:
        points += [points[-1], there]
        times += [times[-1] + REST, times[-1] + REST + MOVE]
    return Waypoints(points=(*points, points[-1]), times=(*times, times[-1] + REST))


def shares(flight: Log) -> dict[str, float]:
    """The cost (26) of a flight with the paper's weights, per control step, split by axis.

    Position and velocity errors are of the truth, as the nose points; the integral states are left out.
    """
    truth, reference, sent = flight.truth, flight.reference, flight.sent
    stamps = np.intersect1d(np.intersect1d(truth.stamp, reference.stamp), sent.stamp)
    rows = [np.searchsorted(wire.stamp, stamps) for wire in (truth, reference, sent)]
    yaw, x_ref = truth.yaw[rows[0]], reference.x[rows[1]]
    c, s = np.cos(yaw), np.sin(yaw)
    error = np.column_stack([truth.position, truth.yaw])[rows[0]] - x_ref[:, :4]
    error[:, 3] = (error[:, 3] + np.pi) % (2 * np.pi) - np.pi
    c_ref, s_ref = np.cos(x_ref[:, 3]), np.sin(x_ref[:, 3])
    vx, vy, vz = x_ref[:, 4:7].T
    world_ref = np.column_stack([c_ref * vx - s_ref * vy, s_ref * vx + c_ref * vy, vz, x_ref[:, 7]])
    speed = np.column_stack([truth.velocity, truth.yaw_rate])[rows[0]] - world_ref
    for e in (error, speed):
        e[:, 0], e[:, 1] = c * e[:, 0] + s * e[:, 1], c * e[:, 1] - s * e[:, 0]
    effort = sent.u[rows[2]] - reference.u[rows[1]]
    weights = LtvMpc()
    Q, R = np.array(weights.Q), np.array(weights.R)
    cost = (Q[:4] * error**2 + Q[4:8] * speed**2 + R * effort**2).mean(axis=0)
    return dict(zip(AXES, cost.tolist(), strict=True))


class Trial(NamedTuple):
    """Gains that were tried, and what they cost on each axis."""

    gains: Gains
    cost: dict[str, float]


@dataclass(frozen=True)
class Tuned:
    """A tuned controller."""

    law: Law
    start: Trial
    best: Trial
    trials: int
    budget: int
    seeds: tuple[int, ...]
    """Of the gusts."""
    ultimates: tuple[Ultimate, ...] = ()
    """What the search of a PID started from."""

    def as_json(self) -> dict[str, Any]:
        """The result as `heli-twin tune --json` prints it."""
        return {
            "controller": self.law.kind,
            "ultimate": {u.axis: {"Ku": u.gain, "Tu": u.period, "damping": u.damping} for u in self.ultimates},
            "gains": self.best.gains,
            "start": self.start.gains,
            "cost": self.best.cost,
            "cost_at_start": self.start.cost,
            "trials": self.trials,
            "budget": self.budget,
            "criterion": CRITERION,
            "seeds": self.seeds,
        }

    def table(self) -> dict[str, Any]:
        """The controller as a TOML table: what was tuned, and what else differs from the defaults but for the model."""
        tuned = {name.partition("[")[0] for names in self.best.gains.values() for name in names}
        mine, default = table_of(self.law), table_of(type(self.law)())
        return {
            name: value
            for name, value in mine.items()
            if name in tuned | {"kind"} or (value != default[name] and name != "model")
        }

    def record(self) -> dict[str, Any]:
        """What a comparison has to tell of these gains."""
        margin = ", keeping a gain margin of two" if isinstance(self.law, Pid) else ""
        return {
            "trials": self.trials,
            "budget": self.budget,
            "criterion": CRITERION + margin,
            "seeds": list(self.seeds),
            "cost_at_start": float(f"{sum(self.start.cost.values()):.4g}"),
            "cost": float(f"{sum(self.best.cost.values()):.4g}"),
            "controller": self.table(),
        }


def tune(
    base: Experiment,
    run: Run,
    budget: int = BUDGET,
    ultimates: tuple[Ultimate, ...] = (),
    progress: Callable[[], None] = lambda: None,
) -> Tuned:
    """Search the gains of a PID or the weights of an MPC.

    Args:
        base: The lab and the controller to start from.
        run: What flies, see `fleet`.
        budget: Trials; 1 leaves the start as it is.
        ultimates: A PID starts from these by Ziegler and Nichols' rules.
        progress: Told of every trial.

    Raises:
        HeliTwinError: The controller is of another kind, or its start cannot be flown.
    """
    law = base.controller
    if not isinstance(law, Law):
        raise HeliTwinError(f"cannot tune a {type(law).__name__}: take controller=pid or controller=ltv_mpc")
    gains = start_gains(law, ultimates)
    search = _Search(base, law, gains, run, progress)
    while search.trials < budget and search.round(budget - search.trials):
        pass
    best = Trial({a: {n: float(f"{g:.3g}") for n, g in names.items()} for a, names in search.best.items()}, search.cost)
    seeds = tuple(base.seed + seed for seed in SEEDS)
    return Tuned(with_gains(law, best.gains), Trial(gains, search.start), best, search.trials, budget, seeds, ultimates)


def start_gains(law: Law, ultimates: tuple[Ultimate, ...] = ()) -> Gains:
    """What is tuned of a controller, by axis.

    The MPC's input weights stay: doubling all weights changes nothing, so that one of each axis has to.
    """
    if isinstance(law, LtvMpc):
        places = {"x": (0, 4, 8), "y": (1, 5, 9), "z": (2, 6), "yaw": (3, 7)}
        return {axis: {f"Q[{i}]": float(law.Q[i]) for i in indices} for axis, indices in places.items()}
    gains = {a: {f"{term}_{a}": float(getattr(law, f"{term}_{a}")) for term in "pid"} for a in AXES}
    for u in ultimates:
        p, i, d = u.gains()
        gains[u.axis] = {f"p_{u.axis}": p, f"i_{u.axis}": i / INTEGRAL_CUT, f"d_{u.axis}": d}
    return gains


def with_gains(law: Law, gains: Gains) -> Law:
    """The controller with these gains."""
    flat: dict[str, Any] = {}
    for names in gains.values():
        flat |= names
    if isinstance(law, LtvMpc):
        flat = {"Q": tuple(flat[f"Q[{i}]"] for i in range(len(law.Q)))}
    return replace(law, **flat)


class _Search:
    """A pattern search on each axis, in lockstep."""

    def __init__(self, base: Experiment, law: Law, gains: Gains, run: Run, progress: Callable[[], None]) -> None:
        self._base, self._law, self._run, self._progress = base, law, run, progress
        self._origin = gains
        self.best, self.trials = gains, 0
        self.start = self.cost = self._try([gains])[0]
        if max(self.cost.values()) >= LOST:
            raise HeliTwinError(
                "the controller to start from cannot fly the moves it is tuned on: check the experiment's overrides"
            )
        self._step = dict.fromkeys(gains, STEP)

    def round(self, budget: int) -> bool:
        """Try every gain both ways; False when no axis has a step left that is worth a flight."""
        most = max(map(len, self.best.values()))
        changes = [(i, sign) for i in range(most) for sign in (1.0, -1.0)][:budget]
        trials = [{axis: self._changed(axis, i, sign) for axis in self.best} for i, sign in changes]
        costs = self._try(trials)
        for axis in self.best:
            cost, tried = min(((c[axis], i) for i, c in enumerate(costs)), key=lambda found: found[0])
            if cost < self.cost[axis] * 0.999:
                self.best, self.cost = self.best | {axis: trials[tried][axis]}, self.cost | {axis: cost}
            else:
                self._step[axis] /= 2.0
        return max(self._step.values()) >= STEP / 16.0

    def _changed(self, axis: str, i: int, sign: float) -> dict[str, float]:
        """The gains of an axis with the i-th one changed, within its reach; as they are where there is none."""
        names = list(self.best[axis])
        if i >= len(names):
            return self.best[axis]
        name = names[i]
        origin = self._origin[axis][name]
        if origin <= 0.0:
            return self.best[axis]
        moved = log(self.best[axis][name]) + sign * self._step[axis]
        return self.best[axis] | {name: exp(min(max(moved, log(origin) - REACH), log(origin) + REACH))}

    def _try(self, trials: list[Gains]) -> list[dict[str, float]]:
        """The cost of each trial."""
        costs: list[dict[str, float]] = []
        flights = [flight for gains in trials for flight in self._flights(gains)]
        each = len(flights) // len(trials)
        found: list[dict[str, float]] = []
        for cost in self._run(_cost, flights):
            found.append(cost)
            if len(found) == each:
                plain, doubled = found[: len(SEEDS)], found[len(SEEDS) :]
                mean = {a: sum(c[a] for c in plain) / len(plain) for a in AXES}
                costs.append({a: max([mean[a], *(0.5 * c[a] for c in doubled)]) for a in AXES})
                found = []
                self._progress()
        self.trials += len(trials)
        return costs

    def _flights(self, gains: Gains) -> list[Experiment]:
        flights = [(with_gains(self._law, gains), seed) for seed in SEEDS]
        if isinstance(self._law, Pid):
            doubled = {a: {n: 2.0 * g for n, g in names.items()} for a, names in gains.items()}
            flights.append((with_gains(self._law, doubled), SEEDS[0]))
        path = moves()
        return [
            replace(self._base, controller=c, trajectory=path, duration=path.times[-1], seed=self._base.seed + seed)
            for c, seed in flights
        ]


def _cost(experiment: Experiment) -> dict[str, float]:
    from heli_twin.mission import fly

    result = fly(experiment, log_dir=None)
    return shares(result.log) if result.outcome.kind == "completed" else dict.fromkeys(AXES, LOST)
