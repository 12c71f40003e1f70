"""Points for Sobol's sensitivity indices: the matrices A and B, and A with one column of B at a time."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from annotated_types import Ge, doc

from heli_twin.studies.designs import Batches, Point, need_axes
from heli_twin.studies.errors import StudyError
from heli_twin.studies.space import Space


@dataclass(frozen=True, slots=True)
class Sobol:
    """n (d + 2) points for d axes. The score of a point is its mean over the seeds, failures penalised.

    Source: Saltelli et al., Computer Physics Communications 181 (2010) 259; `scipy.stats.sobol_indices`.
    """

    adaptive: ClassVar[bool] = False
    kind: Literal["sobol"] = "sobol"
    n: Annotated[int, Ge(2), doc("rows of A and B, a power of 2")] = 64

    def check(self, space: Space) -> None:
        """Refuse fewer than two axes, and an n that is no power of two."""
        need_axes(space, "sobol")
        if len(space.axes) < 2:
            raise StudyError("Sobol indices share a variance out among axes: give at least two")
        if self.n & (self.n - 1):
            raise StudyError(f"design.n = {self.n}: it must be a power of 2, such as {1 << (self.n - 1).bit_length()}")

    def count(self, space: Space) -> int:
        """A, B and a mixture for each axis."""
        return space.runs(self.n * (len(space.axes) + 2))

    def batches(self, space: Space) -> Batches:
        """Yield one batch."""
        yield self._points(space)

    def _points(self, space: Space) -> Iterator[Point]:
        from scipy.stats import qmc

        d = len(space.axes)
        rows = qmc.Sobol(2 * d, rng=space.seeds.start).random(self.n)
        A, B = rows[:, :d], rows[:, d:]
        matrices = {"A": A, "B": B}
        for i, path in enumerate(space.axes):
            matrices[path] = A.copy()
            matrices[path][:, i] = B[:, i]
        for name, matrix in matrices.items():
            for sample, row in enumerate(matrix.tolist()):
                changes = {p: a.quantile(u) for (p, a), u in zip(space.axes.items(), row, strict=True)}
                yield Point(changes, {"matrix": name, "sample": sample})
