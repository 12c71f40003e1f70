"""Every combination of the axes' values."""

from dataclasses import dataclass
from itertools import product
from math import prod
from typing import TYPE_CHECKING, ClassVar, Literal

from heli_twin.studies.designs import Batches, Point, runs_of_points
from heli_twin.studies.errors import StudyError

if TYPE_CHECKING:
    from heli_twin.studies.plan import Plan


@dataclass(frozen=True, slots=True)
class Grid:
    """Every combination. Without axes: the base alone."""

    adaptive: ClassVar[bool] = False
    kind: Literal["grid"] = "grid"

    def check(self, plan: "Plan") -> None:
        """A distribution has no values to combine."""
        for path, axis in plan.axes.items():
            if not axis.levels():
                raise StudyError(
                    f"axis '{path}' is a distribution, of which a grid cannot take every value: write a linspace, "
                    "or take design.kind = 'latin_hypercube' or 'sobol'"
                )

    def count(self, plan: "Plan") -> int:
        """The product of the axes' lengths."""
        return runs_of_points(plan, prod(len(axis.levels()) for axis in plan.axes.values()))

    def batches(self, plan: "Plan") -> Batches:
        """One batch, the last axis moving fastest."""
        paths = list(plan.axes)
        yield (
            Point(dict(zip(paths, values, strict=True)))
            for values in product(*(a.levels() for a in plan.axes.values()))
        )
