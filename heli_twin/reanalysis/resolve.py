"""Solve every control problem of a log again, as it was or with another controller.

The estimates are the logged ones: the effect of the new inputs on the flight is not simulated, and each answer belongs
to a moment that was really flown. The model is linearised along the logged nominal inputs if the log has them, else
along the controller's own last plan, as on a log that another controller flew. With logged nominal inputs nothing of an
earlier solution enters a problem: the solver keeps no state, and the integral states follow from the estimates.
"""

import heapq
import struct
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from controllers.errors import LawFailed
from controllers.fallback import safe_hover
from controllers.laws import Controller, closed_after, flat_derivatives, preview_of
from controllers.laws.ltv_mpc import LtvMpc, LtvMpcController
from controllers.reference import ReferencePreview, with_flat
from controllers.signals import Array, Command, Estimate, Pose, QpReport, Reference, nanoseconds
from controllers.supervisors import LandsOnPlan
from controllers.trajectories import Trajectory
from heli_twin.errors import HeliTwinError
from heli_twin.experiment import Experiment
from heli_twin.experiment.text import assignment, changed
from heli_twin.lab.plant import Air, Truth
from heli_twin.logbook import begin_log, flown_experiment
from heli_twin.recording import Log, LogError
from heli_twin.recording.log import Times
from heli_twin.recording.records import ORIGIN_KEY, Committed

INPUT_TOLERANCE = 1e-4
"""Allowed difference of u_0 on another host or build, fraction of full stick. The solver stops at 1e-5 and may stop one
iteration sooner or later; the radio rounds to 3e-3."""


@dataclass(frozen=True)
class Resolution:
    """A log's control problems, solved again."""

    experiment: Experiment
    """As flown, but with the controller that solved."""
    overrides: tuple[str, ...]
    time: Times
    """(n,) ns, of every logged estimate."""
    flown: Array
    """(n, 4) the inputs sent last at these times; NaN before the first."""
    commands: list[Command]
    """(n,) the controller's answers."""

    @property
    def u(self) -> Array:
        """(n, 4) the inputs that would have been sent."""
        return np.array([command.u for command in self.commands]).reshape(-1, 4)

    @property
    def difference(self) -> Array:
        """(n, 4) the new inputs minus those flown; 0 where nothing was sent yet."""
        return np.nan_to_num(self.u - self.flown)


def resolve(log: Log, overrides: Sequence[str] = ()) -> Resolution:
    """Solve every control problem of a log again.

    Args:
        log: Any log with estimates; its controller need not have been an MPC.
        overrides: Changes of the controller, `controller.path=value` each. A controller of another kind gets the model
            and the period of the one that flew, unless they are changed too. For a log without a reference they also
            say what was to be flown, `trajectory=...`.

    Raises:
        HeliTwinError: The log has no estimates or no reference, or an override does not belong to the controller.
    """
    experiment = resolved_experiment(log, overrides)
    flown = flown_experiment(log)
    if experiment.controller.period != flown.controller.period:
        raise HeliTwinError(
            f"controller.period = {experiment.controller.period} s: the estimates were logged every"
            f" {flown.controller.period} s, and only at these times can problems be solved again"
        )
    # One thread as in flight: more would add numbers in another order. Numbers of a damaged log may overflow.
    with threadpool_limits(limits=1), np.errstate(all="ignore"):
        commands = list(_answers(log, experiment))
    flown_u = _held(log, log.estimate.time)
    return Resolution(experiment, tuple(overrides), log.estimate.time, flown_u, commands)


def resolved_experiment(log: Log, overrides: Sequence[str] = ()) -> Experiment:
    """The experiment of a log with another controller, which believes in the model of the one that flew.

    Args:
        log: Any log.
        overrides: As for `resolve`.

    Raises:
        HeliTwinError: The log has no estimates or no reference, or an override does not belong to the controller.
    """
    flown = flown_experiment(log)
    if not len(log.estimate.time):
        raise HeliTwinError("the log has no estimates: there is no control problem to solve again")
    changeable = ("controller",) if len(log.reference.time) else ("controller", "trajectory")
    paths = [assignment(text, "path=value, such as controller.horizon=12")[0] for text in overrides]
    other = next((path for path in paths if path.split(".")[0] not in changeable), None)
    if other is not None:
        raise HeliTwinError(
            f"{other} is not the controller's: change controller.* here, or fly with any change: `heli-twin refly`"
        )
    if "trajectory" in changeable and not any(path.split(".")[0] == "trajectory" for path in paths):
        raise HeliTwinError("the log has no reference: say what was to be flown, such as trajectory=circle")
    of_kind = [text for text, path in zip(overrides, paths, strict=True) if path in ("controller", "controller.kind")]
    kind = changed(flown, of_kind)
    if type(kind.controller) is not type(flown.controller):
        believed: Any = {"period": flown.controller.period, "model": flown.controller.model}
        controller: Any = replace(kind.controller, **believed)  # pyright: ignore[reportArgumentType]
        kind = replace(kind, controller=controller)
    return changed(kind, [text for text in overrides if text not in of_kind])


