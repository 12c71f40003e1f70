"""The recorder of several helicopters: one file, in which each has the topics of a flight under its name."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from controllers.coordinations import CommittedPlan, Note
from controllers.trajectories import Trajectory
from heli_twin.lab.plant.shape import Primitive
from heli_twin.recording import ships_pb2 as pb
from heli_twin.recording.records import Attachment, Ending, OutcomeKind
from heli_twin.recording.schema import EXPERIMENT, SHIPS_PROTO, sealed
from heli_twin.recording.wires import Sink, Wires
from heli_twin.recording.writer import LogWriter


class ShipFacts(NamedTuple):
    """What the log says of one of several helicopters at its beginning."""

    experiment: str
    """Canonical JSON."""
    metadata: Mapping[str, str]
    attachments: Sequence[Attachment] = ()
    shape: Sequence[Primitive] = ()
    """Empty for the mCX2."""


class ShipWires(Wires):
    """Records the signals of one of several helicopters."""

    def __init__(self, sink: Sink, shape: Sequence[Primitive], name: str) -> None:
        super().__init__(sink, shape, name)
        self._planning_times: list[tuple[str, int, bytes]] = []

    def path(self, t: int, committed: Trajectory) -> None:
        """Record what the helicopter flies from now on: a plan, or its wish."""
        message = pb.Path(start=t, step=0)
        if isinstance(committed, CommittedPlan):
            message = pb.Path(start=committed.start, step=committed.step, knots=committed.knots.ravel().tolist())
        self._put("/path", t, message.SerializeToString(deterministic=True))

    def planning(self, t: int, note: Note, messages: tuple[int, int], turn_ns: int) -> None:
        """Record what the planner did in a turn.

        Args:
            t: ns.
            note: Of the planner.
            messages: How many it sent to each other, and how many it received since its last turn.
            turn_ns: Measured time of the whole turn, ns.
        """
        sent, received = messages
        turn = pb.Turn(
            outcome=note.outcome,
            reason=note.reason,
            is_stuck=note.is_stuck,
            iterations=note.iterations,
            sent=sent,
            received=received,
        )
        self._put("/planning", t, turn.SerializeToString(deterministic=True))
        took = pb.PlanningTime(turn_ns=turn_ns, solve_ns=note.solve_ns)
        self._planning_times.append(("/planning_timing", t, took.SerializeToString(deterministic=True)))

    def pack_waiting(self) -> None:
        """Hand all signals so far to the file; measured times are no part of the digest."""
        times, self._planning_times = self._planning_times, []
        self._to.write(times)
        super().pack_waiting()


class ShipsRecorder(LogWriter):
    """Writes one flight of several helicopters; `ships` has the wires of each by its name."""

    def __init__(
        self,
        path: Path | None,
        experiment: str,
        metadata: Mapping[str, str],
        attachments: Sequence[Attachment],
        ships: Mapping[str, ShipFacts],
    ) -> None:
        """Open the log.

        Args:
            path: Path of the finished log, `.../NAME.mcap`; None keeps it in memory.
            experiment: All of them, as canonical JSON.
            metadata: Facts that do not determine the flight.
            attachments: Files to keep with the flight.
            ships: What is said of each helicopter by its name.

        Raises:
            LogError: The file exists already or cannot be written.
        """
        own = [
            each._replace(name=f"{name}/{each.name}")
            for name, ship in ships.items()
            for each in (Attachment(EXPERIMENT, "application/json", ship.experiment.encode()), *ship.attachments)
        ]
        types = Attachment(SHIPS_PROTO.name, "text/plain", SHIPS_PROTO.read_bytes())
        super().__init__(path, experiment, metadata, [types, *attachments, *own], tuple(ships))
        for name, ship in ships.items():
            self._mcap.metadata(f"run.{name}", sealed(ship.metadata))
        self.ships = {name: ShipWires(self._sink(f"/{name}"), ship.shape, name) for name, ship in ships.items()}
        self._wires = [*self.ships.values()]

    def close_ships(self, outcome: OutcomeKind, t: int, text: str, endings: Mapping[str, Ending]) -> None:
        """Write how the flight of each helicopter ended, and how that of all, and give the file its name.

        Args:
            outcome: Of all.
            t: Simulated end, ns.
            text: The same in one sentence.
            endings: Of each helicopter by its name.
        """
        for name, end in endings.items():
            facts = {"outcome": end.outcome, "time": str(end.time), "text": end.text}
            self._mcap.metadata(f"end.{name}", sealed(facts))
        self.close(outcome, t, text)
