"""Designs: which points of a study's axes are flown, and in what order. One file here is one design."""

from collections.abc import Generator, Iterable, Mapping
from types import MappingProxyType
from typing import Any, ClassVar, NamedTuple, Protocol

from heli_twin.studies.errors import StudyError
from heli_twin.studies.space import Space

Row = Mapping[str, Any]
"""The columns of one flown run by name."""


class Point(NamedTuple):
    """One setting of the axes, to be flown by every alternative with every seed."""

    changes: dict[str, Any]
    """Values by dotted path, put onto the base in this order."""
    labels: Mapping[str, Any] = MappingProxyType({})
    """Further columns of its rows, which the report of this design needs."""
    alternatives: tuple[str, ...] | None = None
    """The alternatives that fly this point; None for all."""
    seeds: tuple[int, ...] | None = None
    """The seeds that fly this point; None for all."""
    keep: bool = False
    """True if the logs of its flights are kept in any case."""


Batches = Generator[Iterable[Point], list[Row], None]


class Design(Protocol):
    """A choice of the points to fly. A frozen dataclass with a literal `kind`."""

    adaptive: ClassVar[bool]
    """True if the next batch depends on the rows of the last one; those rows are then sent to the generator."""

    @property
    def kind(self) -> str:
        """Its name in a study file."""
        ...

    def check(self, space: Space) -> None:
        """Refuse axes that this design cannot use.

        Raises:
            StudyError: One sentence that says what to change.
        """
        ...

    def count(self, space: Space) -> int:
        """Return the greatest number of runs that it may fly."""
        ...

    def batches(self, space: Space) -> Batches:
        """Yield the points to fly, batch by batch."""
        ...


def need_axes(space: Space, design: str) -> None:
    """Refuse a space without axes."""
    if not space.axes:
        raise StudyError(f"a {design} design needs something to vary: add [axes] with at least one path and its values")
