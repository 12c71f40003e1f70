"""A flight log as NumPy columns: the input of every metric, figure and picture."""

from collections.abc import Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, NoReturn, TypeVar

import numpy as np
from google.protobuf.message import DecodeError, Message

from controllers.coordinations import CommittedPlan
from controllers.signals import Array, NamedState
from heli_twin.recording import flight_pb2 as pb
from heli_twin.recording import ships_pb2
from heli_twin.recording.columns import (
    Airs,
    Batteries,
    Commands,
    Estimates,
    ExtraEstimates,
    ExtraPlans,
    Moments,
    Plans,
    Poses,
    QpReports,
    References,
    Timings,
    Truths,
)
from heli_twin.recording.columns import Times as Times
from heli_twin.recording.foxglove import LogMessage, PointCloud
from heli_twin.recording.packing import Layout
from heli_twin.recording.records import (
    ORIGIN_KEY,
    ORIGINS,
    Attachment,
    Committed,
    Ending,
    Event,
    Messages,
    Origin,
    OutcomeKind,
    ShipRecord,
    Turn,
)
from heli_twin.recording.schema import (
    EXPERIMENT,
    LAYOUTS,
    QP_STATUS,
    SEVERITIES,
    SHIP_WIRES,
    TOPICS,
    LogError,
    extra_estimate_layout,
    extra_plan_layout,
    plan_layout,
)
from heli_twin.recording.state_names import EXTRA_STATES, MAX_STATES, named
from heli_twin.terminal_text import clean, instead

M = TypeVar("M", bound=Message)


_OF_ONE = frozenset(topic.name for topic in (*TOPICS, *SHIP_WIRES))
"""Topics that a log of several helicopters has under their names alone."""
SHIP_KEY = "ship"
"""Key in the metadata of `Log.ship`: the name of the helicopter."""

COLUMNS = (
    *("truth", "pose", "estimate", "reference", "sent", "acting", "plan", "qp", "disturbance", "battery", "events"),
    *("timing", "estimate_extra", "plan_extra", "disturbance_moment", "reference_paths"),
)
"""The columns of a log, in the order of the data."""
OTHER_NAMES = {
    **dict.fromkeys(("mocap", "poses", "cameras", "vicon"), "pose"),
    **dict.fromkeys(("state", "states", "x"), "truth"),
    **dict.fromkeys(("command", "commands", "input", "inputs", "u"), "sent"),
    **dict.fromkeys(("air", "wind", "gust"), "disturbance"),
    **dict.fromkeys(("estimates", "x_est"), "estimate"),
    **dict.fromkeys(("ref", "references", "x_ref"), "reference"),
    **dict.fromkeys(("plans", "mpc", "horizon"), "plan"),
    "solver": "qp",
    "times": "timing",
}
"""Words that a reader may look for, and the column that they mean."""


