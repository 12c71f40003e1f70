"""The court: where the time of a flight goes, all measured in one run and in turns, so that the host's noise cancels.

Every row is a processor time. Its `share` is that time over the bare floor of the same turn: the MuJoCo steps and the
ProxQP solves of one flight of `FLIGHT_S` alone. Shares, not times, are compared with those of the last release.

The floor is the engines at their best: MuJoCo without its clock, as flights use it, and ProxQP with all control
problems of the flight. Two rows tell the ratio in a process that does nothing else, over that floor and over MuJoCo as
its wheel comes, with the clock; one row tells ProxQP with those problems alone that a flight asks it, since one linear
equation gives the others.
"""

import json
import resource
import subprocess
import sys
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from time import perf_counter_ns, process_time
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np
from threadpoolctl import threadpool_limits

from controllers.condensed_qp import CondensedQp
from controllers.flatness import state
from controllers.laws.ltv_mpc import LtvMpcController
from controllers.proxqp import ProxQp
from heli_twin import Experiment, fly, load
from heli_twin.experiment.tree import canonical_json
from heli_twin.flight import Flight
from heli_twin.lab.plant.mujoco import engine
from heli_twin.recording import Recorder
from heli_twin.studies.work import fly_task
from heli_twin.workers.task import Task

FLIGHT_S, ROUNDS = 20.0, 7
ROOT = Path(__file__).parents[2]
RELEASE = Path(__file__).with_name("release.json")
"""The court of the last release, as `court.json` was then."""
SLOWER = 1.25
"""A share that has grown by this factor is marked; less is noise, on a busy host."""
FLIGHTS = {
    "MPC": ["lab_simple"],
    "PID": ["lab_simple", "controller=pid"],
    "ideal": ["ideal"],
    "lab": ["lab"],
}
QPS = {
    "quiet": ["lab_simple", "trajectory=hover", "duration=4"],
    "saturated": [
        "lab_simple",
        "duration=4",
        "controller.model.u_x_max=0.3",
        "controller.model.u_y_max=0.3",
        "disturbances.gust.strength=1",
    ],
    "full coupling": ["lab_simple", "duration=4", "controller.coupling=full"],
}


STEPS, SOLVES, FLIGHT = "MuJoCo steps alone", "ProxQP solves alone", "flight, MPC, logged"


class Row(NamedTuple):
    """One line of the table."""

    name: str
    seconds: float
    """Processor time."""
    share: float
    """Of the bare floor of the same turn."""


def experiment(words: Sequence[str]) -> Experiment:
    """The experiment of a preset and changes; it lasts `FLIGHT_S` if they do not say it."""
    return load(words[0], [f"duration={FLIGHT_S}", *words[1:]])


def cpu(work: Callable[[], Any]) -> float:
    """Processor time of this process, s."""
    began = process_time()
    work()
    return process_time() - began