def _answers(log: Log, experiment: Experiment) -> Iterator[Command]:
    """The controller's command for each logged estimate."""
    law = experiment.controller
    try:
        controller = law.start()
    except ValueError as error:
        raise HeliTwinError(f"controller.{error}") from None
    with closed_after(controller):
        yield from _answers_of(controller, log, experiment)


def _answers_of(controller: Controller, log: Log, experiment: Experiment) -> Iterator[Command]:
    law = experiment.controller
    period, lead, highest = nanoseconds(law.period), nanoseconds(experiment.estimator.lead), flat_derivatives(law)
    planned = Planned(log.committed, experiment.trajectory, lambda plan: preview_of(law, plan, period, lead))
    supervisor = experiment.supervisor.start(law.model, law.period)
    statuses = dict(zip(log.qp.time.tolist(), log.qp.status.tolist(), strict=True))
    sent = dict(zip(log.sent.time.tolist(), log.sent.u, strict=True))
    plans = {int(t): i for i, t in enumerate(log.plan.time)}
    for t, estimate in _estimates(log):
        if int(t) in plans:
            _linearise_along(controller, law, log.plan.u_nominal[plans[int(t)]])
        try:
            if (known := int(np.searchsorted(log.battery.time, t, side="right"))) > 0:
                supervisor.battery(float(log.battery.voltage[known - 1]))
            preview = planned.at(int(t))
            if isinstance(supervisor, LandsOnPlan):
                supervisor.lands_on_plan = planned.is_committed
            order = supervisor.order(int(t), estimate, preview(estimate.stamp, law.steps))
            if order.command or not order.reference:
                yield order.command or safe_hover(law.model, int(t))
            else:
                command = controller.step(int(t), estimate, with_flat(order.reference, law.model, highest))
                command = order.applied(controller.explain(command))
                if supervisor.phase == "flying":
                    command = experiment.excitation.excited(int(t), command, law.model)
                yield command
            # As it was in flight: the supervisor watches what was sent then.
            status = statuses.get(int(t))
            report = QpReport(status, 0, 0, 0.0, 0.0) if status else None
            supervisor.sent(Command(int(t), sent.get(int(t), np.zeros(4)), qp=report))
        except LawFailed as error:
            raise HeliTwinError(str(error)) from None
        except (ArithmeticError, ValueError) as error:
            raise HeliTwinError(
                f"the control problem at {1e-9 * t:.3f} s cannot be rebuilt from this log: {error}"
            ) from error


class Planned:
    """The references of a flight: of its trajectory, or of the plans that one of several helicopters committed to.

    Args:
        committed: The plans, in the order of time.
        trajectory: Of the experiment.
        preview: Makes references of a trajectory.
    """

    def __init__(
        self,
        committed: Sequence[Committed],
        trajectory: Trajectory,
        preview: Callable[[Trajectory], ReferencePreview],
    ) -> None:
        self._committed, self._trajectory, self._preview = committed, trajectory, preview
        self._next, self._now = 0, preview(trajectory)
        self.is_committed = False
        """Whether the references are those of a committed plan, which ends at rest."""

    def at(self, t: int) -> ReferencePreview:
        """Return the references at t, ns; the times of calls must not decrease."""
        before = self._next
        while self._next < len(self._committed) and self._committed[self._next].time <= t:
            self._next += 1
        if self._next > before:
            plan = self._committed[self._next - 1].plan
            self._now, self.is_committed = self._preview(plan or self._trajectory), plan is not None
        return self._now


def _estimates(log: Log) -> Iterator[tuple[int, Estimate]]:
    """Time, ns, and estimate of each control step."""
    extra = dict(zip(log.estimate_extra.time.tolist(), zip(*log.estimate_extra[2:], strict=True), strict=True))
    for t, stamp, x, disturbance, variance, pose_stamp, rejected in zip(*log.estimate, strict=True):
        estimate = Estimate(int(stamp), x, disturbance, variance, int(pose_stamp), int(rejected))
        yield int(t), estimate._replace(extra=extra[t][0], extra_variance=extra[t][1]) if t in extra else estimate


