"""The probability of a rare failure, over the scatter of the axes and the noise itself, by subset simulation."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf
from typing import Annotated, Any, ClassVar, Literal

from annotated_types import Ge, Le, doc
from scipy.special import ndtr

from heli_twin.studies.columns import INVALID, SCORED
from heli_twin.studies.designs import Batches, Point, Row
from heli_twin.studies.errors import StudyError
from heli_twin.studies.space import Space
from heli_twin.studies.subset_simulation import Estimate, State, mean_state, scaled, subset_simulation

NARROWING = 8
"""Flights at a time, twice, to find how little of the mean failure is enough to fail."""


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
        """All levels, and the flights that narrow down the most likely failure."""
        chains = round(0.1 * self.samples)
        flights = self.samples + (self.levels - 1) * (self.samples - chains) + 2 * NARROWING
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
        yield from self._narrow(space, found, first)

    def _narrow(self, space: Space, found: Mapping[str, Estimate], first: int) -> Batches:
        """Fly the mean failure scaled down, then again between the last that flew well and the first that failed."""
        means = {name: mean_state(estimate.failures) for name, estimate in found.items() if estimate.failures}
        ranges = dict.fromkeys(means, (0.0, 1.25))
        for _ in range(2):
            factors = {
                name: [low + (high - low) * (i + 1) / NARROWING for i in range(NARROWING)]
                for name, (low, high) in ranges.items()
            }
            if not factors:
                return
            rows = yield [
                self._point(space, scaled(means[name], factor), name, first + i, factor)
                for name, these in factors.items()
                for i, factor in enumerate(these)
            ]
            scores = _scores(rows, space)
            ranges = {}
            for name, these in factors.items():
                failed = [i for i in range(NARROWING) if scores[name, first + i] >= self.limit]
                if failed:
                    ranges[name] = (these[failed[0] - 1] if failed[0] else 0.0, these[failed[0]])
            first += NARROWING

    def _point(self, space: Space, state: State, alternative: str, number: int, factor: float | None = None) -> Point:
        changes: dict[str, Any] = {
            path: axis.quantile(min(float(ndtr(z)), 1.0 - 1e-12))
            for (path, axis), z in zip(space.axes.items(), state.place, strict=True)
        }
        changes["noise"] = [[seed, weight] for seed, weight in state.noise]
        return Point(changes, {"state": number, "factor": factor}, alternatives=(alternative,))


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
