"""Subset simulation: the probability of a rare failure as a product of probabilities that are not rare.

The first level draws freely. Each further level starts from the tenth of the last one with the greatest scores, and
draws more from that region by Markov chains: a step keeps a share of the state and mixes in new normal numbers (the
pre-conditioned Crank-Nicolson proposal), and is undone if its score is below the region's. The size of the steps is
adapted so that 44 % of them stay.

The interval is that of a log-normal number. Its variance counts the correlation within a chain, between chains that
come from the same chain of the level before, and between a level and the next; the quantile is Student's, since the
variance itself is estimated from few chains (degrees of freedom after Satterthwaite).

Source: Au and Beck, Estimation of small failure probabilities in high dimensions, Prob. Eng. Mech. 16 (2001);
Papaioannou, Betz, Zwirglmaier and Straub, MCMC algorithms for subset simulation, Prob. Eng. Mech. 41 (2015).
"""

from collections.abc import Generator, Iterator, Sequence
from itertools import count
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from controllers.signals import Array
from heli_twin.lab.chance import generator

SHARE = 0.1
"""Of a level's samples that start the next one."""
TARGET_ACCEPTANCE = 0.44
FIRST_STEP = 0.6


class State(NamedTuple):
    """A point of the space that is searched: independent standard normal numbers."""

    place: tuple[float, ...]
    """One number for each axis."""
    noise: tuple[tuple[int, float], ...]
    """Seeds and weights of a flight's noise, squared weights adding up to 1."""


class Level(NamedTuple):
    """One level of the search."""

    threshold: float
    """Score that a flight of the next level reaches at least."""
    share: float
    """Of the samples that reach it."""
    scores: Array
    """(n,) of its samples."""


class Estimate(NamedTuple):
    """A probability and what it rests on."""

    probability: float
    low: float
    """Lower limit of the 95 % interval."""
    high: float
    """Upper limit; where nothing failed, what three failures in the last level would have been."""
    levels: tuple[Level, ...]
    failures: tuple[State, ...]
    """Distinct samples of the last level that failed."""
    evaluations: int


Search = Generator[list[State], Sequence[float], Estimate]
"""Yields the states whose scores it needs, is sent the scores, returns the estimate."""


def fresh(seed: int, axes: int) -> State:
    """Return the state of one seed: independent of that of every other."""
    return State(tuple(generator(seed, "axes").standard_normal(axes).tolist()), ((seed, 1.0),))


def moved(state: State, share: float, seed: int) -> State:
    """Return a state near another one: a share of it, squared, is that of a new seed."""
    keep, new = (1.0 - share * share) ** 0.5, fresh(seed, len(state.place))
    place = tuple(keep * old + share * other for old, other in zip(state.place, new.place, strict=True))
    return State(place, (*((s, keep * w) for s, w in state.noise), (seed, share)))


def subset_simulation(axes: int, limit: float, samples: int, levels: int, seed: int) -> Search:
    """Search for states with a score of `limit` or more.

    Args:
        axes: Number of axes.
        limit: Score from which a flight has failed.
        samples: n, states of a level.
        levels: The most levels.
        seed: The search is the same for the same seed.

    Returns:
        The estimate, when the last scores have been sent.
    """
    seeds = _seeds(seed)
    chains = round(SHARE * samples)
    steps = samples // chains
    samples, size, evaluated = chains * steps, FIRST_STEP, 0
    states = [fresh(next(seeds), axes) for _ in range(samples)]
    scores = np.asarray((yield states), np.float64)
    evaluated += samples
    chain = np.arange(samples)
    told: list[Level] = []
    shares: list[Array] = []
    parents: list[NDArray[np.intp]] = []
    while True:
        order = np.argsort(-scores, kind="stable")
        threshold = 0.5 * float(scores[order[chains - 1]] + scores[order[chains]])
        is_last = not threshold < limit or len(told) == levels - 1
        threshold = limit if is_last else threshold
        reached = scores >= threshold
        share = float(reached.mean())
        told.append(Level(threshold, share, scores))
        shares.append(np.bincount(chain, (reached - share) / (samples * max(share, 1.0 / samples))).astype(np.float64))
        if is_last:
            failures = tuple(dict.fromkeys(states[i] for i in np.flatnonzero(reached)))
            return _estimate(told, shares, parents, failures, evaluated)
        # In an order that has nothing to do with the scores, so that the step's adaptation favours none.
        starts = generator(next(seeds), "order").permutation(order[:chains])
        parents.append(np.asarray(chain[starts], np.intp))
        now, now_scores = [states[i] for i in starts], scores[starts]
        all_states, all_scores = [now], [now_scores]
        for step in range(1, steps):
            proposed = [moved(state, size, next(seeds)) for state in now]
            answer = np.asarray((yield proposed), np.float64)
            evaluated += chains
            stays = answer >= threshold
            now = [new if stay else old for new, old, stay in zip(proposed, now, stays, strict=True)]
            now_scores = np.where(stays, answer, now_scores)
            all_states.append(now)
            all_scores.append(now_scores)
            size = min(1.0, float(np.exp(np.log(size) + (stays.mean() - TARGET_ACCEPTANCE) / step**0.5)))
        states = [state for same_step in all_states for state in same_step]
        scores = np.concatenate(all_scores)
        chain = np.tile(np.arange(chains), steps)


