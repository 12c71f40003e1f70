"""Flies an experiment: checks it, flies it, keeps its log and computes its metrics."""

from collections.abc import Callable, Collection, Sequence
from contextlib import closing, nullcontext
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cached_property
from io import BytesIO
from math import floor
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from controllers.errors import InfeasibleTrajectory, MissingDerivatives
from controllers.flatness import state
from controllers.laws import StateReader, extra_states, flat_derivatives
from controllers.laws.external import External
from controllers.model import GRAVITY
from controllers.proxqp import BUILD_TROUBLE
from controllers.reference import check_feasible
from controllers.signals import Array, NamedState, nanoseconds
from controllers.trajectories import derivatives, fitted
from heli_twin.experiment import Experiment
from heli_twin.experiment.families import members
from heli_twin.experiment.objects import validated
from heli_twin.experiment.text import load
from heli_twin.experiment.tree import ExperimentError, tree_of
from heli_twin.flight import INVALID, Flight, Outcome
from heli_twin.lab.plant import Plant
from heli_twin.lab.plant.mujoco import MuJoCo
from heli_twin.logbook import begin_log, own_source, planned_path
from heli_twin.metrics.tracking import metrics
from heli_twin.recording import Attachment, Log, LogExistsError, Recorder, read_log
from heli_twin.recording.state_names import trouble_with
from heli_twin.recording.writer import Listener
from heli_twin.whole_file import free_path

if TYPE_CHECKING:
    from heli_twin.requirements import Requirement
    from heli_twin.viewing.live import Live

MEASURED = ("/truth", "/reference", "/mpc/qp", "/timing")
"""Topics that the metrics are computed from; a summary reads these alone, so that a long log needs little memory."""


class Pictures(NamedTuple):
    """Pictures of a flight in Rerun in which its requirements are judged."""

    where: str
    """`spawn`, `connect`, or a path that ends in `.rrd`."""
    requirements: "tuple[Requirement, ...]" = ()
    """Judged when the flight is over."""


@dataclass(frozen=True)
class Result:
    """A flown experiment.

    Attributes:
        experiment: What was flown.
        outcome: How it ended: `outcome.kind`, `outcome.text`, and `outcome.time` in ns.
        path: Path of the log; None if it is in memory.
        flight_digest: Hash of the experiment and of every recorded message but the measured times; empty for an
            invalid run.
        real_time_factor: Simulated time divided by measured time of the flight, recording included.
        data: Content of the log; None if it is in a file.
        log_trouble: One sentence that says why the log file could not be written, or empty; the flight is complete
            anyway.
        solver_trouble: The reason why the digest may differ in other processes, or empty.
    """

    experiment: Experiment
    outcome: Outcome
    path: Path | None
    flight_digest: str
    real_time_factor: float
    data: bytes | None = field(default=None, repr=False)
    log_trouble: str = ""
    solver_trouble: str = ""

    @cached_property
    def log(self) -> Log:
        """Everything that was recorded; it is read at the first use."""
        return self._read()

    def _read(self, topics: Collection[str] | None = None) -> Log:
        return read_log(self.path or BytesIO(self.data or b""), topics)

    def summary(self) -> dict[str, Any]:
        """Return the result as `heli-twin fly --json` prints it."""
        log = self._read(MEASURED)
        return metrics(log) | {
            "steps_before_first_pose": steps_before_first_pose(log),
            "outcome_text": self.outcome.text,
            "real_time_factor": self.real_time_factor,
            "log": str(self.path) if self.path else None,
            "log_trouble": self.log_trouble or None,
            "solver_trouble": self.solver_trouble or None,
            "flight_digest": self.flight_digest or None,
        }


def steps_before_first_pose(log: Log) -> int:
    """Return how many control steps found no pose yet: they asked no law and sent the hover input, `safe_hover`."""
    asked = np.flatnonzero((log.qp.status != "safe_hover") | (log.timing.control_step_ns[: len(log.qp.time)] > 0))
    return int(asked[0]) if len(asked) else len(log.qp.time)


