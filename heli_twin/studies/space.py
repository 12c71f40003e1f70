"""The space of a design: base experiment, alternatives, axes and seeds."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from heli_twin.experiment import Experiment
from heli_twin.experiment.own import refuse_commands
from heli_twin.experiment.paths import put_part
from heli_twin.experiment.several import Several
from heli_twin.experiment.several_text import EVERY, SHIPS, put_several, several_of
from heli_twin.experiment.several_written import is_several_json, parsed_several, several_json
from heli_twin.experiment.tree import Tree, canonical_json, experiment_of, parsed
from heli_twin.studies.axes import Axis


class Alternative(NamedTuple):
    """One of the compared experiments."""

    name: str
    changes: dict[str, Any]
    """Its changes of the base: values by dotted path."""


@dataclass(frozen=True, slots=True)
class Space:
    """The space in which a design places its points."""

    base: str
    """The base experiment, canonical JSON."""
    alternatives: tuple[Alternative, ...]
    axes: Mapping[str, Axis]
    """The axes by the path of the field that each varies."""
    seeds: range
    """The seeds of every point; designs that draw points use the first of them."""
    score: str
    """The metric that ranks flights, smaller is better."""
    penalty: float
    """The score of a flight that failed."""
    requirements: tuple[str, ...] = ()
    """Names of the study's requirements."""

    def runs(self, points: int) -> int:
        """Return the number of runs of so many points."""
        return points * len(self.alternatives) * len(self.seeds)


def varied(base: str, changes: Mapping[str, Any]) -> Tree:
    """An experiment, or several helicopters, with some fields changed, one after the other.

    Args:
        base: Canonical JSON.
        changes: Values by dotted path.
    """
    together = is_several_json(base)
    tree = parsed_several(base) if together else parsed(base)
    for path, value in changes.items():
        # A linspace over a horizon gives 12.0 and 13.5.
        counts = type(value_at(tree, path)) is int and isinstance(value, float)
        value = round(value) if counts else value
        if together:
            put_several(tree, tree[SHIPS], path, value)
        else:
            put_part(tree, path, value)
    for each in each_of(tree):
        refuse_commands(each)
    return tree


def each_of(tree: Tree) -> list[Tree]:
    """Return the trees of experiments in a tree: itself, or those of several helicopters."""
    return [tree[EVERY], *tree[SHIPS].values()] if EVERY in tree else [tree]


def with_seed(tree: Tree, seed: int) -> Tree:
    """Return the same tree with another seed, which all helicopters have."""
    for each in each_of(tree):
        each["seed"] = seed
    return tree


def text_of(tree: Tree) -> str:
    """Return the canonical JSON of what a tree says.

    Raises:
        ExperimentError: It cannot be flown.
    """
    return several_json(_several(tree)) if EVERY in tree else canonical_json(experiment_of(tree))


def experiments_of(tree: Tree) -> list[Experiment]:
    """Return the experiment of a tree, or those of all its helicopters.

    Raises:
        ExperimentError: It cannot be flown.
    """
    return [*_several(tree).fleet().values()] if EVERY in tree else [experiment_of(tree)]


def _several(tree: Tree) -> Several:
    return several_of({name: part for name, part in tree.items() if name != SHIPS}, tree[SHIPS])


def value_at(tree: Tree, path: str) -> Any:
    """The value at a dotted path; None where there is none yet. Of several helicopters it is that of every one."""
    keys = path.split(".")
    value: Any = tree[EVERY] if EVERY in tree and keys[0] not in tree else tree
    for key in keys:
        value = value.get(key) if isinstance(value, dict) else None
    return value
