"""One axis moved at a time, the others left at the base, for a tornado plot."""

from dataclasses import dataclass
from typing import ClassVar, Literal

from heli_twin.studies.axes import extremes
from heli_twin.studies.designs import Batches, Point, need_axes
from heli_twin.studies.space import Space


@dataclass(frozen=True, slots=True)
class OneAtATime:
    """The base, and then each axis at its two ends (a list: at all its values; a distribution: at 5 % and 95 %)."""

    adaptive: ClassVar[bool] = False
    kind: Literal["one_at_a_time"] = "one_at_a_time"

    def check(self, space: Space) -> None:
        """It needs axes."""
        need_axes(space, "one_at_a_time")

    def count(self, space: Space) -> int:
        """The base and the ends."""
        return space.runs(1 + sum(len(extremes(axis)) for axis in space.axes.values()))

    def batches(self, space: Space) -> Batches:
        """Yield one batch, the base first."""
        points = [Point({}, {"varied": "", "level": None})]
        for path, axis in space.axes.items():
            for level, value in enumerate(extremes(axis)):
                points.append(Point({path: value}, {"varied": path, "level": level}))
        yield points
