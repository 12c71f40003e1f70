"""Tuning on the twin: a bounded pattern search over all axes at once, with one cost for both controllers.

The cost is the MPC's own (26) with the paper's weights (30), without its integral states: the PID is tuned to be as
good as it can at what the MPC minimises. It is a sum over the axes, so that one flight judges a change on each axis.

In a round, every gain of an axis is tried larger and smaller by the same factor, all axes in the same flights; an axis
takes the change that lowers its share of the cost most, or halves its step where none does. All trials are judged by
the same flights with the same gusts, so that differences in cost come from the gains.

Every controller has to keep a gain margin of two and to do as well with an attitude of 10 and of 18 rad/s, the ends of
the published range, as with that of the experiment: its cost is the greatest of these, that with doubled gain counted
half. A PID's gains are doubled; under an MPC, which has no such single gain, the helicopter answers twice as much to
its cyclic and yaw sticks.

The flight is a series of quick moves along each axis, under gusts, of the helicopter of the experiment (the nominal
one, unless overridden). Results are reported on other trajectories and other seeds.

Source: Kunz, Huck, Summers, ECC 2013, (26), (30).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import exp, log
from typing import Any, NamedTuple

import numpy as np

from controllers.laws.detailed_mpc import DetailedMpc
from controllers.laws.ltv_mpc import LtvMpc
from controllers.laws.pid import Pid
from controllers.rotations import rotate_to_body, rotate_to_world, wrap_angle
from controllers.trajectories.waypoints import Point, Waypoints
from heli_twin.errors import HeliTwinError
from heli_twin.experiment import Experiment
from heli_twin.experiment.tree import table_of
from heli_twin.lab.plant.mujoco import MuJoCo
from heli_twin.metrics.tracking import AXES
from heli_twin.recording import Log
from heli_twin.tuning.ultimate_gain import Ultimate
from heli_twin.workers.fleet import ParallelMap

SEED_OFFSETS = (9001, 9002)
"""Added to the experiment's seed: gusts on which no result is reported."""
DEFAULT_BUDGET = 37
"""Trials; each is one flight per seed, one with doubled gains, and one at each end of the range of attitudes."""
ATTITUDES_RAD_S = (10.0, 18.0)
"""Published range of the attitude's natural frequency; see `heli_twin/lab/plant/mujoco.py`."""
FIRST_STEP_LOG = log(1.6)
"""First change of a gain, as the logarithm of a factor; it is halved down to a sixteenth."""
SMALLEST_STEP_LOG = FIRST_STEP_LOG / 16.0
REACH_LOG = log(8.0)
"""A gain stays within this factor of its start, as a logarithm."""
INTEGRAL_DIVISOR = 3.0
"""The search starts from Ziegler and Nichols' integral gain over this: theirs rejects loads quickly, and overshoots."""
LEAST_GAIN = 0.001
"""Share of the cost by which a change has to lower it to be taken."""
FAILED_COST = 1e6
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
MOVE_S, REST_S = 1.2, 2.8
"""Duration of a move, and of the rest before the next one."""

Law = Pid | LtvMpc | DetailedMpc
Gains = dict[str, dict[str, float]]
"""Values by axis, then by name."""


def moves() -> Waypoints:
    """The path to fly: 0.3 m ahead, 0.3 m to port, 0.2 m up, 0.5 rad of yaw, and back to the start."""
    points, times = [_MOVES[0]], [0.0]
    for there in _MOVES[1:]:
        points += [points[-1], there]
        times += [times[-1] + REST_S, times[-1] + REST_S + MOVE_S]
    return Waypoints(points=(*points, points[-1]), times=(*times, times[-1] + REST_S))


def shares(flight: Log) -> dict[str, float]:
    """The cost (26) of a flight with the paper's weights, per control step, split by axis.

    Errors of position and velocity are against the truth, in the axes of the body; the integral states are left out.

    Returns:
        The cost of each axis x, y, z, yaw.

    Source: Kunz, Huck, Summers, ECC 2013, (26), (30).
    """
    truth, reference, sent = flight.truth, flight.reference, flight.sent
    stamps = np.intersect1d(np.intersect1d(truth.stamp, reference.stamp), sent.stamp)
    rows = [np.searchsorted(wire.stamp, stamps) for wire in (truth, reference, sent)]
    yaw, x_ref = truth.yaw[rows[0]], reference.x[rows[1]]
    error = np.column_stack([truth.position, truth.yaw])[rows[0]] - x_ref[:, :4]
    error[:, 3] = wrap_angle(error[:, 3])
    velocity_ref = np.column_stack([rotate_to_world(x_ref[:, 4:6], x_ref[:, 3]), x_ref[:, 6:8]])
    velocity_error = np.column_stack([truth.velocity, truth.yaw_rate])[rows[0]] - velocity_ref
    for e in (error, velocity_error):
        e[:, :2] = rotate_to_body(e[:, :2], yaw)
    effort = sent.u[rows[2]] - reference.u[rows[1]]
    weights = LtvMpc()
    Q, R = np.array(weights.Q), np.array(weights.R)
    cost = (Q[:4] * error**2 + Q[4:8] * velocity_error**2 + R * effort**2).mean(axis=0)
    return dict(zip(AXES, cost.tolist(), strict=True))


