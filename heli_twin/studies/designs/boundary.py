"""Where flights begin to fail: the boundary in 2 to 6 axes, learned from few flights where it is least certain."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Annotated, ClassVar, Literal

import numpy as np
from annotated_types import Ge, Le, doc

from controllers.signals import Array
from heli_twin.studies.axes import Axis, Linspace, Logspace, Uniform, share_of
from heli_twin.studies.columns import INVALID, SCORED
from heli_twin.studies.designs import Batches, Point, Row, need_axes
from heli_twin.studies.errors import StudyError
from heli_twin.studies.space import Space

LEAST_AXES, MOST_AXES = 2, 6


@dataclass(frozen=True, slots=True)
class Boundary:
    """The line at which half of the flights of a point have a score above the limit; flights that crash do.

    The first points are spread evenly. Each further round is placed by a Gaussian process where it is least certain
    on which side a point lies, for every alternative by itself.
    """

    adaptive: ClassVar[bool] = True
    kind: Literal["boundary"] = "boundary"
    limit: Annotated[float, doc("score above which a flight has failed; 0 suits `excess.NAME` of a requirement")] = 0.0
    points: Annotated[int, Ge(4), Le(1000), doc("how many, of every alternative")] = 80
    first: Annotated[int, Ge(2), Le(500), doc("points of them that are spread evenly to begin with")] = 20
    round: Annotated[int, Ge(1), Le(100), doc("points asked for at a time")] = 5

    def check(self, space: Space) -> None:
        """Refuse axes that are no ranges, and too few or too many of them."""
        need_axes(space, "boundary")
        if not LEAST_AXES <= len(space.axes) <= MOST_AXES:
            raise StudyError(
                f"a boundary is learned in {LEAST_AXES} to {MOST_AXES} axes, not {len(space.axes)}: of one axis take"
                " design.kind = 'margin', of many find the few that matter with 'morris'"
            )
        for path, axis in space.axes.items():
            if not isinstance(axis, Linspace | Logspace | Uniform) or axis.quantile(0.0) == axis.quantile(1.0):
                raise StudyError(f"axis '{path}': a boundary is searched in a range, write {{ uniform = [from, to] }}")
        if self.first >= self.points:
            raise StudyError(f"design.first = {self.first}: it has to be below design.points = {self.points}")
        if self.limit >= space.penalty:
            raise StudyError(
                f"design.limit = {self.limit:g}: it has to be below the score of a crash, penalty = {space.penalty:g}"
            )
        if find_spec("sklearn") is None:
            raise StudyError("a boundary design needs scikit-learn: pip install 'heli-twin[boundary]'")

    def count(self, space: Space) -> int:
        """The number of points times alternatives and seeds."""
        return space.runs(self.points)

    def batches(self, space: Space) -> Batches:
        """Yield the first points, then a round of every alternative at a time."""
        from heli_twin.studies.straddle import next_places, spread_places

        seed = space.seeds.start
        log2 = int(np.ceil(np.log2(self.first)))
        start = spread_places(len(space.axes), log2, seed)[: self.first]
        rows = yield [_point(space, place, number) for number, place in enumerate(start)]
        flown: list[Row] = list(rows)
        for number in range(self.first, self.points, self.round):
            count = min(self.round, self.points - number)
            asked: list[Point] = []
            for alternative in space.alternatives:
                mine = [row for row in flown if row["alternative"] == alternative.name]
                places, scores = places_and_scores(mine, space.axes, space.score, space.penalty)
                places = next_places(places, response(scores, self.limit), count, seed)
                asked += [
                    _point(space, place, number + i)._replace(alternatives=(alternative.name,))
                    for i, place in enumerate(places)
                ]
            flown += yield asked


def _point(space: Space, place: Array, number: int) -> Point:
    shares = zip(space.axes.items(), place.tolist(), strict=True)
    return Point({path: float(f"{axis.quantile(share):.5g}") for (path, axis), share in shares}, {"asked": number})


def places_and_scores(rows: Iterable[Row], axes: Mapping[str, Axis], score: str, penalty: float) -> tuple[Array, Array]:
    """Return where the flights of one alternative were, and their scores.

    Args:
        rows: Of the flights; invalid ones are left out.
        axes: By path.
        score: The metric.
        penalty: The score of a crash.

    Returns:
        (n, d) places of the points in the unit cube, and (n,) medians of their scores over the seeds.
    """
    scores: dict[int, list[float]] = {}
    places: dict[int, list[float]] = {}
    for row in rows:
        if row["outcome"] == INVALID:
            continue
        value = row.get(score) if row["outcome"] in SCORED else None
        scores.setdefault(row["asked"], []).append(penalty if value is None else float(value))
        places[row["asked"]] = [share_of(axis, row[path]) for path, axis in axes.items()]
    if not scores:
        raise StudyError("all flights so far were invalid: mend the program of the control law, and run it again")
    return np.array(list(places.values())), np.array([float(np.median(these)) for these in scores.values()])


def response(scores: Array, limit: float) -> Array:
    """Return on which side of the limit scores are, and how far, between -1 and 1, (n,).

    It is (s - limit) / (s + limit), which is half the logarithm of s / limit near the limit and levels off far from it:
    a crash hides nothing. Of scores that may be negative, such as the excess over a requirement, whose limit is 0, it
    is that of s + 1: the same for what is as great as its limit times s + 1.
    """
    unit = abs(limit) or 1.0
    if (scores < 0.0).any() or limit <= 0.0:
        above = scores - limit
        return above / (2.0 * unit + np.abs(above))
    return (scores - limit) / (scores + limit)
