"""A Latin hypercube: points spread over all axes at once, each axis cut into as many slices as there are points."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from annotated_types import Ge, doc

from heli_twin.studies.designs import Batches, Point, need_axes, runs_of_points

if TYPE_CHECKING:
    from heli_twin.studies.plan import Plan


@dataclass(frozen=True, slots=True)
class LatinHypercube:
    """Points spread over ranges and distributions."""

    adaptive: ClassVar[bool] = False
    kind: Literal["latin_hypercube"] = "latin_hypercube"
    points: Annotated[int, Ge(1), doc("how many")] = 64

    def check(self, plan: "Plan") -> None:
        """It needs axes."""
        need_axes(plan, "latin_hypercube")

    def count(self, plan: "Plan") -> int:
        """As many points as asked for."""
        return runs_of_points(plan, self.points)

    def batches(self, plan: "Plan") -> Batches:
        """One batch."""
        from scipy.stats import qmc

        shares = qmc.LatinHypercube(len(plan.axes), rng=plan.study.seed).random(self.points)
        yield (
            Point({p: a.quantile(u) for (p, a), u in zip(plan.axes.items(), row, strict=True)})
            for row in shares.tolist()
        )