class Trial(NamedTuple):
    """Gains that were tried, and their cost on each axis."""

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
    """The ultimate gains from which the search of a PID started."""

    @property
    def estimator(self) -> str | None:
        """The kind of estimator that the controller needs; None for one that takes any."""
        return "detailed_kalman" if isinstance(self.law, DetailedMpc) else None

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
        """The controller as a TOML table: tuned fields, and others that differ from the defaults, without the model."""
        tuned = {name.partition("[")[0] for names in self.best.gains.values() for name in names}
        mine, default = table_of(self.law), table_of(type(self.law)())
        return {
            name: value
            for name, value in mine.items()
            if name in tuned | {"kind"} or (value != default[name] and name != "model")
        }

    def record(self) -> dict[str, Any]:
        """Facts about the tuning, for the file that the gains are saved in; see `record`."""
        margin = ", keeping a gain margin of two and an attitude of 10 to 18 rad/s"
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
    run: ParallelMap,
    budget: int = DEFAULT_BUDGET,
    ultimates: tuple[Ultimate, ...] = (),
    progress: Callable[[], None] = lambda: None,
) -> Tuned:
    """Search the gains of a PID or the weights of an MPC.

    Args:
        base: The lab and the controller to start from.
        run: Flies experiments in parallel, see `fleet`.
        budget: Number of trials; 1 judges the start and searches nothing.
        ultimates: A PID starts from these by Ziegler and Nichols' rules.
        progress: Called after every trial.

    Raises:
        HeliTwinError: The controller is of another kind, or its start cannot be flown.
    """
    law = base.controller
    if not isinstance(law, Law):
        raise HeliTwinError(f"cannot tune a {type(law).__name__}: take controller=pid, ltv_mpc or detailed_mpc")
    gains = start_gains(law, ultimates)
    search = _Search(base, law, gains, run, progress)
    while search.trials < budget and search.round(budget - search.trials):
        pass
    best = Trial({a: {n: float(f"{g:.3g}") for n, g in names.items()} for a, names in search.best.items()}, search.cost)
    seeds = tuple(base.seed + offset for offset in SEED_OFFSETS)
    return Tuned(with_gains(law, best.gains), Trial(gains, search.start), best, search.trials, budget, seeds, ultimates)


def start_gains(law: Law, ultimates: tuple[Ultimate, ...] = ()) -> Gains:
    """The gains or weights to tune, by axis.

    Args:
        law: The controller to start from.
        ultimates: Replace the gains of their axes by Ziegler and Nichols' rules.

    The MPC's input weights stay: multiplying all weights by one factor changes nothing, so one of each axis is fixed.
    """
    if not isinstance(law, Pid):
        places = {"x": (0, 4, 8), "y": (1, 5, 9), "z": (2, 6), "yaw": (3, 7)}
        places = {axis: [i for i in indices if i < len(law.Q)] for axis, indices in places.items()}
        return {axis: {f"Q[{i}]": float(law.Q[i]) for i in indices} for axis, indices in places.items()}
    gains = {a: {f"{term}_{a}": float(getattr(law, f"{term}_{a}")) for term in "pid"} for a in AXES}
    for u in ultimates:
        p, i, d = u.gains()
        gains[u.axis] = {f"p_{u.axis}": p, f"i_{u.axis}": i / INTEGRAL_DIVISOR, f"d_{u.axis}": d}
    return gains


def with_gains(law: Law, gains: Gains) -> Law:
    """The controller with other gains."""
    flat: dict[str, Any] = {}
    for names in gains.values():
        flat |= names
    if not isinstance(law, Pid):
        flat = {"Q": tuple(flat[f"Q[{i}]"] for i in range(len(law.Q)))}
    return replace(law, **flat)