def command_cpu(*words: str) -> float:
    """Processor time of a command, its children's too, s."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-m", "heli_twin", *words], check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def qps_of(e: Experiment) -> list[list[CondensedQp]]:
    """The QPs of a flight, each on memory of its own, one list a subsystem; matrices that stay the same stay one."""
    found: list[list[CondensedQp]] = []
    kept: dict[int, Any] = {}
    condense = LtvMpcController.costs

    def costs(self: Any, *given: Any) -> Any:
        ltv, found_costs = condense(self, *given)
        qps = self._bounded(ltv, found_costs)
        found.append([CondensedQp(*(_own(part, kept) for part in qp)) for qp in qps])
        return ltv, found_costs

    with patch.object(LtvMpcController, "costs", costs):
        fly(e, log_dir=None)
    return [*map(list, zip(*found, strict=True))]


def asked_qps_of(e: Experiment) -> list[list[CondensedQp]]:
    """Those QPs of a flight that ProxQP is asked, one list a subsystem."""
    found = defaultdict[ProxQp, list[CondensedQp]](list)
    solve, kept = ProxQp.__call__, dict[int, Any]()

    def asked(solver: ProxQp, qp: CondensedQp) -> Any:
        found[solver].append(CondensedQp(*(_own(part, kept) for part in qp)))
        return solve(solver, qp)

    with patch.object(ProxQp, "__call__", asked):
        fly(e, log_dir=None)
    return [*found.values()]


def _own(array: Any, kept: dict[int, Any]) -> Any:
    """A copy; of an array that came before with the same content, the same copy."""
    before = kept.get(id(array))
    if before is None or not np.array_equal(before, array):
        kept[id(array)] = before = array.copy()
    return before


def by_proxqp(qps: Sequence[CondensedQp]) -> Callable[[], None]:
    """Solve with ProxQP as a flight does."""
    solver = ProxQp(qps[0], 4 if len(qps[0].g) > 40 else 2)
    return lambda: _each(solver, qps)


def by_daqp(qps: Sequence[CondensedQp]) -> Callable[[], None]:
    """Solve with DAQP, an active-set method; its set-up is in every solve."""
    import daqp

    sense = np.zeros(2 * len(qps[0].g), dtype=np.int32)

    def solve(qp: CondensedQp) -> None:
        upper, lower = np.concatenate([qp.u_high, qp.v_high]), np.concatenate([qp.u_low, qp.v_low])
        daqp.solve(qp.H, qp.g, qp.C, upper, lower, sense)

    return lambda: _each(solve, qps)


def by_osqp(qps: Sequence[CondensedQp]) -> Callable[[], None]:
    """Solve with OSQP, warm-started, to the absolute tolerance of the flight's solver."""
    import osqp
    from scipy import sparse

    n, first = len(qps[0].g), qps[0]
    columns, eye = np.tril_indices(n), np.eye(n)
    upper, full = sparse.triu(np.ones((n, n)), format="csc"), sparse.csc_matrix(np.ones((2 * n, n)))

    def values(qp: CondensedQp) -> dict[str, Any]:
        low, high = np.concatenate([qp.v_low, qp.u_low]), np.concatenate([qp.v_high, qp.u_high])
        return {"q": qp.g, "l": low, "u": high, "Px": qp.H.T[columns], "Ax": np.vstack([qp.C, eye]).T.ravel()}

    start = values(first)
    upper.data[:], full.data[:] = start["Px"], start["Ax"]
    solver = osqp.OSQP()
    settings = {"eps_abs": 1e-5, "eps_rel": 0.0, "verbose": False, "polishing": False}
    solver.setup(upper, first.g, full, start["l"], start["u"], **settings)

    def solve(qp: CondensedQp) -> None:
        solver.update(**values(qp))
        solver.solve(raise_error=False)

    return lambda: _each(solve, qps)


def _each(solve: Callable[[CondensedQp], Any], qps: Iterable[CondensedQp]) -> None:
    for qp in qps:
        solve(qp)


def mujoco_alone(e: Experiment) -> Callable[[], None]:
    """The physics steps of a flight, without anything in between."""
    plant: Any = e.plant.start(state(e.trajectory.flat(np.zeros(1)))[0])
    per_period = round(e.controller.period / e.plant.step)
    periods, step = round(e.duration / e.controller.period), engine().mj_step

    def steps() -> None:
        for _ in range(periods):
            step(plant._model, plant._data, per_period)

    return steps


def lean() -> list[Row]:
    """The flight over both floors, in a process that has loaded and done nothing else, as a command has not."""
    done = subprocess.run([sys.executable, "-c", LEAN], cwd=ROOT, check=True, capture_output=True, text=True)
    return [Row(*row) for row in json.loads(done.stdout)]


LEAN = """
import ctypes, json, mujoco
clock = ctypes.c_void_p.in_dll(ctypes.CDLL(mujoco._functions.__file__), "mjcb_time")
its_own = clock.value
from tests.benchmarks import court
print(json.dumps(court.turns(lambda on: setattr(clock, "value", its_own if on else None))))
"""


