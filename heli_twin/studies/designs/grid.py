"""Every combination of the axes' values."""

from dataclasses import dataclass
from itertools import product
from math import prod
from typing import ClassVar, Literal

from heli_twin.studies.designs import Batches, Point
from heli_twin.studies.errors import StudyError
from heli_twin.studies.space import Space


@dataclass(frozen=True, slots=True)
class Grid:
    """Every combination. Without axes: the base alone."""

    adaptive: ClassVar[bool] = False
    kind: Literal["grid"] = "grid"

    def check(self, space: Space) -> None:
        """Refuse distributions, which have no values to combine."""
        for path, axis in space.axes.items():
            if not axis.count():
                raise StudyError(
                    f"axis '{path}' is a distribution, of which a grid cannot take every value: write a linspace, "
                    "or take design.kind = 'latin_hypercube' or 'sobol'"
                )

    def count(self, space: Space) -> int:
        """The product of the axes' lengths."""
        return space.runs(prod(axis.count() for axis in space.axes.values()))

    def batches(self, space: Space) -> Batches:
        """Yield one batch; the last axis changes fastest."""
        paths = list(space.axes)
        yield (
            Point(dict(zip(paths, values, strict=True)))
            for values in product(*(a.levels() for a in space.axes.values()))
        )