def fly(
    experiment: Experiment | str,
    *,
    log_dir: Path | str | None = "logs",
    rerun: str | Pictures | None = None,
    progress: Callable[[float], None] = lambda t: None,
    embed_source: bool = False,
) -> Result:
    """Fly one experiment.

    Args:
        experiment: The flight; it is validated like one from a file. A text is the name of a preset or the path of a
            TOML file: `fly("lab")`.
        log_dir: Folder for the log, created if it does not exist; None keeps the log in memory.
        rerun: Rerun viewer or file that shows the flight: `spawn`, `connect`, or a path that ends in `.rrd`; None for
            no pictures. `Pictures` judges the flight in them too.
        progress: Called with the simulated time, s, at every control step.
        embed_source: Attach the source of classes of your own to the log. It is no part of the digest, and nothing
            executes it.

    Returns:
        The outcome and the log. A crash is an outcome and raises nothing, and so is the failure of a control law's own
        process: the run is then `invalid`.

    Raises:
        ExperimentError: The experiment cannot be flown; the message names the field.
        LogError: The log cannot be started; for one that fails later, see `Result.log_trouble`.
    """
    experiment = checked(load(experiment) if isinstance(experiment, str) else experiment)
    if isinstance(experiment.controller, External):
        require_program(experiment.controller)
    plant = start_plant(experiment)
    sources = own_source(experiment) if embed_source else []
    pictures = _pictures(experiment, rerun)
    recorder = _begin_log(log_dir, experiment, plant, sources, [pictures] if pictures else [])
    with recorder, closing(pictures) if pictures else nullcontext():
        recorder.reference_path(0, planned_path(experiment))
        began = perf_counter()
        outcome = _explained(Flight(experiment, plant, recorder, progress).run(), experiment)
        took = perf_counter() - began
        recorder.close(outcome.kind, outcome.time, text=outcome.text)
        data = recorder.stream.getvalue() if recorder.stream else None
        if pictures and outcome.kind != INVALID and not recorder.trouble:
            pictures.judge(recorder.path or BytesIO(data or b""))
    factor = 1e-9 * outcome.time / took
    digest = "" if outcome.kind == INVALID else recorder.digest
    return Result(experiment, outcome, recorder.path, digest, factor, data, recorder.trouble, BUILD_TROUBLE)


def _explained(outcome: Outcome, experiment: Experiment) -> Outcome:
    """Return the outcome; if the flight failed and the helicopter was too heavy to hover, the text says so.

    Such a flight is not refused, because a study may sweep the mass.
    """
    plant, u_max = experiment.plant, experiment.controller.model.u_z_max
    if outcome.kind in ("completed", INVALID) or not isinstance(plant, MuJoCo):
        return outcome
    needed, most = GRAVITY * plant.mass, u_max * plant.thrust_gain
    if needed <= most:
        return outcome
    # Rounded down, so that the mass in the text does hover.
    heaviest = floor(1e5 * most / GRAVITY) / 1e5
    return outcome._replace(
        text=f"{outcome.text}; it is too heavy to hover: plant.mass = {plant.mass:g} kg weighs {needed:.4g} N, its"
        f" largest thrust is {most:.4g} N (plant.thrust_gain at u_z_max), which carries {heaviest:g} kg"
    )


def checked(experiment: Experiment) -> Experiment:
    """Return an experiment after a check of each field and of fields that must fit together.

    Args:
        experiment: From text or made in Python.

    Returns:
        The same experiment with Python's values in place of NumPy's.

    Raises:
        ExperimentError: One sentence that names the field, its value and the limit.
    """
    e = validated(experiment)
    step, period = nanoseconds(e.plant.step), nanoseconds(e.controller.period)
    for name, time, least in (("plant.step", step, 1_000), ("controller.period", period, 1_000_000)):
        if time < least:
            raise ExperimentError(f"{name} = {1e-9 * time:g} s is too short: the least is {1e-9 * least:g} s")
    if period % step:
        nearest = max(1, round(period / step)) * e.plant.step
        raise ExperimentError(
            f"controller.period = {e.controller.period} s has to be a whole number of physics steps"
            f" (plant.step = {e.plant.step} s): the nearest is {nearest:.6g} s"
        )
    model = e.controller.model
    if model.u_hover[2] > model.u_max[2]:
        raise ExperimentError(
            f"controller.model: the helicopter is believed too heavy to hover: it needs u_z = {model.u_hover[2]:.4g}"
            f" (9.81 m/s^2 / b_z), the limit u_z_max is {model.u_max[2]:.4g}"
        )
    try:
        # Large numbers overflow; a non-finite trajectory is refused.
        with np.errstate(all="ignore"):
            check_feasible(e.trajectory, model, e.duration, e.controller.period)
    except InfeasibleTrajectory as error:
        raise ExperimentError(f"trajectory: {error}") from None
    _check_contracts(e)
    x, y, z = e.trajectory.flat(np.zeros(1)).z[0, :3].tolist()
    if max(abs(x), abs(y)) > e.volume.half_width or z > e.volume.height:
        raise ExperimentError(
            f"trajectory starts at x {x:.3g}, y {y:.3g}, z {z:.3g} m, outside the volume: volume.half_width ="
            f" {e.volume.half_width:g} m, volume.height = {e.volume.height:g} m"
        )
    return e


