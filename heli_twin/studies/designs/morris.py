"""Morris screening: which axes matter at all, from few flights, before Sobol indices of those that do."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from annotated_types import Ge, Le, doc

from heli_twin.studies.axes import EXTREME_QUANTILES, Axis, Ensemble, Normal
from heli_twin.studies.designs import Batches, Point, need_axes
from heli_twin.studies.errors import StudyError
from heli_twin.studies.space import Space


@dataclass(frozen=True, slots=True)
class Morris:
    """Trajectories on a grid of levels: each begins at a random point and then moves every axis once, in random order.

    A move is somewhat more than half of a range, up or down; a distribution ranges from 5 % to 95 %. The change of the
    score by a move, as if over the whole range, is one elementary effect of its axis.

    Source: Morris, Technometrics 33 (1991) 161; Campolongo, Cariboni and Saltelli, Environmental Modelling & Software
    22 (2007) 1509.
    """

    adaptive: ClassVar[bool] = False
    kind: Literal["morris"] = "morris"
    trajectories: Annotated[int, Ge(3), Le(10_000), doc("each as many points as axes, and one more")] = 20
    levels: Annotated[int, Ge(2), Le(20), doc("of each axis, an even number")] = 4

    def check(self, space: Space) -> None:
        """Refuse a study without axes, axes of one value, and an odd number of levels."""
        need_axes(space, "morris")
        if self.levels % 2:
            raise StudyError(
                f"design.levels = {self.levels}: it must be even, so that all levels are as likely: {self.levels + 1}"
            )
        for path, axis in space.axes.items():
            if isinstance(axis, Ensemble):
                raise StudyError(
                    f"axis '{path}': a morris design moves one parameter at a time, and those of an ensemble go"
                    " together: take design.kind = 'sobol', where the ensemble is one axis, or 'latin_hypercube'"
                )
            if axis.quantile(0.0) == axis.quantile(1.0):
                raise StudyError(f"axis '{path}' has one value only: it cannot matter")

    def count(self, space: Space) -> int:
        """The points of all trajectories times alternatives and seeds."""
        return space.runs(self.trajectories * (len(space.axes) + 1))

    @property
    def step(self) -> float:
        """The size of a move as a share of the range: it makes every level as likely as the others."""
        return self.levels / (2 * (self.levels - 1))

    def batches(self, space: Space) -> Batches:
        """Yield one batch, a trajectory after the other."""
        yield self._points(space)

    def _points(self, space: Space) -> Iterator[Point]:
        from numpy.random import default_rng

        rng, paths = default_rng(space.seeds.start), list(space.axes)
        for trajectory in range(self.trajectories):
            is_up = rng.random(len(paths)) < 0.5
            # The lower half of the levels can go up by a move, the upper half down.
            shares = rng.integers(0, self.levels // 2, len(paths)) / (self.levels - 1)
            shares[~is_up] += self.step
            yield _point(space, shares.tolist(), {"trajectory": trajectory, "move": 0, "moved": "", "by": 0.0})
            for move, i in enumerate(rng.permutation(len(paths)).tolist(), 1):
                by = self.step if is_up[i] else -self.step
                shares[i] += by
                labels = {"trajectory": trajectory, "move": move, "moved": paths[i], "by": by}
                yield _point(space, shares.tolist(), labels)


def _point(space: Space, shares: list[float], labels: Mapping[str, object]) -> Point:
    return Point({p: _at(a, share) for (p, a), share in zip(space.axes.items(), shares, strict=True)}, labels)


def _at(axis: Axis, share: float) -> object:
    """The value at a share of the range; the ends of a distribution are its 5 % and 95 %."""
    low, high = EXTREME_QUANTILES if isinstance(axis, Normal) else (0.0, 1.0)
    return axis.quantile(low + min(max(share, 0.0), 1.0) * (high - low))