class _Search:
    """A pattern search on each axis, all axes in the same flights."""

    def __init__(
        self, base: Experiment, law: Law, gains: Gains, run: ParallelMap, progress: Callable[[], None]
    ) -> None:
        self._base, self._law, self._run, self._progress = base, law, run, progress
        self._origin = gains
        self.best, self.trials = gains, 0
        self.start = self.cost = self._try([gains])[0]
        if max(self.cost.values()) >= FAILED_COST:
            raise HeliTwinError(
                "the controller to start from cannot fly the moves it is tuned on: check the experiment's overrides"
            )
        self._step = dict.fromkeys(gains, FIRST_STEP_LOG)

    def round(self, budget: int) -> bool:
        """Try every gain larger and smaller.

        Returns:
            False when the steps of all axes have become too small to go on.
        """
        most = max(map(len, self.best.values()))
        changes = [(i, sign) for i in range(most) for sign in (1.0, -1.0)][:budget]
        trials = [{axis: self._changed(axis, i, sign) for axis in self.best} for i, sign in changes]
        costs = self._try(trials)
        for axis in self.best:
            cost, tried = min(((c[axis], i) for i, c in enumerate(costs)), key=lambda pair: pair[0])
            if cost < self.cost[axis] * (1.0 - LEAST_GAIN):
                self.best, self.cost = self.best | {axis: trials[tried][axis]}, self.cost | {axis: cost}
            else:
                self._step[axis] /= 2.0
        return max(self._step.values()) >= SMALLEST_STEP_LOG

    def _changed(self, axis: str, i: int, sign: float) -> dict[str, float]:
        """The gains of an axis with the i-th one changed, within `REACH_LOG`; unchanged if it has no such gain."""
        names = list(self.best[axis])
        if i >= len(names):
            return self.best[axis]
        name = names[i]
        origin = self._origin[axis][name]
        if origin <= 0.0:
            return self.best[axis]
        moved = log(self.best[axis][name]) + sign * self._step[axis]
        return self.best[axis] | {name: exp(min(max(moved, log(origin) - REACH_LOG), log(origin) + REACH_LOG))}

    def _try(self, trials: list[Gains]) -> list[dict[str, float]]:
        """The cost of each trial."""
        costs: list[dict[str, float]] = []
        flights = [flight for gains in trials for flight in self._flights(gains)]
        each = len(flights) // len(trials)
        of_trial: list[dict[str, float]] = []
        for cost in self._run(_cost, flights):
            of_trial.append(cost)
            if len(of_trial) == each:
                plain, robust = of_trial[: len(SEED_OFFSETS)], of_trial[len(SEED_OFFSETS) :]
                mean = {a: sum(c[a] for c in plain) / len(plain) for a in AXES}
                weights = (0.5, *[1.0] * len(ATTITUDES_RAD_S))
                costs.append(
                    {a: max([mean[a], *(w * c[a] for w, c in zip(weights, robust, strict=False))]) for a in AXES}
                )
                of_trial = []
                self._progress()
        self.trials += len(trials)
        return costs

    def _flights(self, gains: Gains) -> list[Experiment]:
        """One flight per seed, then one with doubled gain, then one for each other attitude."""
        law, path = with_gains(self._law, gains), moves()
        seeds = [self._base.seed + offset for offset in SEED_OFFSETS]
        base = replace(self._base, controller=law, trajectory=path, duration=path.times[-1], seed=seeds[0])
        plant = base.plant
        doubled = base
        if isinstance(law, Pid):
            twice = {a: {n: 2.0 * g for n, g in names.items()} for a, names in gains.items()}
            doubled = replace(base, controller=with_gains(law, twice))
        elif isinstance(plant, MuJoCo):
            doubled = replace(base, plant=twice_as_responsive(plant))
        others = [replace(plant, attitude_frequency=w) for w in ATTITUDES_RAD_S] if isinstance(plant, MuJoCo) else []
        return [
            *(replace(base, seed=seed) for seed in seeds),
            doubled,
            *(replace(base, plant=other) for other in others),
        ]


def twice_as_responsive(plant: MuJoCo) -> MuJoCo:
    """Return a helicopter that answers twice as much to its cyclic and yaw sticks, within the bounds of the fields."""
    return replace(
        plant,
        pitch_gain=min(2.0 * plant.pitch_gain, 0.9),
        roll_gain=min(2.0 * plant.roll_gain, 0.9),
        yaw_gain=min(2.0 * plant.yaw_gain, 0.1),
    )


def _cost(experiment: Experiment) -> dict[str, float]:
    from heli_twin.mission import fly

    result = fly(experiment, log_dir=None)
    return shares(result.log) if result.outcome.kind == "completed" else dict.fromkeys(AXES, FAILED_COST)