def turns(switch: Callable[[bool], None]) -> list[Row]:
    """Measure floor, flight and floor again in turns; `switch` gives MuJoCo its clock or takes it away."""
    mpc = experiment(FLIGHTS["MPC"])
    qps, times = qps_of(mpc), defaultdict[str, list[float]](list)

    def steps(*, clock: bool) -> float:
        alone = mujoco_alone(mpc)
        switch(clock)
        try:
            return cpu(alone)
        finally:
            switch(False)

    def solves() -> float:
        return sum(cpu(by_proxqp(part)) for part in qps)

    with threadpool_limits(limits=1), TemporaryDirectory() as folder:
        for _ in range(ROUNDS):
            before = steps(clock=True), steps(clock=False), solves()
            flown = cpu(partial(fly, mpc, log_dir=folder))
            after = steps(clock=True), steps(clock=False), solves()
            shipped, bare, solved = (0.5 * (one + other) for one, other in zip(before, after, strict=True))
            times["as they come"].append(flown / (shipped + solved))
            times["without clock"].append(flown / (bare + solved))
            times["flight"].append(flown)
    return [
        Row(f"lean process, over engines {name}", median(times["flight"]), median(times[name]))
        for name in ("as they come", "without clock")
    ]


class Mute(Recorder):
    """A recorder that keeps nothing."""

    def _put(self, *_: Any) -> None:
        pass

    def timing(self, *_: Any) -> None:
        """Keep nothing."""


def flight(e: Experiment, recorder: Callable[[], Recorder] = Recorder) -> Flight:
    """A flight that is ready to be flown once."""
    return Flight(e, e.plant.start(state(e.trajectory.flat(np.zeros(1)))[0]), recorder())


def parts_of(e: Experiment) -> dict[str, float]:
    """Share of each part in the wall time of a flight in which every call is timed."""
    spent, inner = defaultdict[str, int](int), [0]
    one = flight(e)
    for label, owner, names in (
        ("estimator", one.estimator, ("receive", "estimate", "command_sent")),
        ("control law", one.controller, ("step", "explain")),
        ("physics", one.plant, ("advance", "truth")),
        ("cameras, radio, air", one.mocap, ("capture",)),
        ("cameras, radio, air", one.radio, ("send", "receive")),
        ("cameras, radio, air", one, ("air",)),
        ("recorder", one.recorder, ("truth", "pose", "estimate", "reference", "sent", "acting", "plan", "qp")),
        ("recorder", one.recorder, ("disturbance", "timing")),
        ("loop", one, ("run",)),
    ):
        for name in names:
            setattr(owner, name, partial(_timed, getattr(owner, name), label, spent, inner))
    one.run()
    whole = sum(spent.values())
    return {label: time / whole for label, time in sorted(spent.items(), key=lambda item: -item[1])}


def _timed(call: Callable[..., Any], label: str, spent: dict[str, int], inner: list[int], *given: Any) -> Any:
    """Call, and add to the time of the label what no timed call inside has taken."""
    inner.append(0)
    began = perf_counter_ns()
    try:
        return call(*given)
    finally:
        took = perf_counter_ns() - began
        spent[label] += took - inner.pop()
        inner[-1] += took