@dataclass(frozen=True, repr=False)
class Log:
    """A recorded flight: its experiment, its messages and its ending. Columns are decoded when first asked for.

    Each topic is a tuple of NumPy columns with one row a message: `log.truth.position` is (n, 3), world, m. Times are
    integers, ns; `log.truth.seconds` is the same in s. `help(log.truth)` tells all columns with their units.

    Attributes:
        messages: By topic, as they are in the file.
        experiment: What was flown, canonical JSON.
        metadata: Versions, platform, wall-clock start and more.
        attachments: Files in the log, by name.
        ending: Outcome, time and reason of the end.
        ships: Of a log of several helicopters, by their names; `ship` returns the log of one. Empty for a log of one.
        others: Of one of several helicopters: where the others were, by their names.
    """

    messages: Mapping[str, Messages]
    experiment: str = ""
    metadata: Mapping[str, str] = field(default_factory=dict)
    attachments: Mapping[str, Attachment] = field(default_factory=dict)
    ending: Ending = field(default_factory=Ending)
    ships: Mapping[str, ShipRecord] = field(default_factory=dict[str, ShipRecord])
    others: Mapping[str, "Log"] = field(default_factory=dict[str, "Log"])

    def ship(self, name: str) -> "Log":
        """Return the log of one of several helicopters, which is like any other.

        Raises:
            LogError: There is none of this name.
        """
        if name not in self.ships:
            what = f"has no helicopter {instead(name, self.ships)}" if self.ships else "is of one helicopter alone"
            raise LogError(f"the log {what}")
        record, attached = (
            self.ships[name],
            {
                title.removeprefix(f"{name}/"): file._replace(name=title.removeprefix(f"{name}/"))
                for title, file in self.attachments.items()
                if title.startswith(f"{name}/")
            },
        )
        if EXPERIMENT not in attached:
            raise LogError(f"does not say what {clean(name, 60)} flew: give a log that heli-twin recorded")
        return Log(
            messages={
                topic.removeprefix(f"/{name}"): messages
                for topic, messages in self.messages.items()
                if topic.startswith(f"/{name}/")
            },
            experiment=attached[EXPERIMENT].data.decode(),
            metadata={**self.metadata, **record.metadata, SHIP_KEY: name},
            attachments=attached,
            ending=record.ending._replace(digest=self.digest, recovered=self.ending.recovered),
            others={
                other: Log({"/truth": self._messages(f"/{other}/truth")}, ending=self.ships[other].ending)
                for other in self.ships
                if other != name
            },
        )

    def __repr__(self) -> str:
        count = sum(len(topic.times) for topic in self.messages.values())
        how = f"{self.outcome} after {1e-9 * self.ending.time:g} s"
        return f"Log({self.origin}, {how}, {count} messages on {len(self.messages)} topics, {clean(self.digest, 12)})"

    def _repr_html_(self) -> str:
        """A table of the topics, for notebooks."""
        from html import escape

        rows = "".join(
            f"<tr><td>{escape(clean(name, 60))}</td><td>{escape(repr(topic))}</td></tr>"
            for name, topic in self.messages.items()
        )
        return f"<p>{escape(repr(self))}</p><p>{escape(clean(self.ending.text))}</p><table>{rows}</table>"

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> NoReturn:
            """Say which columns there are, and where what was asked for is found."""
            hint = f"it is called `log.{OTHER_NAMES[name]}`" if name in OTHER_NAMES else f"it has {', '.join(COLUMNS)}"
            raise AttributeError(f"a log has no `{name}`: {hint}", name=name, obj=self)

    @property
    def topics(self) -> dict[str, int]:
        """Number of messages on each topic of the log."""
        return {topic: len(messages.times) for topic, messages in self.messages.items()}

    @property
    def outcome(self) -> OutcomeKind:
        """The outcome of the flight."""
        return self.ending.outcome

    @property
    def digest(self) -> str:
        """Hash that is the same for two flights of the same experiment."""
        return self.ending.digest

    @property
    def origin(self) -> Origin:
        """The program that wrote the log. An import has no truth, and a reference only if a trajectory was given."""
        return ORIGINS.get(self.metadata.get(ORIGIN_KEY, "flight"), "unknown")

    @cached_property
    def truth(self) -> Truths:
        """The true motion of the helicopter."""
        return Truths(*self._columns("/truth"))

    @cached_property
    def pose(self) -> Poses:
        """The poses of the motion capture, in order of arrival."""
        return Poses(*self._columns("/mocap/pose"))

    @cached_property
    def estimate(self) -> Estimates:
        """The states that the estimator computed."""
        return Estimates(*self._columns("/estimate"))

    @cached_property
    def reference(self) -> References:
        """The planned state and input at each control step."""
        return References(*self._columns("/reference"))

    @cached_property
    def sent(self) -> Commands:
        """The inputs that the controller sent."""
        return Commands(*self._columns("/command/sent"))

    @cached_property
    def acting(self) -> Commands:
        """The inputs in force at the helicopter, from each time on."""
        return Commands(*self._columns("/command/acting"))

    @cached_property
    def plan(self) -> Plans:
        """The plans of the controller, one a control step."""
        first = self._first("/mpc/plan", pb.Plan)
        horizon = len(first.u) // 4 if first else 0
        return Plans(*self._columns("/mpc/plan", plan_layout(horizon)))

    @cached_property
    def qp(self) -> QpReports:
        """The solver's report on each control problem."""
        time, status, *rest = self._columns("/mpc/qp")
        with _decoding("/mpc/qp"):
            return QpReports(time, np.array(QP_STATUS)[status], *rest)

    @cached_property
    def disturbance(self) -> Airs:
        """Wind and other disturbances, from each time on."""
        return Airs(*self._columns("/disturbance"))

    @cached_property
    def battery(self) -> Batteries:
        """Voltage and current of the battery; no rows if the plant has none."""
        return Batteries(*self._columns("/battery"))

    @cached_property
    def disturbance_moment(self) -> Moments:
        """Moments of disturbances, from each time on."""
        return Moments(*self._columns("/disturbance_moment"))

    @cached_property
    def estimate_extra(self) -> ExtraEstimates:
        """The estimator's further states; no rows if it has none."""
        first = self._first("/estimate_extra", pb.ExtraEstimate)
        count = len(first.x) if first else 0
        return ExtraEstimates(*self._columns("/estimate_extra", extra_estimate_layout(_few(count))))

    @cached_property
    def plan_extra(self) -> ExtraPlans:
        """The further states of the plans; no rows if they have none."""
        first, plan = self._first("/mpc/plan_extra", pb.ExtraPlan), self._first("/mpc/plan", pb.Plan)
        rows = len(plan.u) // 4 + 1 if plan else 1
        count = len(first.x) // rows if first else 0
        return ExtraPlans(*self._columns("/mpc/plan_extra", extra_plan_layout(rows, _few(count))))

    @property
    def estimate_states(self) -> tuple[NamedState, ...]:
        """Names and units of the estimator's further states."""
        return self._names("/estimate_extra", self.estimate_extra.x.shape[-1])

    @property
    def plan_states(self) -> tuple[NamedState, ...]:
        """Names and units of the plans' further states."""
        return self._names("/mpc/plan_extra", self.plan_extra.x.shape[-1])

    def _names(self, topic: str, count: int) -> tuple[NamedState, ...]:
        return named(self.metadata.get(EXTRA_STATES[topic], ""), count)

    def _first(self, topic: str, message: type[M]) -> M | None:
        """The first message of a topic, decoded; None if it has none."""
        data = self._messages(topic).data
        with _decoding(topic):
            return message.FromString(bytes(data[0])) if data else None

    @cached_property
    def events(self) -> list[Event]:
        """The events of the flight, in order."""
        topic = self._messages("/events")
        with _decoding("/events"):
            messages = [LogMessage.FromString(bytes(data)) for data in topic.data]
            return [
                Event(t, SEVERITIES[m.level], m.name, m.message) for t, m in zip(topic.times, messages, strict=True)
            ]

    @cached_property
    def reference_paths(self) -> list[tuple[int, Array]]:
        """Time (ns) at which each whole reference path was recorded, and its points (n, 3), world, m, rounded."""
        topic = self._messages("/view/reference_path")
        with _decoding("/view/reference_path"):
            clouds = [PointCloud.FromString(bytes(data)) for data in topic.data]
            return [(t, _points(cloud)) for t, cloud in zip(topic.times, clouds, strict=True)]

    @cached_property
    def committed(self) -> list[Committed]:
        """The plans that one of several helicopters flew, each from its time on; empty for one that flew alone."""
        topic = self._messages("/path")
        with _decoding("/path"):
            paths = [ships_pb2.Path.FromString(bytes(data)) for data in topic.data]
            return [Committed(t, _plan(path)) for t, path in zip(topic.times, paths, strict=True)]

    @cached_property
    def planning(self) -> list[Turn]:
        """The turns of the planner of one of several helicopters; empty for one that flew alone."""
        topic = self._messages("/planning")
        with _decoding("/planning"):
            turns = [ships_pb2.Turn.FromString(bytes(data)) for data in topic.data]
            return [
                Turn(t, turn.outcome, clean(turn.reason, 200), turn.is_stuck, turn.iterations, turn.sent, turn.received)
                for t, turn in zip(topic.times, turns, strict=True)
            ]

    @cached_property
    def planning_ns(self) -> Times:
        """(n,) measured times of the turns of the planner of one of several helicopters, ns."""
        with _decoding("/planning_timing"):
            messages = self._messages("/planning_timing").data
            return np.array([ships_pb2.PlanningTime.FromString(bytes(data)).turn_ns for data in messages], np.int64)

    @cached_property
    def timing(self) -> Timings:
        """Measured computing times."""
        return Timings(*self._columns("/timing"))

    def _messages(self, topic: str) -> Messages:
        if self.ships and topic in _OF_ONE:
            raise LogError(
                f"the log is of several helicopters, {clean(', '.join(self.ships), 120)}: ask for one of them, as"
                f" log.ship('{next(iter(self.ships))}') or as RUN.mcap#{next(iter(self.ships))} on the command line"
            )
        return self.messages.get(topic, Messages((), ()))

    def _columns(self, topic: str, layout: Layout | None = None) -> list[Any]:
        """Log times, then each field of a topic, one row a message."""
        messages = self._messages(topic)
        with _decoding(topic):
            records = (layout or LAYOUTS[topic]).unpack(messages.data)
        columns = [np.ascontiguousarray(records[name]) for name in records.dtype.names or ()]
        return [np.array(messages.times, np.int64), *columns]


def _plan(path: ships_pb2.Path) -> CommittedPlan | None:
    """The plan of a message; None for a wish."""
    if not path.step:
        return None
    knots = np.array(path.knots).reshape(-1, 3, 4)
    if len(knots) < 2 or path.step < 0 or not np.isfinite(knots).all():
        raise ValueError("a plan has less than two knots or is not finite")
    return CommittedPlan(path.start, path.step, knots)


def _few(count: int) -> int:
    if count > MAX_STATES:
        raise LogError(f"has {count} further states, {MAX_STATES} at most can be read: heli-twin did not write it")
    return count


@contextmanager
def _decoding(topic: str) -> Generator[None]:
    try:
        yield
    except (ValueError, IndexError, DecodeError) as error:
        why = clean(str(error), 100)
        raise LogError(f"the messages on {topic} cannot be read ({why}): was another program writing them?") from error


def _points(cloud: PointCloud) -> Array:
    """Positions (n, 3): the first three floats of every point."""
    points = np.frombuffer(cloud.data, np.uint8).reshape(-1, cloud.point_stride)
    return np.ascontiguousarray(points[:, :12]).view("<f4").reshape(-1, 3).astype(float)
