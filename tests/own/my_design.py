"""A study design of a user's own: each axis in turn, in equal steps."""

from collections.abc import Generator
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from annotated_types import Ge, doc

from heli_twin.studies.designs import Point
from heli_twin.studies.space import Space


@dataclass(frozen=True, slots=True)
class Star:
    """Each axis at some values of its range, the others as they are."""

    adaptive: ClassVar[bool] = False
    kind: Literal["star"] = "star"
    points: Annotated[int, Ge(2), doc("values of each axis")] = 3

    def check(self, space: Space) -> None:
        """It takes any axes."""

    def count(self, space: Space) -> int:
        """The points of all rays."""
        return space.runs(1 + self.points * len(space.axes))

    def batches(self, space: Space) -> Generator[list[Point], None, None]:
        """One batch, the middle first."""
        shares = [k / self.points for k in range(self.points)]
        yield [Point({}), *(Point({path: axis.quantile(p)}) for path, axis in space.axes.items() for p in shares)]