def _linearise_along(controller: Controller, law: object, u_nominal: Array) -> None:
    """Give the controller the nominal inputs (N, 4) of the log; a longer horizon holds the last."""
    if isinstance(controller, LtvMpcController) and isinstance(law, LtvMpc):
        rows = np.minimum(np.arange(law.steps), len(u_nominal) - 1)
        controller.linearise_along(u_nominal[rows])


def _held(log: Log, times: Times) -> Array:
    """The input (n, 4) sent last at each time, NaN where there is none."""
    last = np.searchsorted(log.sent.time, times, side="right") - 1
    if not len(log.sent.time):
        return np.full((len(times), 4), np.nan)
    return np.where(last[:, None] < 0, np.nan, log.sent.u[last])


def write(log: Log, resolution: Resolution, path: Path) -> None:
    """Write a log with the new inputs and plans, and with everything else as it was flown.

    `/truth`, `/mocap/pose`, `/estimate`, `/reference`, `/command/acting`, `/disturbance` and the events are those of
    the flight; `/command/sent`, `/mpc/plan`, `/mpc/qp` and `/timing` are those of the other controller. The two logs
    can be replayed side by side.

    Raises:
        LogError: The log exists already or cannot be written.
    """
    experiment = resolution.experiment
    recorder = begin_log(path, experiment, metadata={ORIGIN_KEY: "resolve", "resolved_from": log.digest})
    with recorder:
        for t, points in log.reference_paths:
            recorder.reference_path(t, points)
        changes = " ".join(resolution.overrides) or "no changes"
        recorder.event(0, "info", "resolve", f"inputs and plans are counterfactual, not flown: {changes}")
        try:
            for row in heapq.merge(_flown_rows(log), _new_rows(resolution), key=lambda row: row.time):
                getattr(recorder, row.wire)(row.time, *row.values)
        except (struct.error, ArithmeticError, ValueError) as error:
            raise HeliTwinError(f"the log cannot be copied, since no flight records such values: {error}") from error
        recorder.close(log.outcome, log.ending.time, log.ending.text)
    if recorder.trouble:
        raise LogError(recorder.trouble)


class _Row(NamedTuple):
    """One message to write."""

    time: int
    wire: str
    """Name of the recorder's method."""
    values: tuple[Any, ...]


def _flown_rows(log: Log) -> Iterator[_Row]:
    """The messages that are copied, in order of time and, at one time, in the order of the flight."""
    return heapq.merge(
        (_Row(int(t), "acting", (u, int(stamp))) for t, stamp, u in zip(*log.acting, strict=True)),
        (_Row(t, "disturbance", (air,)) for t, air in _airs(log)),
        _first_rows(log),
        _copies("truth", log.truth, Truth),
        _copies("pose", log.pose, Pose),
        (_Row(t, "estimate", (estimate,)) for t, estimate in _estimates(log)),
        (_Row(event.time, "event", event[1:]) for event in log.events if event.name != "qp"),
        key=lambda row: row.time,
    )


def _copies(wire: str, columns: Iterable[Any], signal: Callable[..., Any]) -> Iterator[_Row]:
    """The messages of a topic whose fields are those of a signal."""
    return (_Row(int(t), wire, (signal(*values),)) for t, *values in zip(*columns, strict=True))


def _airs(log: Log) -> Iterator[tuple[int, Air]]:
    """Time, ns, and what the surroundings do from then on."""
    moments = dict(zip(log.disturbance_moment.time.tolist(), log.disturbance_moment.moment, strict=True))
    for t, wind, acceleration, factor in zip(*log.disturbance, strict=True):
        yield int(t), Air(wind, acceleration, factor, moments.get(int(t)))


def _first_rows(log: Log) -> Iterator[_Row]:
    """The messages of the reference; a log has its first row only."""
    for t, stamp, x, u in zip(*log.reference, strict=True):
        yield _Row(int(t), "reference", (Reference(int(stamp), x[None], u[None]),))


def _new_rows(resolution: Resolution) -> Iterator[_Row]:
    for t, command in zip(resolution.time.tolist(), resolution.commands, strict=True):
        yield _Row(t, "sent", (command,))
        if command.plan is not None:
            yield _Row(t, "plan", (command.plan,))
        if command.qp is not None:
            yield _Row(t, "qp", (command.qp,))
        yield _Row(t, "timing", (command.solve_ns, command.solve_ns))
