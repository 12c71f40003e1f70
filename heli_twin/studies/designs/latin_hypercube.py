"""A Latin hypercube: points spread over all axes at once, each axis cut into as many slices as there are points."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from annotated_types import Ge, doc

from heli_twin.studies.designs import Batches, Point, need_axes
from heli_twin.studies.space import Space


@dataclass(frozen=True, slots=True)
class LatinHypercube:
    """Points spread over ranges and distributions."""

    adaptive: ClassVar[bool] = False
    kind: Literal["latin_hypercube"] = "latin_hypercube"
    points: Annotated[int, Ge(1), doc("how many")] = 64

    def check(self, space: Space) -> None:
        """Refuse a study without axes."""
        need_axes(space, "latin_hypercube")

    def count(self, space: Space) -> int:
        """The number of points times alternatives and seeds."""
        return space.runs(self.points)

    def batches(self, space: Space) -> Batches:
        """Yield one batch."""
        from scipy.stats import qmc

        shares = qmc.LatinHypercube(len(space.axes), rng=space.seeds.start).random(self.points)
        yield (
            Point({p: a.quantile(u) for (p, a), u in zip(space.axes.items(), row, strict=True)})
            for row in shares.tolist()
        )