def _seeds(seed: int) -> Iterator[int]:
    """Count up from a number above all seeds that people take, below the greatest number of an experiment."""
    block = int(np.random.SeedSequence(seed).generate_state(1)[0]) % 40_000
    return count(1_000_000_000 + 10_000_000 * block)


def _estimate(
    levels: Sequence[Level],
    parts: Sequence[Array],
    parents: Sequence[NDArray[np.intp]],
    failures: tuple[State, ...],
    evaluations: int,
) -> Estimate:
    """The product of the shares, with its interval.

    Args:
        levels: In order.
        parts: Of each level, (chains,) what every chain adds to the relative error of the level's share.
        parents: Of each level but the first, (chains,) the chain of the level before that each one starts in.
        failures: See `Estimate`.
        evaluations: See `Estimate`.
    """
    probability = float(np.prod([level.share for level in levels]))
    if not failures:
        before = float(np.prod([level.share for level in levels[:-1]]))
        high = min(1.0, 3.0 * before / len(levels[-1].scores))
        return Estimate(0.0, 0.0, high, tuple(levels), failures, evaluations)
    variance = second = fourth = 0.0
    for i, own in enumerate(parts):
        # Chains that come from one chain of the level before are one cluster.
        clusters = own if i == 0 else np.bincount(parents[i - 1], own, len(parts[i - 1]))
        variance += float(clusters @ clusters)
        second += float(clusters @ clusters)
        fourth += float(np.sum(clusters**4))
        if i + 1 < len(parts):
            children = np.bincount(parents[i], parts[i + 1], len(own))
            variance += 2.0 * float(own @ children)
    freedom = max(2.0, 2.0 * second**2 / fourth) if fourth > 0.0 else 1e9
    width = float(stdtrit(freedom, 0.975)) * float(np.sqrt(np.log1p(max(variance, 0.0))))
    low, high = probability * np.exp(-width), min(1.0, probability * np.exp(width))
    return Estimate(probability, float(low), float(high), tuple(levels), failures, evaluations)


def combined(states: Sequence[State], weights: Sequence[float]) -> State:
    """Return the weighted sum of states."""
    noise: dict[int, float] = {}
    for state, weight in zip(states, weights, strict=True):
        for seed, part in state.noise:
            noise[seed] = noise.get(seed, 0.0) + weight * part
    place = np.asarray(weights) @ np.array([state.place for state in states]) if states else np.empty(0)
    return State(tuple(place.tolist()), tuple(noise.items()))


def mean_state(states: Sequence[State]) -> State:
    """Return the mean of states: for failures, near the most likely one; its squared weights add up to less than 1."""
    return combined(states, [1.0 / len(states)] * len(states))


def scaled(state: State, factor: float) -> State:
    """Return a state nearer to, or farther from, the mean of all."""
    return State(tuple(factor * z for z in state.place), tuple((seed, factor * w) for seed, w in state.noise))


def size(state: State) -> tuple[float, float]:
    """Return the distance from the mean, standard deviations: of the axes, and of the noise as a share of its usual."""
    return float(np.linalg.norm(state.place)), float(np.sqrt(sum(w * w for _, w in state.noise)))
