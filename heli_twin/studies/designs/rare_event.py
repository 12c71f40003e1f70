"""The probability of a rare failure, over the scatter of the axes and the noise itself, by subset simulation."""

from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from math import inf
from typing import Annotated, Any, ClassVar, Literal

from annotated_types import Ge, Le, doc
from scipy.special import ndtr

from heli_twin.studies.columns import INVALID, SCORED
from heli_twin.studies.designs import Batches, Point, Row
from heli_twin.studies.errors import StudyError
from heli_twin.studies.least_failure import (
    MOST_CHANGES,
    MOST_PARTS,
    RANDOM,
    TRIED,
    Narrowing,
    first_random_seed,
    length,
    narrowings,
    parts_of,
    random_states,
    some_of,
    steepest,
    stepped,
)
from heli_twin.studies.space import Space
from heli_twin.studies.subset_simulation import Estimate, State, mean_state, size, subset_simulation


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
        changes = MOST_CHANGES if space.axes else 1
        levels = self.samples + (self.levels - 1) * (self.samples - chains)
        flights = levels + 2 * TRIED * (changes + 1) + MOST_PARTS + RANDOM
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
        yield from self._least(space, found, count(first))

    def _least(self, space: Space, found: Mapping[str, Estimate], numbers: Iterator[int]) -> Batches:
        """Fly the mean failure scaled, a nearer one, and then as far in random directions."""
        failures = {name: some_of(estimate.failures) for name, estimate in found.items() if estimate.failures}
        means = {name: narrowings(mean_state(states)) for name, states in failures.items()}
        changes = yield from self._narrowed(space, means, numbers)
        least = {name: those[0] for name, those in changes.items() if those and those[0].change == "all"}
        parts = {name: parts_of(failures[name]) for name in least}
        steps = [(name, "slope", stepped(least[name].least, part)) for name, some in parts.items() for part in some]
        scores = iter((yield from self._flown(space, steps, numbers)))
        nearer: dict[str, list[Narrowing]] = {}
        for name, some in parts.items():
            direction = steepest(some, [next(scores) - least[name].score for _ in some])
            if direction is not None:
                farthest = 1.1 * length(*size(least[name].least), len(space.axes))
                nearer[name] = [Narrowing("all", direction, high=farthest)]
        turned = yield from self._narrowed(space, nearer, numbers)
        least |= {name: those[0] for name, those in turned.items() if those}
        first = first_random_seed(space.seeds.start)
        asked = [(name, "random", s) for name, each in least.items() for s in random_states(each.least, first)]
        yield from self._flown(space, asked, numbers)

    def _narrowed(
        self, space: Space, changes: dict[str, list[Narrowing]], numbers: Iterator[int]
    ) -> Generator[Iterable[Point], list[Row], dict[str, list[Narrowing]]]:
        """Scale each change twice; returns those that are known to fail."""
        for _ in range(2):
            asked = [
                (name, each.change, state) for name, those in changes.items() for each in those for state in each.states
            ]
            scores = iter((yield from self._flown(space, asked, numbers)))
            learnt = {
                name: [each.learn([next(scores) for _ in range(TRIED)], self.limit) for each in those]
                for name, those in changes.items()
            }
            changes = {name: [each for each in those if each is not None] for name, those in learnt.items()}
        return changes

    def _flown(
        self, space: Space, asked: Sequence[tuple[str, str, State]], numbers: Iterator[int]
    ) -> Generator[Iterable[Point], list[Row], list[float]]:
        """Fly states of alternatives, each with what was changed; returns their scores."""
        if not asked:
            return []
        points = [
            self._point(space, state, name, next(numbers), change)._replace(keep=change == "all")
            for name, change, state in asked
        ]
        scores = _scores((yield points), space)
        return [scores[name, point.labels["state"]] for (name, *_), point in zip(asked, points, strict=True)]

    def _point(self, space: Space, state: State, alternative: str, number: int, change: str = "search") -> Point:
        changes: dict[str, Any] = {
            path: axis.quantile(min(float(ndtr(z)), 1.0 - 1e-12))
            for (path, axis), z in zip(space.axes.items(), state.place, strict=True)
        }
        changes["noise"] = [[seed, weight] for seed, weight in state.noise]
        axes, noise = size(state)
        labels = {"state": number, "change": change, "axes_size": axes, "noise_size": noise}
        return Point(changes, labels, alternatives=(alternative,))


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
