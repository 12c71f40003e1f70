"""One axis moved at a time, the others left at the base: what a tornado plot shows."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal

from heli_twin.studies.axes import extremes
from heli_twin.studies.designs import Batches, Point, need_axes, runs_of_points

if TYPE_CHECKING:
    from heli_twin.studies.plan import Plan


@dataclass(frozen=True, slots=True)
class OneAtATime:
    """The base, and then each axis at its two ends (a list: at all its values; a distribution: at 5 % and 95 %)."""

    adaptive: ClassVar[bool] = False
    kind: Literal["one_at_a_time"] = "one_at_a_time"

    def check(self, plan: "Plan") -> None:
        """It needs axes."""
        need_axes(plan, "one_at_a_time")

    def count(self, plan: "Plan") -> int:
        """The base and the ends."""
        return runs_of_points(plan, 1 + sum(len(extremes(axis)) for axis in plan.axes.values()))

    def batches(self, plan: "Plan") -> Batches:
        """One batch, the base first."""
        points = [Point({}, {"varied": "", "level": None})]
        for path, axis in plan.axes.items():
            for level, value in enumerate(extremes(axis)):
                points.append(Point({path: value}, {"varied": path, "level": level}))
        yield points
