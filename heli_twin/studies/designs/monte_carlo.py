"""Plain Monte Carlo: independent flights, each with its own draw of every axis and its own noise."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from annotated_types import Ge, Le, doc

from heli_twin.lab.chance import generator
from heli_twin.studies.designs import Batches, Point
from heli_twin.studies.errors import StudyError
from heli_twin.studies.space import Space


@dataclass(frozen=True, slots=True)
class MonteCarlo:
    """Independent flights over the scatter of the axes, or over the noise alone if there are none.

    All alternatives fly the same draws. The report tells how often a flight fails, with Wilson's interval and Wilks's
    bounds: 59 flights without a failure show that 95 % of flights do not fail, with 95 % confidence; 299 show 99 %.
    """

    adaptive: ClassVar[bool] = False
    kind: Literal["monte_carlo"] = "monte_carlo"
    flights: Annotated[int, Ge(1), Le(10_000_000), doc("how many: 59 without a failure show 95 %, 299 show 99 %")] = 59

    def check(self, space: Space) -> None:
        """Refuse several replicates."""
        if len(space.seeds) > 1:
            raise StudyError(
                f"replicates = {len(space.seeds)}: a monte_carlo design flies each draw once, leave replicates at 1"
                " and raise design.flights"
            )

    def count(self, space: Space) -> int:
        """The number of flights times alternatives."""
        return space.runs(self.flights)

    def batches(self, space: Space) -> Batches:
        """Yield one batch: each flight has a seed of its own, from which the axes are drawn too."""
        first = space.seeds.start
        yield (self._point(space, seed) for seed in range(first, first + self.flights))

    def _point(self, space: Space, seed: int) -> Point:
        shares = generator(seed, "axes").random(len(space.axes)).tolist()
        changes = {path: axis.quantile(share) for (path, axis), share in zip(space.axes.items(), shares, strict=True)}
        return Point(changes, seeds=(seed,))
