"""Flies several helicopters: checks them, flies them, keeps their log and computes their metrics."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cached_property
from io import BytesIO
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from controllers.laws.external import External
from controllers.proxqp import BUILD_TROUBLE
from controllers.trajectories import Trajectory, fitted
from heli_twin.experiment import Experiment
from heli_twin.experiment.own import ClassMissing
from heli_twin.experiment.several import Several, checked_several
from heli_twin.experiment.several_text import load_several
from heli_twin.experiment.several_written import several_from_json, several_json, several_toml
from heli_twin.experiment.tree import ExperimentError, canonical_json, toml_of
from heli_twin.flight import INVALID, Outcome
from heli_twin.lab.plant import Plant
from heli_twin.lab.plant.airframe import shape_of
from heli_twin.lab.plant.mujoco import MuJoCo
from heli_twin.lab.plant.world import World
from heli_twin.logbook import facts_of, planned_path, provenance
from heli_twin.metrics.several import arrival, several_metrics
from heli_twin.metrics.tracking import metrics
from heli_twin.mission import checked, require_program, start_plant, start_state
from heli_twin.recording import Attachment, Log, LogExistsError, read_log
from heli_twin.recording.records import Ending
from heli_twin.recording.ships import ShipFacts, ShipsRecorder
from heli_twin.several.room import Helicopters, Room, outcome_of_all
from heli_twin.whole_file import free_path


@dataclass(frozen=True)
class SeveralResult:
    """A flight of several helicopters.

    Attributes:
        several: What was flown.
        outcome: How it ended: as the worst of them.
        outcomes: How each ended, by name.
        path: Path of the log; None if it is in memory.
        flight_digest: Hash of what was flown and of every recorded message but the measured times; empty for an
            invalid run.
        real_time_factor: Simulated time divided by measured time of the flight, recording included.
        data: Content of the log; None if it is in a file.
        log_trouble: One sentence that says why the log file could not be written, or empty; the flight is complete
            anyway.
        solver_trouble: The reason why the digest may differ in other processes, or empty.
    """

    several: Several
    outcome: Outcome
    outcomes: Mapping[str, Outcome]
    path: Path | None
    flight_digest: str
    real_time_factor: float
    data: bytes | None = field(default=None, repr=False)
    log_trouble: str = ""
    solver_trouble: str = ""

    @cached_property
    def log(self) -> Log:
        """Everything that was recorded; `log.ship("a")` is the log of one helicopter."""
        return read_log(self.path or BytesIO(self.data or b""))

    def summary(self) -> dict[str, Any]:
        """Return the result as `heli-twin fly --json` prints it."""
        return summary_of(self.log, self.several) | {
            "outcome_text": self.outcome.text,
            "real_time_factor": self.real_time_factor,
            "log": str(self.path) if self.path else None,
            "log_trouble": self.log_trouble or None,
            "solver_trouble": self.solver_trouble or None,
            "flight_digest": self.flight_digest or None,
        }


def wishes_of(several: Several) -> dict[str, Trajectory]:
    """Return what each helicopter wants to fly, by its name."""
    return {name: fitted(e.trajectory, e.controller.model) for name, e in several.fleet().items()}


def summary_of(log: Log, several: Several) -> dict[str, Any]:
    """Return the metrics of all, and under `ships` those of each, as plain values."""
    wishes = wishes_of(several)
    ships: dict[str, Any] = {}
    for name in log.ships:
        ship = log.ship(name)
        reached = arrival(ship, wishes[name])
        ships[name] = {
            **metrics(ship),
            "outcome_text": ship.ending.text,
            "arrived": reached.arrived,
            "time_to_goal": reached.time,
            "stuck": reached.stuck,
        }
    return several_metrics(log, wishes) | {"ships": ships}


def fly_several(
    several: Several | str,
    *,
    log_dir: Path | str | None = "logs",
    progress: Callable[[float], None] = lambda t: None,
) -> SeveralResult:
    """Fly several helicopters in one room.

    Args:
        several: They are validated like those from a file. A text is the name of a preset or the path of a TOML file:
            `fly_several("swap4")`.
        log_dir: Folder for the log, created if it does not exist; None keeps the log in memory.
        progress: Called with the simulated time, s.

    Returns:
        The outcomes and the log. A crash or a collision is an outcome and raises nothing.

    Raises:
        ExperimentError: They cannot be flown; the message names the field.
        LogError: The log cannot be started; for one that fails later, see `SeveralResult.log_trouble`.
    """
    several = checked_fleet(load_several(several) if isinstance(several, str) else several)
    fleet = several.fleet()
    helicopters = started(several, fleet)
    recorder = _begin_log(log_dir, several, fleet, helicopters.plants)
    with recorder:
        room = Room(several, helicopters, recorder.ships, progress)
        for name, experiment in fleet.items():
            recorder.ships[name].reference_path(0, planned_path(experiment))
        began = perf_counter()
        outcomes = room.run()
        took = perf_counter() - began
        outcome = outcome_of_all(outcomes)
        endings = {name: Ending(each.kind, each.time, each.text) for name, each in outcomes.items()}
        recorder.close_ships(outcome.kind, outcome.time, outcome.text, endings)
    data = recorder.stream.getvalue() if recorder.stream else None
    digest = "" if outcome.kind == INVALID else recorder.digest
    factor = 1e-9 * outcome.time / took
    return SeveralResult(
        several, outcome, outcomes, recorder.path, digest, factor, data, recorder.trouble, BUILD_TROUBLE
    )


def started(several: Several, fleet: Mapping[str, Experiment]) -> Helicopters:
    """Return each helicopter at the first point of its trajectory, in a world of its own or all in one.

    Raises:
        ExperimentError: The flight of one cannot start.
    """
    if several.world == "apart":
        return Helicopters({name: start_plant(experiment) for name, experiment in fleet.items()}, None)
    plants = {name: e.plant for name, e in fleet.items() if isinstance(e.plant, MuJoCo)}
    try:
        world = World(plants, {name: start_state(experiment) for name, experiment in fleet.items()})
    except ValueError as error:
        raise ExperimentError(f"the flight cannot start: {error}") from None
    return Helicopters(world.twins, world)


def flown_several(log: Log) -> Several:
    """What a log of several helicopters says that they flew.

    Raises:
        ExperimentError: This version cannot fly it.
    """
    try:
        return several_from_json(log.experiment)
    except ClassMissing:
        raise
    except ExperimentError as error:
        raise ExperimentError(f"the log's experiment is none of this version of heli_twin: {error}") from None


def checked_fleet(several: Several) -> Several:
    """Return several helicopters after a check of each field, of what must be the same for all, and of each flight.

    Raises:
        ExperimentError: One sentence that names the helicopter, the field, its value and the limit.
    """
    several = checked_several(several)
    for name, experiment in several.fleet().items():
        try:
            checked(experiment)
            if isinstance(experiment.controller, External):
                require_program(experiment.controller)
            _check_fence(experiment, hasattr(several.coordination, "half_width"))
        except ExperimentError as error:
            raise ExperimentError(f"ships.{name}: {error}") from None
    return several


def _check_fence(experiment: Experiment, planners_too: bool) -> None:
    """Refuse a flight that begins or ends where its supervisor lands it: a room of many is larger than that of one."""
    fence = getattr(experiment.supervisor, "half_width", None)
    ends = experiment.trajectory.flat(np.array([0.0, experiment.duration])).z[:, :2]
    farthest = float(np.abs(ends).max())
    if fence is not None and farthest > fence:
        raise ExperimentError(
            f"supervisor.half_width = {fence:g} m, but the trajectory begins or ends {farthest:.2f} m north or west of"
            f" the middle, where it would land: write supervisor.half_width={farthest + 0.5:.1f}, and as much for"
            f" volume.half_width{' and coordination.half_width' * planners_too}"
        )


def _begin_log(
    folder: Path | str | None, several: Several, fleet: Mapping[str, Experiment], plants: Mapping[str, Plant]
) -> ShipsRecorder:
    """Begin a log with a name of time, kinds and seed that no other process uses at the same time."""
    seed = next(iter(fleet.values())).seed
    words = (f"{len(fleet)}ships", several.scenario.kind, several.coordination.kind, f"seed{seed}")
    stem = "-".join([datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ"), *words])
    ships = {name: _facts(experiment, plants[name]) for name, experiment in fleet.items()}
    files = [Attachment("experiment.toml", "application/toml", several_toml(several).encode())]
    while True:
        path = None if folder is None else free_path(Path(folder) / f"{stem}.mcap")
        try:
            return ShipsRecorder(path, several_json(several), provenance(), files, ships)
        except LogExistsError:
            # Another process took the name since `free_path` returned it: try the next one.
            continue


def _facts(experiment: Experiment, plant: Plant) -> ShipFacts:
    attachments = [Attachment("experiment.toml", "application/toml", toml_of(experiment).encode())]
    if mjcf := plant.description():
        attachments.append(Attachment("plant.xml", "application/xml", mjcf.encode()))
    return ShipFacts(canonical_json(experiment), facts_of(experiment), attachments, shape_of(experiment.plant))
