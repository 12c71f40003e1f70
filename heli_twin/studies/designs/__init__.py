"""Designs: which points of a study's axes are flown, and in what order. One file here is one design."""

from collections.abc import Generator, Iterable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Protocol

from heli_twin.studies.errors import StudyError

if TYPE_CHECKING:
    from heli_twin.studies.plan import Plan

Row = Mapping[str, Any]
"""One flown run: its columns by name."""


class Point(NamedTuple):
    """One setting of the axes, to be flown by every alternative with every seed."""

    changes: dict[str, Any]
    """Values by dotted path, put onto the base in this order."""
    labels: dict[str, Any] = {}  # noqa: RUF012 - never changed
    """More columns of its rows: what the point is to its design."""
    alternatives: tuple[str, ...] | None = None
    """Only these; None for all."""
    seeds: tuple[int, ...] | None = None
    """Only these; None for all."""


Batches = Generator[Iterable[Point], list[Row], None]


class Design(Protocol):
    """Which points are flown. A frozen dataclass with a literal `kind`."""

    adaptive: ClassVar[bool]
    """Whether what is flown next depends on what was flown: then each batch is answered with its rows."""

    @property
    def kind(self) -> str:
        """Its name in a study file."""
        ...

    def check(self, plan: "Plan") -> None:
        """Refuse axes that this design cannot use.

        Raises:
            StudyError: One sentence that says what to change.
        """
        ...

    def count(self, plan: "Plan") -> int:
        """How many runs it flies, at most."""
        ...

    def batches(self, plan: "Plan") -> Batches:
        """The points to fly, batch by batch."""
        ...


def need_axes(plan: "Plan", design: str) -> None:
    """Refuse a study without axes."""
    if not plan.axes:
        raise StudyError(f"a {design} design needs something to vary: add [axes] with at least one path and its values")


def runs_of_points(plan: "Plan", points: int) -> int:
    """How many runs so many points are."""
    return points * len(plan.alternatives) * plan.study.replicates
