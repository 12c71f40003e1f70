"""Stability margins: how far one axis can go until the flight is not acceptable any more, seed by seed."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Literal

from annotated_types import Ge, Le, doc

from heli_twin.experiment.several_written import is_several_json
from heli_twin.studies.axes import Linspace, Logspace, Uniform
from heli_twin.studies.columns import INVALID, SCORED, check_metrics
from heli_twin.studies.designs import Batches, Point, Row, need_axes
from heli_twin.studies.errors import StudyError
from heli_twin.studies.space import Space


@dataclass(frozen=True, slots=True)
class Margin:
    """Bisection on a graded criterion, for every axis, alternative, criterion and seed by itself.

    First the axis is flown at evenly spaced values; between the last acceptable one and the next, bisection closes in.
    A flight that failed is not acceptable by any criterion. `sustained.yaw = 0.07` means 4 deg of root mean square over
    the worst second: a saturated loop cycles instead of diverging.
    """

    adaptive: ClassVar[bool] = True
    kind: Literal["margin"] = "margin"
    criteria: Annotated[dict[str, float], doc("metrics, and the greatest acceptable value of each")] = field(
        default_factory=lambda: {"sustained.yaw": 0.07, "sustained.position": 0.25}
    )
    coarse: Annotated[int, Ge(2), Le(1000), doc("evenly spaced values to begin with")] = 6
    halvings: Annotated[int, Ge(0), Le(30), doc("of the interval that the coarse values leave")] = 4

    def check(self, space: Space) -> None:
        """Refuse axes that are no ranges, and unknown criteria."""
        need_axes(space, "margin")
        if not self.criteria:
            raise StudyError("a margin needs a criterion: design.criteria = { 'sustained.yaw' = 0.07 }")
        check_metrics(self.criteria, space.requirements, together=is_several_json(space.base))
        for path, axis in space.axes.items():
            if not isinstance(axis, Linspace | Logspace | Uniform):
                raise StudyError(f"axis '{path}': a margin is searched in a range, write {{ uniform = [from, to] }}")

    def count(self, space: Space) -> int:
        """The coarse values, and every halving at most once a criterion."""
        return space.runs(len(space.axes) * (self.coarse + len(self.criteria) * self.halvings))

    def batches(self, space: Space) -> Batches:
        """Yield the coarse values, and then one halving of every search at a time."""
        shares = [i / (self.coarse - 1) for i in range(self.coarse)]
        rows = yield [self.point_at(space, path, share) for path in space.axes for share in shares]
        searches = list(self._searches(space, rows))
        for _ in range(self.halvings):
            open_ones = [search for search in searches if search.open]
            if not open_ones:
                return
            rows = yield list({search.place: search.point(self, space) for search in open_ones}.values())
            flown = {(row["axis"], row["share"], row["alternative"], row["seed"]): row for row in rows}
            for search in open_ones:
                search.learn(flown[search.place], self.criteria)

    def _searches(self, space: Space, rows: list[Row]) -> Iterator["Search"]:
        for criterion in self.criteria:
            groups: dict[tuple[str, str, int], list[Row]] = {}
            for row in rows:
                groups.setdefault((row["axis"], row["alternative"], row["seed"]), []).append(row)
            for (path, alternative, seed), group in groups.items():
                low, high = bracket(group, criterion, self.criteria)
                yield Search(path, alternative, seed, criterion, low, high)

    def point_at(self, space: Space, path: str, share: float, search: "Search | None" = None) -> Point:
        """The flight at a share of an axis: for everyone, or for one search."""
        value = space.axes[path].quantile(share)
        labels = {"axis": path, "share": share, "value": value}
        if search is None:
            return Point({path: value}, labels)
        return Point({path: value}, labels, (search.alternative,), (search.seed,))


@dataclass(slots=True)
class Search:
    """One bisection: acceptable at `low`, not at `high`, as shares of the axis; None where no such value is known."""

    path: str
    alternative: str
    seed: int
    criterion: str
    low: float | None
    high: float | None

    @property
    def open(self) -> bool:
        """True if there is an interval to halve."""
        return self.low is not None and self.high is not None

    @property
    def middle(self) -> float:
        """The next share to fly."""
        assert self.low is not None
        assert self.high is not None
        return 0.5 * (self.low + self.high)

    @property
    def place(self) -> tuple[str, float, str, int]:
        """The key of its next flight; searches with different criteria may share one flight."""
        return (self.path, self.middle, self.alternative, self.seed)

    def point(self, design: Margin, space: Space) -> Point:
        """The next flight of this search."""
        return design.point_at(space, self.path, self.middle, self)

    def learn(self, row: Row, criteria: Mapping[str, float]) -> None:
        """Halve the interval by the result of the flight at its middle; an invalid run says nothing."""
        if row["outcome"] == INVALID:
            return
        if acceptable(row, self.criterion, criteria):
            self.low = self.middle
        else:
            self.high = self.middle


def bracket(rows: Sequence[Row], criterion: str, criteria: Mapping[str, float]) -> tuple[float | None, float | None]:
    """The last acceptable share before the first that is not, and that one; invalid runs say nothing."""
    low = None
    for row in sorted((row for row in rows if row["outcome"] != INVALID), key=lambda row: row["share"]):
        if not acceptable(row, criterion, criteria):
            return low, row["share"]
        low = row["share"]
    return low, None


def acceptable(row: Row, criterion: str, criteria: Mapping[str, float]) -> bool:
    """Return whether a flight completed and its metric is within the criterion."""
    value: Any = row.get(criterion)
    return row["outcome"] in SCORED and value is not None and value <= criteria[criterion]
