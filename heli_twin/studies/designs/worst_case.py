"""The worst case within the axes: a search by Optuna, and as many random points to compare it with."""

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

from annotated_types import Ge, Le, doc

from heli_twin.studies.columns import INVALID, SCORED
from heli_twin.studies.designs import Batches, Point, Row, need_axes
from heli_twin.studies.errors import StudyError
from heli_twin.studies.space import Space

Origin = Literal["search", "random"]
"""The origin of a point: the search or the random baseline."""


@dataclass(frozen=True, slots=True)
class WorstCase:
    """A tree-structured Parzen estimator looks for the greatest score, for every alternative by itself.

    Its points are asked for in rounds of fixed size, so that the search is the same on any number of workers, and a
    study that is run again finds its flights. The random baseline has the same number of points and the same seeds.
    """

    adaptive: ClassVar[bool] = True
    kind: Literal["worst_case"] = "worst_case"
    trials: Annotated[int, Ge(2), doc("points of the search, and of the random baseline")] = 48
    round: Annotated[int, Ge(1), Le(1000), doc("points asked for at a time")] = 8

    def check(self, space: Space) -> None:
        """Refuse axes with a single value."""
        need_axes(space, "worst_case")
        for path, axis in space.axes.items():
            if axis.quantile(0.0) == axis.quantile(1 - 1e-9):
                raise StudyError(f"axis '{path}' has one value only: there is nothing to search")

    def count(self, space: Space) -> int:
        """Search and baseline."""
        return space.runs(2 * self.trials)

    def batches(self, space: Space) -> Batches:
        """Yield the random baseline, and then the search, round by round."""
        from numpy.random import default_rng

        shares = default_rng(space.seeds.start).random((self.trials, len(space.axes))).tolist()
        yield [self._point(space, row, "random", trial) for trial, row in enumerate(shares)]
        from optuna.trial import TrialState

        searches = {alternative.name: self._search(space) for alternative in space.alternatives}
        for first in range(0, self.trials, self.round):
            numbers = range(first, min(first + self.round, self.trials))
            asked = {(name, number): search.ask() for number in numbers for name, search in searches.items()}
            points = []
            for (name, number), trial in asked.items():
                row = [trial.suggest_float(path, 0.0, 1.0 - 1e-9) for path in space.axes]
                points.append(self._point(space, row, "search", number)._replace(alternatives=(name,)))
            rows = yield points
            for (name, number), trial in asked.items():
                mine = [row for row in rows if row["alternative"] == name and row["trial"] == number]
                score = _mean_score(space, mine)
                searches[name].tell(trial, score, None if score is not None else TrialState.FAIL)

    def _point(self, space: Space, shares: list[float], found_by: Origin, trial: int) -> Point:
        changes = {path: axis.quantile(share) for (path, axis), share in zip(space.axes.items(), shares, strict=True)}
        return Point(changes, {"found_by": found_by, "trial": trial})

    def _search(self, space: Space) -> Any:
        import optuna

        optuna.logging.set_verbosity(optuna.logging.WARNING)
        sampler = optuna.samplers.TPESampler(seed=space.seeds.start, n_startup_trials=min(10, self.trials // 2))
        return optuna.create_study(direction="maximize", sampler=sampler)


def _mean_score(space: Space, rows: list[Row]) -> float | None:
    """The mean over the seeds; None if all of the runs were invalid."""
    valid = [row for row in rows if row["outcome"] != INVALID]
    scores = [row[space.score] if row["outcome"] in SCORED else space.penalty for row in valid]
    if not scores:
        return None
    return sum(space.penalty if score is None else score for score in scores) / len(scores)