def measure(folder: Path, progress: Callable[[str], None] = lambda name: None) -> tuple[list[Row], dict[str, float]]:
    """Measure everything; returns the rows and the shares of the parts of a flight."""
    flights = {name: experiment(words) for name, words in FLIGHTS.items()}
    mpc, short = flights["MPC"], experiment([*FLIGHTS["MPC"], "duration=4"])
    qps = {name: qps_of(experiment(words)) for name, words in ({"flown": FLIGHTS["MPC"]} | QPS).items()}
    work: dict[str, Callable[[], float]] = {}
    work[STEPS] = partial(cpu, mujoco_alone(mpc))
    work[SOLVES] = lambda: sum(cpu(by_proxqp(part)) for part in qps["flown"])
    work[FLIGHT] = partial(cpu, partial(fly, mpc, log_dir=folder))
    asked = asked_qps_of(mpc)
    work["ProxQP solves that are asked for"] = lambda: sum(cpu(by_proxqp(part)) for part in asked)
    for name, e in flights.items():
        work[f"flight, {name}, logged"] = partial(cpu, partial(fly, e, log_dir=folder))
    work["flight, MPC, loop alone"] = lambda: cpu(flight(mpc).run)
    work["flight, MPC, loop without recorder"] = lambda: cpu(flight(mpc, Mute).run)
    for name in QPS:
        for solver in (by_proxqp, by_daqp, by_osqp):
            solves = [solver(part) for part in qps[name]]
            label = f"QPs, {name}, {solver.__name__.removeprefix('by_')}"
            work[label] = partial(lambda solves: sum(map(cpu, solves)), solves)
    task = Task("court", canonical_json(short), "max_error_x", keep_log=False, keep_failed=False, keep_above=None)
    work["run of a study, 4 s"] = lambda: cpu(lambda: fly_task(task))
    work["the same, loop alone"] = lambda: cpu(flight(short).run)
    long = fly(load("lab_simple", ["duration=60"]), log_dir=folder).path
    work["heli-twin --help"] = lambda: command_cpu("--help")
    work["heli-twin fly, one step"] = lambda: command_cpu("fly", "lab_simple", "duration=0.02", "--no-log")
    work["replay of 60 s to a Rerun file"] = lambda: command_cpu("replay", str(long), "--save", str(folder / "r.rrd"))
    times = defaultdict[str, list[float]](list)
    with threadpool_limits(limits=1):
        for turn in range(ROUNDS):
            for name, once in work.items():
                progress(f"{turn + 1}/{ROUNDS} {name}")
                times[name].append(once())
    floors = [steps + solves for steps, solves in zip(times[STEPS], times[SOLVES], strict=True)]
    rows = [Row(name, median(found), _share(found, floors)) for name, found in times.items()]
    return [*lean(), *rows], parts_of(mpc)


def _share(times: Sequence[float], floors: Sequence[float]) -> float:
    """The median over the turns: the host's clock changes from turn to turn, more than within one."""
    return median(time / floor for time, floor in zip(times, floors, strict=True))


def control_step(folder: Path) -> tuple[float, float]:
    """Median wall times of the control step in flight, and of its own solves, s."""
    timing = fly(experiment(FLIGHTS["MPC"]), log_dir=folder).log.timing
    return 1e-9 * float(np.median(timing.control_step_ns)), 1e-9 * float(np.median(timing.solve_ns))


def table(rows: Sequence[Row], parts: dict[str, float], step: tuple[float, float]) -> str:
    """The table for a person, with the shares of the last release beside those of today."""
    before = json.loads(RELEASE.read_text())["shares"] if RELEASE.is_file() else {}
    lines = [f"{'':<44} {'ms':>9} {'over floor':>11} {'release':>9} {'change':>8}"]
    for name, seconds, share in rows:
        then = before.get(name)
        change = f"{then:9.2f} {100 * (share / then - 1):+7.0f} %" if then else ""
        mark = "  slower" if then and share > SLOWER * then else ""
        lines.append(f"{name:<44} {1e3 * seconds:9.1f} {share:11.2f} {change}{mark}")
    lines.append(f"{'control step in flight, wall':<44} {1e3 * step[0]:9.3f}")
    lines.append(f"{'of it ProxQP':<44} {1e3 * step[1]:9.3f}  the step is {step[0] / step[1]:.1f} times its solves")
    lines.append("shares of a flight: " + ", ".join(f"{label} {100 * share:.0f} %" for label, share in parts.items()))
    return "\n".join(lines)


def as_json(rows: Sequence[Row], parts: dict[str, float], step: tuple[float, float]) -> str:
    """The same for programs."""
    report = {
        "flight_s": FLIGHT_S,
        "seconds": {row.name: row.seconds for row in rows},
        "shares": {row.name: row.share for row in rows} | {"control step over its solves": step[0] / step[1]},
        "parts": parts,
    }
    return json.dumps(report, indent=2) + "\n"
