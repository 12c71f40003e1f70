"""Work for the engine's tests: what a worker may come across. Found by name from a fresh process."""

import json
import os
import time
from datetime import datetime
from pathlib import Path
from unittest import mock

import numpy as np

from heli_twin import fly, load
from heli_twin.workers.task import Flown, Task


def pretend(task: Task) -> Flown:
    """A flight that takes no time: its score is its gust's strength."""
    strength = _strength(json.loads(task.experiment))
    return Flown({"id": task.id, "outcome": "completed", "outcome_text": "", "rmse.position": strength}, b"a log")


def slowly(task: Task) -> Flown:
    """A flight of a while."""
    time.sleep(0.1)
    return pretend(task)


def noted(seen: str, task: Task) -> Flown:
    """A flight of a while that leaves a line in a file."""
    time.sleep(0.1)
    with Path(seen).open("a") as file:
        file.write(task.id + "\n")
    return pretend(task)


def stay(seen: str, task: Task) -> Flown:
    """A flight that leaves its process in a file and never ends."""
    with Path(seen).open("a") as file:
        file.write(f"{os.getpid()}\n")
    time.sleep(600)
    return pretend(task)


def poison(task: Task) -> Flown:
    """The strongest gust kills the process."""
    if _strength(json.loads(task.experiment)) == 0.5:
        os.abort()
    return pretend(task)


def hang(task: Task) -> Flown:
    """The strongest gust never ends."""
    if _strength(json.loads(task.experiment)) == 0.5:
        time.sleep(600)
    return pretend(task)


def die_once(seen: str, task: Task) -> Flown:
    """The strongest gust kills the first process that meets it; the second try works."""
    first = Path(seen + task.id)
    if _strength(json.loads(task.experiment)) == 0.5 and not first.exists():
        first.touch()
        os.kill(os.getpid(), 9)
    return pretend(task)


def fail(task: Task) -> Flown:
    """The strongest gust ends in the floor."""
    flown = pretend(task)
    if _strength(json.loads(task.experiment)) == 0.5:
        return Flown(flown.row | {"outcome": "crashed", "outcome_text": "hit the floor"}, flown.log)
    return flown


def _strength(experiment: dict) -> float:
    return experiment["disturbances"]["gust"]["strength"]


def rough(limit: float, task: Task) -> Flown:
    """A flight that crashes when its gust is too strong; its error is the gust, and a little of the seed."""
    experiment = json.loads(task.experiment)
    strength = _strength(experiment)
    outcome = "crashed" if strength > limit else "completed"
    row = {"id": task.id, "outcome": outcome, "outcome_text": "hit the floor", "effort": 0.1 + 0.1 * strength}
    row |= {f"rmse.{axis}": strength * scale for axis, scale in (("position", 1.0), ("x", 0.7), ("y", 0.6), ("z", 0.1))}
    row["rmse.position"] += 1e-3 * (experiment["seed"] + (experiment["controller"]["coupling"] == "full"))
    return Flown(row | {"rmse.yaw": 0.01, "solve_ms.p50": 0.2, "solve_ms.p99": 0.5, "solve_ms.max": 1.0})


def fly_in_one_second(folder: Path, worker: int) -> list[tuple[str, str]]:
    """Flights of which each starts in the same second: names of the logs and the digests of the flights."""
    noon = datetime(2026, 1, 1, 12)
    with mock.patch("heli_twin.mission.datetime", mock.Mock(now=lambda zone: noon)):
        flights = [load("ideal", [f"duration={0.04 + 0.02 * number + 0.2 * worker}"]) for number in range(10)]
        results = [fly(flight, log_dir=folder) for flight in flights]
    return [(result.path.name if result.path else "", result.flight_digest) for result in results]


def scored_by_seed(task: Task) -> Flown:
    """A flight whose score is a normal number of its seed and point."""
    tree = json.loads(task.experiment)
    strength = str(tree["disturbances"].get("gust"))
    rng = np.random.default_rng([tree["seed"], *strength.encode()])
    return Flown({"id": task.id, "outcome": "completed", "rmse.x": float(rng.standard_normal())})