def _check_contracts(e: Experiment) -> None:
    """Refuse a law that reads more of the trajectory than it gives, and states whose names a log cannot hold."""
    try:
        derivatives(fitted(e.trajectory, e.controller.model), np.zeros(1), flat_derivatives(e.controller))
    except MissingDerivatives as error:
        raise ExperimentError(f"trajectory does not give what the controller reads: {error}") from None
    read: tuple[NamedState, ...] = e.controller.estimated_states if isinstance(e.controller, StateReader) else ()
    if read and extra_states(e.estimator)[: len(read)] != read:
        able = [
            kind
            for kind, spec in members("controllers.estimators").items()
            if extra_states(spec())[: len(read)] == read
        ]
        raise ExperimentError(
            f"controller: {type(e.controller).__name__} reads states such as {read[0].name}, which the estimator"
            f" {type(e.estimator).__name__} does not give; take estimator={' or '.join(able) or 'one that does'}"
        )
    for path, spec in (("estimator", e.estimator), ("controller", e.controller)):
        if trouble := trouble_with(extra_states(spec)):
            raise ExperimentError(f"{path}: {trouble}")


class ProgramMissing(ExperimentError):
    """The program of an external control law is not on this machine as it was named."""


def require_program(law: External) -> None:
    """Check that the program of an external law can be run here.

    Raises:
        ProgramMissing: One sentence that says how to name it.
    """
    try:
        law.check()
    except ValueError as error:
        raise ProgramMissing(f"controller.{error}") from None


def start_state(experiment: Experiment) -> Array:
    """Return the physical state (8,) at the first point of the trajectory."""
    return state(experiment.trajectory.flat(np.zeros(1)))[0]


def start_plant(experiment: Experiment) -> Plant:
    """Return the helicopter at the first point of its trajectory."""
    try:
        return experiment.plant.start(start_state(experiment))
    except ValueError as error:
        raise ExperimentError(f"the flight cannot start: {error}") from None


def _pictures(experiment: Experiment, rerun: str | Pictures | None) -> "Live | None":
    """Return the pictures of the flight in Rerun, which is imported only here; None without `rerun`."""
    if rerun is None:
        return None
    from heli_twin.viewing.live import Live
    from heli_twin.viewing.show import destination, scales_of

    where, required = (rerun, ()) if isinstance(rerun, str) else rerun
    return Live(destination(where), scales_of(experiment)._replace(required=required))


def _begin_log(
    folder: Path | str | None,
    experiment: Experiment,
    plant: Plant,
    sources: Sequence[Attachment],
    listeners: Sequence[Listener],
) -> Recorder:
    """Begin a log with a name of time, kinds and seed that no other process uses at the same time."""
    tree = tree_of(experiment)
    kinds = [tree[part]["kind"] for part in ("plant", "trajectory", "controller")]
    stem = "-".join([datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ"), *kinds, f"seed{experiment.seed}"])
    while True:
        path = None if folder is None else free_path(Path(folder) / f"{stem}.mcap")
        try:
            return begin_log(path, experiment, mjcf=plant.description(), sources=sources, listeners=listeners)
        except LogExistsError:
            # Another process took the name since `free_path` returned it: try the next one.
            continue
