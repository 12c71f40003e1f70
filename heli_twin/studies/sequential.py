"""Sequential stopping: a study with `replicates = "auto"` flies as many seeds as its scores need, and no more."""

from collections import defaultdict
from collections.abc import Iterable
from functools import lru_cache
from math import ceil, sqrt

import numpy as np

from heli_twin.studies.columns import SCORED
from heli_twin.studies.designs import Batches, Point
from heli_twin.studies.space import Space

PILOT = 64
"""Seeds that are flown first. A small pilot that happens to agree with itself stops too early: with 32 seeds, 93.9 % of
the 95 % intervals hold the true mean of skewed scores, with 64 at least 94.4 % (20 000 studies of 2000 flights).
"""
MOST = 1000
"""Most seeds of `replicates = "auto"`."""


def until_known(points: Iterable[Point], space: Space, half_width: float) -> Batches:
    """Yield the points with more and more seeds, until the mean score of every alternative at every point is known.

    All points fly the same seeds, so that their differences stay paired.

    Args:
        points: Of a design that does not choose them by their flights.
        space: Of the study; its seeds are the most that are flown.
        half_width: Of the 95 % interval of each mean.
    """
    points, scores = list(points), defaultdict[tuple[int, str], list[float]](list)
    done, wanted = 0, min(PILOT, len(space.seeds))
    while wanted > done:
        seeds = tuple(space.seeds[done:wanted])
        rows = yield [p._replace(labels={**p.labels, "point": k}, seeds=seeds) for k, p in enumerate(points)]
        for row in rows:
            if row["outcome"] in SCORED and row.get(space.score) is not None:
                scores[row["point"], row["alternative"]].append(row[space.score])
        done = wanted
        wanted = min(max(seeds_needed(v, done, half_width) for v in scores.values()), len(space.seeds)) if scores else 0


def seeds_needed(values: Iterable[float], flown: int, half_width: float) -> int:
    """Return how many seeds give a mean with an interval of this half-width; `flown` if they are enough.

    Flights that failed have no score and are counted apart: as many of the next ones will fail too.

    Args:
        values: Scores of the flights so far that have one.
        flown: Flights so far.
        half_width: Wanted.
    """
    scores = np.array(values)
    n = len(scores)
    if n < 2:
        return 2 * flown
    reached = float(_quantile(n) * scores.std(ddof=1) / sqrt(n))
    return flown if reached <= half_width else max(flown + 1, ceil(flown * (reached / half_width) ** 2))


@lru_cache(maxsize=4096)
def _quantile(n: int) -> float:
    """Student's factor of a 95 % interval of n values."""
    from scipy.special import stdtrit

    return float(stdtrit(n - 1, 0.975))
