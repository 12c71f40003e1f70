"""The probability of a rare failure, over the scatter of the axes and the noise itself, by subset simulation."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, Literal

from annotated_types import Ge, Le, doc
from scipy.special import ndtr

from heli_twin.studies.columns import INVALID, SCORED
from heli_twin.studies.designs import Batches, Point, Row
from heli_twin.studies.errors import StudyError
from heli_twin.studies.least_failure import (
    MOST_CHANGES,
    RANDOM,
    TRIED,
    Narrowing,
    first_random_seed,
    narrowings,
    random_states,
)
from heli_twin.studies.space import Space
from heli_twin.studies.subset_simulation import Estimate, State, mean_state, scaled, subset_simulation


@dataclass(frozen=True, slots=True)
class RareEvent:
    """How often is the score above a limit, and which is the most likely flight that does it?

    The scatter is that of the axes, each spread evenly over its range, and all noise of a flight: cameras, gusts,
    losses, times. Flights that crash have failed. Needs one replicate: the search makes its own noise.
    """

    adaptive: ClassVar[bool] = True
    kind: Literal["rare_event"] = "rare_event"
    limit: Annotated[float, doc("score above which a flight has failed; 0 suits `excess.NAME` of a requirement")] = 0.0
    samples: Annotated[int, Ge(50), Le(100_000), doc("flights of a level; each level is ten times rarer")] = 1000
    levels: Annotated[int, Ge(1), Le(12), doc("the most levels: 6 reach about one in a million")] = 6

    def check(self, space: Space) -> None:
        """Refuse several replicates."""
        if len(space.seeds) > 1:
            raise StudyError(
                f"replicates = {len(space.seeds)}: a rare_event design makes its own noise, leave replicates at 1"
            )
        if self.limit >= space.penalty:
            raise StudyError(
                f"design.limit = {self.limit:g}: it has to be below the score of a crash, penalty = {space.penalty:g}"
            )

    def count(self, space: Space) -> int:
        """All levels, and the flights that look for the least failure and around it."""
        chains = round(0.1 * self.samples)
        changes = 3 if space.axes else 1
        flights = self.samples + (self.levels - 1) * (self.samples - chains) + 2 * TRIED * changes + RANDOM
        return len(space.alternatives) * flights

    def batches(self, space: Space) -> Batches:
        """Yield the first level, then a step of all chains at a time, for every alternative by itself."""
        searches = {
            alternative.name: subset_simulation(
                len(space.axes), self.limit, self.samples, self.levels, space.seeds.start
            )
            for alternative in space.alternatives
        }
        asked = {name: next(search) for name, search in searches.items()}
        found: dict[str, Estimate] = {}
        first = 0
        while asked:
            width = max(map(len, asked.values()))
            rows = yield [
                self._point(space, state, name, first + i)
                for name, states in asked.items()
                for i, state in enumerate(states)
            ]
            scores = _scores(rows, space)
            for name in list(asked):
                mine = [scores[name, first + i] for i in range(len(asked[name]))]
                try:
                    asked[name] = searches[name].send(mine)
                except StopIteration as end:
                    found[name] = end.value
                    del asked[name]
            first += width
        yield from self._least(space, found, first)

    def _least(self, space: Space, found: Mapping[str, Estimate], first: int) -> Batches:
        """Fly the mean failure scaled, twice, and then as far in random directions."""
        open_ones: dict[str, list[Narrowing]] = {
            name: narrowings(mean_state(estimate.failures)) for name, estimate in found.items() if estimate.failures
        }
        for _ in range(2):
            asked = {
                (name, k, i): (first + TRIED * k + i, each.change, state, each.factors[i])
                for name, those in open_ones.items()
                for k, each in enumerate(those)
                for i, state in enumerate(each.states)
            }
            if not asked:
                return
            rows = yield [
                self._point(space, state, name, number, {"factor": factor, "change": change})._replace(
                    keep=change == "all"
                )
                for (name, _, _), (number, change, state, factor) in asked.items()
            ]
            scores = _scores(rows, space)
            failed = {place: scores[place[0], number] >= self.limit for place, (number, *_) in asked.items()}
            open_ones = {
                name: [
                    left
                    for k, each in enumerate(those)
                    if (left := each.learn({i: failed[name, k, i] for i in range(TRIED)})) is not None
                ]
                for name, those in open_ones.items()
            }
            first += TRIED * MOST_CHANGES
        least = {name: scaled(those[0].state, those[0].high) for name, those in open_ones.items() if those}
        yield [
            self._point(space, state, name, first + i, {"change": "random"})
            for name, nearest in least.items()
            for i, state in enumerate(random_states(nearest, first_random_seed(space.seeds.start)))
        ]

    def _point(
        self,
        space: Space,
        state: State,
        alternative: str,
        number: int,
        labels: Mapping[str, Any] = MappingProxyType({}),
    ) -> Point:
        changes: dict[str, Any] = {
            path: axis.quantile(min(float(ndtr(z)), 1.0 - 1e-12))
            for (path, axis), z in zip(space.axes.items(), state.place, strict=True)
        }
        changes["noise"] = [[seed, weight] for seed, weight in state.noise]
        told = {"state": number, "factor": None, "change": "search", **labels}
        return Point(changes, told, alternatives=(alternative,))


def _scores(rows: Sequence[Row], space: Space) -> dict[tuple[str, int], float]:
    """The score of each flight by alternative and number; infinite for one that crashed.

    Raises:
        StudyError: A flight was invalid.
    """
    scores: dict[tuple[str, int], float] = {}
    for row in rows:
        if row["outcome"] == INVALID:
            raise StudyError(
                f"run {row['id']} was invalid: a rare_event design needs the score of every flight; run it again"
            )
        score = row.get(space.score) if row["outcome"] in SCORED else None
        scores[row["alternative"], row["state"]] = inf if score is None else float(score)
    return scores


def estimate_of(design: RareEvent, axes: int, seed: int, scores: Sequence[float]) -> Estimate | None:
    """Return the estimate of one alternative from the scores of its states in order; None if some are missing.

    Args:
        design: What was flown.
        axes: Number of axes.
        seed: Of the study.
        scores: Infinite for a crash.
    """
    search, first = subset_simulation(axes, design.limit, design.samples, design.levels, seed), 0
    states = next(search)
    try:
        while first + len(states) <= len(scores):
            count = len(states)
            states = search.send(scores[first : first + count])
            first += count
    except StopIteration as end:
        return end.value
    return None
